"""The record of a fit: what was found, how surely, and what the model says of every row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from identify.map.gaussian_map import GaussianMap
from identify.measurement.noise import Noise


@dataclass(frozen=True)
class Estimate:
    """One parameter: value, standard deviation and 95 % interval in `unit`.

    The interval is symmetric in the coordinate in which the parameter is sought, so that it is
    lopsided for a parameter in log scale. A fixed one (`free` False) has std 0.
    """

    value: float
    std: float
    unit: str
    lower95: float
    upper95: float
    free: bool


@dataclass(frozen=True)
class FitIteration:
    """One accepted step: all parameters of the map by name, chi-square, rms of d - C F in m."""

    iteration: int
    parameters: Mapping[str, float]
    chi2: float
    chi2_per_dof: float
    rms_m: float


@dataclass(frozen=True)
class Fit:
    """A fitted map.

    `covariance` (k, k) belongs to the k free parameters `covariance_names`, in their units.
    Of each of the m used rows: `press_index`, measured `force_n` and `displacement_m`,
    `latent_force_n` (best estimate of the true force), `predicted_m` = C F, `residual_m` =
    measured - predicted, and its standard deviation `sigma_m` from both noises.
    `compliance_m_per_n` (j,) is the fitted model's, `compliance_jacobian` (j, k) its derivative by
    the free parameters (m/N over their units); `discretization_error` (j,) the relative error
    of the coarse model's compliance against the finer one, and `model_error` (j,) the estimated
    relative error of the finer one, which covariance and intervals count in; both None where there
    was no finer model. With effects beside the map, `derivative_m` (m, k) is the derivative of
    `predicted_m` by the free parameters; without, it follows from the compliances'.
    """

    map: GaussianMap
    parameters: Mapping[str, Estimate]
    covariance_names: tuple[str, ...]
    covariance: np.ndarray
    noise: Noise
    press_index: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    latent_force_n: np.ndarray
    predicted_m: np.ndarray
    sigma_m: np.ndarray
    residual_m: np.ndarray
    compliance_m_per_n: np.ndarray
    compliance_jacobian: np.ndarray
    discretization_error: np.ndarray | None
    history: tuple[FitIteration, ...]
    chi2: float
    chi2_per_dof: float
    rms_m: float
    success: bool
    message: str
    nfev: int
    model_error: np.ndarray | None = None
    derivative_m: np.ndarray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                copy = value.copy()
                copy.setflags(write=False)
                object.__setattr__(self, name, copy)
