"""Fit map and effects together, towards the finer model of the body.

The residual is the finer model's by defect correction: the coarse model's compliances are carried
to the finer one's at the estimate (`BodyMechanics.correct`) and fitted again, until the estimate
no longer moves. Where that would raise the finer model's own chi-square, the map may only move
less far from where the correction was made. A fit starts from an earlier one's estimate, so that
few evaluations do.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identify.body.discretization_error import MODEL_ERROR, shift_covariance
from identify.body.state import ChangedMap
from identify.fit.curvature_bias import expected_residual
from identify.map.gaussian_map import GaussianMap
from identify.measurement.model import Linearised, MeasurementModel
from identify.optimize.gauss_newton import covariance, minimize_gauss_newton
from identify.optimize.result import InadmissibleError, OptimizeResult

_FTOL = 1e-2  # half of chi-square; 0.14 standard deviations at most
_RTOL = 1e-6
_SETTLED = 0.1  # standard deviations
_ROUNDS = 3
_NEARER, _NEARER_ROUNDS = 0.25, 5  # where a correction did not hold: steps of this part, and rounds
_ROUGH = 4.0  # in chi-square: what a correction may change before it is looked at more closely
_GROSS, _GROSS_RTOL = 5.0, 1e-3  # see `scan_problem`: digits do not cure a wrong model


@dataclass(frozen=True, eq=False)
class JointFit:
    """Map and effects that explain a scan best.

    Attributes
    ----------
    model : what was fitted
    u : (k,) scaled estimate
    at : the model there, with the residual (m,) and its derivatives
    covariance : (k, k) of the scaled unknowns, from the noise; with the meshes' error it is
        `total_covariance`
    success : the minimum was reached
    nfev : evaluations of the finite element model
    """

    model: MeasurementModel
    u: np.ndarray
    at: Linearised
    covariance: np.ndarray
    success: bool
    nfev: int

    @property
    def chi2(self) -> float:
        """Chi-square of all readings."""
        return self.at.chi2

    @property
    def dof(self) -> int:
        """Degrees of freedom: readings less unknowns."""
        return max(len(self.at.residual) - len(self.u), 1)

    @property
    def chi2_per_dof(self) -> float:
        """Chi-square per degree of freedom."""
        return self.chi2 / self.dof

    @property
    def residual_m(self) -> np.ndarray:
        """Measured less modelled displacement, (m,) m."""
        return self.model.displacement_m - self.at.predicted_m

    @property
    def rms_m(self) -> float:
        """Root mean square of the residual, m."""
        return float(np.sqrt(np.mean(self.residual_m**2)))

    @property
    def bic(self) -> float:
        """Bayesian information criterion: chi-square + k ln m."""
        return self.chi2 + len(self.u) * np.log(len(self.at.residual))

    @property
    def map(self) -> GaussianMap:
        """The estimated map."""
        return self.model.map(self.u)

    @property
    def changed_map(self) -> ChangedMap:
        """The estimated map with what the effects make of it."""
        return ChangedMap(self.map, self.at.state)

    @property
    def values(self) -> dict[str, float]:
        """Estimates of the unknowns by name, in their units."""
        found = dict(zip(self.map.names, self.map.values.tolist(), strict=True))
        for effect, own in self.at.values.items():
            found |= {f"{effect}.{name}": number for name, number in own.items()}
        return found

    @cached_property
    def total_covariance(self) -> np.ndarray:
        """Covariance (k, k) from the noise and from what the finer model itself is off by."""
        if MODEL_ERROR in self.model.has:
            return self.covariance  # it is among the unknowns
        at, press = self.at, self.model.readings.press
        c = at.body.compliance
        off = c * self.model.mechanics.model_error
        shift = at.whitened(at.by_compliance * off[press], press)
        pull = np.zeros((len(c), len(self.u)))
        np.add.at(pull, press, at.jacobian * shift[:, None])
        return self.covariance + shift_covariance(self.covariance, pull)

    @cached_property
    def expected_residual(self) -> np.ndarray:
        """What noise alone would leave of the residual on average, (m,), see `curvature`."""
        return expected_residual(
            lambda u: self.model.linearise(u).residual,
            self.u,
            self.at.residual,
            self.covariance,
            self.model.bounds,
        )

    @property
    def std(self) -> dict[str, float]:
        """One standard deviation of each unknown by name, in its unit; noise and meshes."""
        deviation = np.sqrt(np.diag(self.total_covariance)) * np.abs(self.model.slope(self.u))
        return dict(zip(self.model.names, deviation.tolist(), strict=True))

    @property
    def message(self) -> str:
        """How the fit ended, in words."""
        held = self.at_bound
        ended = "map and effects fitted jointly" if self.success else "the joint fit did not end"
        return ended + (f"; at its bound, so not found: {', '.join(held)}" if held else "")

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns that sit on one of their bounds."""
        low, high = self.model.bounds
        hit = (self.u <= low + 1e-9) | (self.u >= high - 1e-9)
        return tuple(name for name, is_hit in zip(self.model.names, hit, strict=True) if is_hit)


