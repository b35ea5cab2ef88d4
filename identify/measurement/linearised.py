"""A measurement model at one point: predictions, whitened residual, derivatives."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identify.body.response import BodyResponse
from identify.body.state import BodyState
from identify.measurement.chain import OperatingPoint
from identify.measurement.map_uncertainty import MarginalMap
from identify.measurement.shared_error import decorrelated


class Compressed(NamedTuple):
    """A linear model at one point, of two rows a press.

    Attributes
    ----------
    residual : (2 j,) whitened
    jacobian : (2 j, k) derivative of the whitened PREDICTION by the scaled unknowns
    rms_m : root mean square of measured less predicted displacement over all readings
    """

    residual: np.ndarray
    jacobian: np.ndarray
    rms_m: float

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals of all readings."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True)
class Linearised:
    """The model at one point, for a fit's step, its statistics and the score tests.

    Attributes
    ----------
    predicted_m, sigma_m, latent_force_n : (m,)
    residual : (m,) whitened
    jacobian : (m, k) derivative of the whitened PREDICTION (minus that of the residual) by the
        scaled unknowns
    rms_m : root mean square of measured less predicted displacement
    shared_errors : (m, 3) change of the whitened prediction by one standard deviation of each error
        that the readings of a press share: of the map (by ln C), of first touch and, beside an
        uncertain map, of the lag
    common_errors : (m, 2) the same of the errors that all presses share: of first touch and of the
        lag; zero beside an uncertain map
    by_compliance, by_modulus : (m,) derivative of the prediction by C and local modulus, at F^
    compliance, modulus : (j,) of the presses, and the modulus under the tip, there
    body : compliances and their derivatives by the map
    values : parameters of the effects, by effect and name
    """

    predicted_m: np.ndarray
    sigma_m: np.ndarray
    latent_force_n: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    rms_m: float
    shared_errors: np.ndarray
    common_errors: np.ndarray
    by_compliance: np.ndarray
    by_modulus: np.ndarray
    compliance: np.ndarray
    modulus: np.ndarray
    body: BodyResponse
    state: BodyState
    values: Mapping[str, Mapping[str, float]]
    marginal: MarginalMap | None = None

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals."""
        return float(self.residual @ self.residual)

    @property
    def point(self) -> OperatingPoint:
        """Where the chain is linearised."""
        return OperatingPoint(self.compliance, self.modulus, self.latent_force_n, self.values)

    def whitened(self, change_m: np.ndarray, press: np.ndarray) -> np.ndarray:
        """Whiten changes (m,) or (m, k) of the displacement, as the residual is."""
        white = decorrelated((change_m.T / self.sigma_m).T, self.shared_errors, press)
        white = decorrelated(white, self.common_errors, np.zeros_like(press))
        if self.marginal is None:
            return white
        return self.marginal.whitened((white.T * self.marginal.weight).T)
