"""The record of a fit: estimates, their uncertainty, and the prediction of every reading."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from identify.body.state import ChangedMap
from identify.fit.curvature_bias import expected_residual
from identify.fit.free_map.field import LEVEL, Field
from identify.fit.posterior import Posterior
from identify.fit.profile_intervals import straight, valley_intervals
from identify.fit.search import FitIteration
from identify.fit.settings import FitSettings
from identify.fit.unseen_inclusions import unseen_inclusions
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import any_inclusion
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from models import InputError


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


@dataclass(frozen=True, eq=False)
class Solution:
    """The model behind a fit at its estimate.

    Attributes
    ----------
    model : the fitted model; its effects start at the estimate
    u : (k,) scaled estimate
    at : the model there
    noise_covariance, covariance : (k, k) of the scaled unknowns, from the noise alone, and with the
        finer model's own error
    settings : of the fit
    """

    model: MeasurementModel
    u: np.ndarray
    at: Linearised
    noise_covariance: np.ndarray
    covariance: np.ndarray
    settings: FitSettings

    @property
    def straight_ends(self) -> np.ndarray:
        """Ends (k, 2) of the covariance's own 95 % intervals, scaled."""
        return straight(self.u, self.covariance)

    @cached_property
    def curved_ends(self) -> np.ndarray:
        """Ends (k, 2) of 95 % intervals that follow the bend of the misfit's valley, scaled."""
        return valley_intervals(
            self.model, self.u, self.at.chi2 / 2, self.covariance, self.noise_covariance,
            self.settings,
        )  # fmt: skip

    @cached_property
    def unseen_inclusions(self) -> tuple[int, ...]:
        """Numbers, from one, of the inclusions without all of which the fit is as good."""
        return unseen_inclusions(self.model, self.u, self.at)


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fit of a map, alone or with effects, to m readings of j presses.

    Attributes
    ----------
    map : estimated map
    covariance : (k, k) of the k free parameters `covariance_names`, in their units, from the noise
        and, where there was a finer model, from its own error
    noise : standard deviations of displacement and force
    press_index, force_n, displacement_m : (m,) as measured
    latent_force_n : (m,) best estimate of the true force
    predicted_m, residual_m, sigma_m : (m,) model, measured less model, and the residual's standard
        deviation from both noises
    compliance_m_per_n : (j,) of the fitted model
    compliance_jacobian : (j, k') its derivative by the map's free parameters, m/N over their units
    discretization_error : (j,) relative error of the coarse model's compliance against the finer
        one's, None where there was none
    history : accepted steps of the search
    chi2, chi2_per_dof : of all readings
    rms_m : root mean square of the residual
    success, message : convergence, and the end of the search in words
    nfev : evaluations of the finite element model
    model_error : (j,) estimated relative error of the finer model, None where there was none
    derivative_m : (m, k) derivative of `predicted_m` by the free parameters; None of a map alone
        under a flat tip, where it follows from the compliances'
    estimates : parameters of a fit that was read from a file, or with intervals made elsewhere
    solution : the model behind the fit, None of one that was read from a file
    field : of a free map, whose unknowns stand there and not among `covariance_names`
    at_bound : names of the unknowns on a bound of the search
    posterior : draws, None where none were asked for
    """

    map: GaussianMap
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
    estimates: Mapping[str, Estimate] | None = None
    solution: Solution | None = None
    field: Field | None = None
    at_bound: tuple[str, ...] = ()
    posterior: Posterior | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                copy = value.copy()
                copy.setflags(write=False)
                object.__setattr__(self, name, copy)

    @cached_property
    def parameters(self) -> Mapping[str, Estimate]:
        """All parameters of map and effects by name, with 95 % intervals.

        Intervals that follow the bend of the misfit's valley (`FitSettings.curved_intervals`) cost
        some ten evaluations of the body an inclusion, once.
        """
        if self.estimates is not None:
            return MappingProxyType(dict(self.estimates))
        return MappingProxyType(self.intervals(self._live.settings.curved_intervals))

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, in their units."""
        if self.solution is None:
            return {name: entry.value for name, entry in self.parameters.items()}
        found = dict(zip(self.map.names, self.map.values.tolist(), strict=True))
        for effect, parameters in self.at.values.items():
            found |= {f"{effect}.{name}": number for name, number in parameters.items()}
        return found

    @property
    def std(self) -> dict[str, float]:
        """One standard deviation of each free parameter by name, in its unit."""
        deviation = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.covariance_names, deviation.tolist(), strict=True))

    @property
    def dof(self) -> int:
        """Degrees of freedom: readings less unknowns; of a free map less the effects' alone.

        Chi-square is then that of the readings beside every map of the prior.
        """
        return max(self.counted - self.unknowns, 1)

    @property
    def counted(self) -> int:
        """Number of readings, but for those of presses that a free map leaves out."""
        if self.solution is None or (uncertain := self.model.map_uncertainty) is None:
            return len(self.residual_m)
        return uncertain.counted(self.press_index)

    @property
    def unknowns(self) -> int:
        """Number of unknowns of map and effects; of a free map those of the effects alone."""
        return len(self.covariance_names)

    @property
    def bic(self) -> float:
        """Bayesian information criterion: chi-square + k ln m."""
        return self.chi2 + self.unknowns * float(np.log(self.counted))

    # ---- of a fit that was made here, not read -------------------------------------------

    @property
    def _live(self) -> Solution:
        if self.solution is None:
            raise InputError("this fit was read from a file, without its model: fit the scan again")
        return self.solution

    @property
    def model(self) -> MeasurementModel:
        """The fitted model; its effects start at the estimate."""
        return self._live.model

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects beside the map."""
        return self.model.effect_names

    @property
    def u(self) -> np.ndarray:
        """Scaled estimate, (k,)."""
        return self._live.u

    @property
    def covariance_scaled(self) -> np.ndarray:
        """Covariance of the scaled estimate, (k, k), with the finer model's own error."""
        return self._live.covariance

    @property
    def at(self) -> Linearised:
        """The model at the estimate."""
        return self._live.at

    @property
    def changed_map(self) -> ChangedMap:
        """The estimated map with the changes that the effects make."""
        return ChangedMap(self.map, self.at.state)

    @property
    def is_gross(self) -> bool:
        """Whether the misfit is gross (`FitSettings.gross_misfit`) or the map has an error."""
        return self._live.settings.is_gross(self.chi2_per_dof) or bool(self.model.press_error)

    @cached_property
    def expected_residual(self) -> np.ndarray:
        """Mean of the whitened residual under noise alone, (m,), see `curvature_bias`.

        Zero beside structure: there is no null to be exact about, and it costs many evaluations.
        """
        live = self._live
        if self.chi2 - self.dof > live.settings.structured_sigmas * np.sqrt(2 * self.dof):
            return np.zeros_like(live.at.residual)
        return expected_residual(
            lambda u: live.model.linearise(u, slack=1.0).residual,
            live.u,
            live.at.residual,
            live.noise_covariance,
            live.model.bounds,
            live.settings,
        )

    @property
    def unseen_inclusions(self) -> tuple[int, ...]:
        """Numbers, from one, of the inclusions without all of which the fit is as good."""
        return self._live.unseen_inclusions

    def intervals(self, curved: bool) -> dict[str, Estimate]:
        """Return all parameters with 95 % intervals, `curved` or from the covariance alone.

        A gross misfit has no valley worth following, nor has a map whose own error outweighs the
        noise: the intervals are then the covariance's. An inclusion that is not seen may be
        anywhere: its intervals are all that the search allows.
        """
        live = self._live
        unseen = tuple(f"inclusion_{n}." for n in live.unseen_inclusions)
        ends = live.curved_ends if curved and not self.is_gross else live.straight_ends
        low, high = live.model.bounds
        ends = np.clip(ends, low[:, None], high[:, None])
        units = {
            p.name: p.unit for p in (*live.model.space.parameters, *live.model.unknowns.beyond)
        }
        found = {n: Estimate(v, 0.0, units[n], v, v, free=False) for n, v in self.values.items()}
        for p, (one, other) in zip(live.model.unknowns.unknowns, ends.tolist(), strict=True):
            between = sorted((p.to_value(one), p.to_value(other)))
            if p.name.startswith(unseen):
                between = any_inclusion(p)
            std = self.std[p.name]
            found[p.name] = Estimate(self.values[p.name], std, p.unit, *between, free=True)
        if self.field is not None:
            mean, *between = np.exp(self.field.log_mean + np.array([0, -1.96, 1.96])
                                    * self.field.log_mean_sd).tolist()  # fmt: skip
            level = Estimate(mean, mean * self.field.log_mean_sd, "Pa", *between, free=True)
            found = {LEVEL: level, **found}
        return found