def fit_jointly(
    model: MeasurementModel,
    stiffness: GaussianMap,
    *,
    rounds: int = _ROUNDS,
    max_evaluations: int = 40,
    enough: float = 0.0,
    callback: Callable[[float], None] | None = None,
) -> JointFit:
    """Fit all free parameters of map and effects.

    Parameters
    ----------
    model : its effects start from their own values
    stiffness : map to start from
    rounds : of correction towards the finer model, more where its chi-square still falls; 0 keeps
        the present correction
    max_evaluations : of a round
    enough : a round ends, too, when two steps in a row lowered chi-square by no more than this
    callback : called with chi-square after each accepted step

    Raises
    ------
    InadmissibleError
        The start is impossible.
    """
    search = _Search(enough, max_evaluations, callback)
    u, radius, accepted, near = model.start(stiffness), np.inf, 0, False
    own: float | None = None  # the finer model's chi-square at u, where it is known
    stale = False  # the correction was made elsewhere than at u: what it led to says nothing
    result, at = search.minimum(model, u, radius)
    if rounds == 0:
        return search.fit(model, result.x, at, result.success)
    for _ in range(rounds + _NEARER_ROUNDS):
        there = corrected_at(model, result.x)
        now = search.linearised(there, result.x)
        if own is None and now.chi2 > at.chi2 + _ROUGH:
            before = search.linearised(model, u).chi2
            model = corrected_at(model, u)
            own = search.linearised(model, u).chi2
            stale = abs(own - before) > _ROUGH
        if own is not None and now.chi2 > own + _FTOL:
            # The correction does not hold so far from where it was made
            map_moved = (result.x - u)[: len(model.space.free)]
            radius = np.inf if stale else _NEARER * float(np.abs(map_moved).max(initial=0.0))
            stale = False
        else:
            fell = np.inf if own is None else own - now.chi2
            u, model, own = result.x, there, now.chi2
            accepted, radius = accepted + 1, 2 * radius
            if near and accepted >= rounds and fell < _ROUGH:
                break
        result, at = search.minimum(model, u, radius)
        moved = float(np.linalg.norm(at.jacobian @ (result.x - u)))
        misfit = math.sqrt(max(1.0, at.chi2 / len(at.residual)))
        if accepted and moved < _SETTLED * misfit:
            return search.fit(model, result.x, at, result.success)
        near = moved < misfit
    at = search.linearised(model, u)
    return search.fit(model, u, at, result.success and near and accepted >= rounds)


def corrected_at(model: MeasurementModel, u: np.ndarray) -> MeasurementModel:
    """Return the model carried to the finer one at scaled coordinates u (k,)."""
    mechanics = model.mechanics.corrected(model.map(u), model.state(model.values(u)))
    return replace(model, mechanics=mechanics)


class _Search:
    """Minimises under a correction that is held, and counts the evaluations."""

    def __init__(
        self, enough: float, max_evaluations: int, callback: Callable[[float], None] | None
    ) -> None:
        self.enough, self.max_evaluations, self.callback = enough, max_evaluations, callback
        self.spent = 0
        self._latest: tuple[MeasurementModel, bytes, Linearised] | None = None

    def linearised(self, model: MeasurementModel, u: np.ndarray) -> Linearised:
        """Return the model at scaled coordinates u (k,), the last one from memory."""
        known = self._latest
        if known is None or known[0] is not model or known[1] != u.tobytes():
            self.spent += 1
            known = self._latest = (model, u.tobytes(), model.linearise(u))
        return known[2]

    def minimum(
        self, model: MeasurementModel, u: np.ndarray, radius: float
    ) -> tuple[OptimizeResult, Linearised]:
        """Minimise from u (k,), no coordinate of the map going further than a radius."""
        low, high = (bound.copy() for bound in model.bounds)
        free = len(model.space.free)
        low[:free] = np.maximum(low[:free], u[:free] - radius)
        high[:free] = np.minimum(high[:free], u[:free] + radius)
        usual = 0.5 * max(len(model.displacement_m) - len(u), 1) * _GROSS**2
        gross = usual if 0.5 * self.linearised(model, u).chi2 > usual else 0.0

        def residuals(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at = self.linearised(model, u)
            return at.residual, -at.jacobian

        def accepted(_: np.ndarray, fun: float) -> None:
            if self.callback:
                self.callback(2 * fun)

        result = minimize_gauss_newton(
            residuals,
            u,
            bounds=(low, high),
            max_step=model.longest_step(u),
            ftol=_FTOL,
            rtol=_GROSS_RTOL if gross else _RTOL,
            above=gross,
            enough=0.5 * self.enough,
            max_evaluations=self.max_evaluations,
            callback=accepted,
        )
        return result, self.linearised(model, result.x)

    def fit(
        self, model: MeasurementModel, u: np.ndarray, at: Linearised, success: bool
    ) -> JointFit:
        """Return the record of a fit that ended at u (k,)."""
        return JointFit(model.started(u), u, at, covariance(at.jacobian), success, self.spent)


def try_fit(model: MeasurementModel, stiffness: GaussianMap, **options) -> JointFit | None:
    """`fit_jointly`, or None where the start is impossible."""
    try:
        return fit_jointly(model, stiffness, **options)
    except InadmissibleError:
        return None
