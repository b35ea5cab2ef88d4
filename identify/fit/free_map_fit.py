"""Fit a free map: ln E on a grid under a smoothness prior, jointly with effects.

Gauss-Newton in data space (`identify.fit.free_map.field_posterior`): each step solves for as many
unknowns as presses have numbers, and the field follows,

    dev = C K' V (I + V' K C K' V)^-1 t,      t = V' (s - s_k) + V' K dev_k

so that nothing grows with the grid but products with its covariance. The prior's length and spread
and the map's own error are found by evidence in the first steps. Towards the end each step is
corrected towards the finer model of the body, as in `identify.fit.joint_fit`. The logarithm keeps
the modulus positive. The search begins where each place is as hard as the presses nearest to it
find the body: from an even body it was slow to reach lumps as good as rigid. A step to where the
misfit does not fall, or to a body that cannot be evaluated, is damped: directions that the readings
hardly feel go less far.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fem import SolverError
from identify.body.response import BodyResponse
from identify.fit.free_map.field import LEVEL, Field, in_sight
from identify.fit.free_map.field_data import FieldData
from identify.fit.free_map.field_evidence import Hyper, best_hyper
from identify.fit.free_map.field_posterior import DrawnField, FieldPosterior
from identify.fit.free_map.press_readings import PressReadings
from identify.fit.free_map.settings import FREE_MAP, FreeMapSettings
from identify.fit.gather import fit_result
from identify.fit.result import FitResult
from identify.fit.search import FitIteration, Progress
from identify.fit.settings import PRECISE
from identify.map import FreeMap, GaussianMap, MaternField
from identify.map.parameters import ParameterSpace
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError


@dataclass(frozen=True)
class FreeMapIteration(FitIteration):
    """A step towards a free map, which has no named parameters; files leave the map out."""

    stiffness: FreeMap


@dataclass(frozen=True, eq=False)
class _Point:
    """The body at a field (g,) and scaled effects' parameters (q,).

    `by_field` (j, g) is the derivative of s = ln C, `s` (j,) itself.
    """

    model: MeasurementModel
    field: np.ndarray
    u: np.ndarray
    body: BodyResponse
    by_field: np.ndarray
    s: np.ndarray


class FreeMapFit:
    """The search for a free map.

    Parameters
    ----------
    model : readings, noise, body and effects, which start from their own values; its map gives the
        level from which the field is counted
    hyper : prior and error to start from; what is `given` stays
    lengths_m : least and largest length of the prior
    compliance : (j,) of each press by its own readings, from which the readings are first linear;
        default that of the body there
    weight : (j,) of the presses; 0 leaves one out
    warm : the map of the model is near the end; its median is the level then
    """

    def __init__(
        self,
        model: MeasurementModel,
        hyper: Hyper,
        lengths_m: tuple[float, float],
        progress: Progress | None = None,
        settings: FreeMapSettings = FREE_MAP,
        compliance: np.ndarray | None = None,
        weight: np.ndarray | None = None,
        warm: bool = False,
    ) -> None:
        start = model.space.start
        assert isinstance(start, FreeMap)
        self.settings, self.progress, self.lengths_m = settings, progress, lengths_m
        self.level, self.grid, self.hyper = float(np.median(start.log_pa)), start.grid, hyper
        self.warm, self._field = warm, start.log_pa - self.level
        self.weight = np.ones(model.readings.presses) if weight is None else weight
        self.history: list[FitIteration] = []
        self.spent = 0
        self._start, self._compliance = model, compliance
        self._damping = settings.least_damping
        self._drawn: tuple[Hyper, DrawnField] | None = None  # of the present field

    @property
    def prior(self) -> MaternField:
        """Prior of the field, as far as it is known."""
        return self.hyper.prior(self.grid, self.settings)

    def run(self) -> FitResult:
        """Search, and gather the record.

        Raises
        ------
        InadmissibleError
            The body from which the search starts cannot be evaluated.
        """
        s = self.settings
        u = np.concatenate([np.empty(0), *(part.to_scaled() for part in self._start.effects)])
        point = self._point(self._start, self._field, u)
        first = s.evidence_rounds - 1 if self.warm else 0
        at, near, message, success = point.s, False, "", False
        pace, last = 1.0, np.inf
        if self._compliance is not None:
            moved = np.log(self._compliance / point.body.compliance)
            at = point.s + moved
        for number in range(first, s.iterations):
            readings = self._readings(point, at, number < s.evidence_rounds)
            shift = readings.shift
            if number < s.evidence_rounds:
                found = best_hyper(
                    readings.sums, point.by_field, point.field, self.prior, self.hyper,
                    self.lengths_m, s, shift, readings.doubt,
                )  # fmt: skip
                self.hyper = found if number == 0 else self.hyper.towards(found, s.longest_change)
            error = max(self.hyper.error, self._nearing(readings))
            data = FieldData.of(readings.sums, point.by_field, point.field, shift, readings.doubt)
            posterior = FieldPosterior(data, self.prior, error)
            self._accept(point, posterior, number)
            told = (self.weight > 0) & (readings.doubt == 0)
            unit = np.sqrt(error**2 + readings.variance)
            step = float(np.percentile(np.abs(posterior.step / unit)[told], 95)) / 1.96
            if near and number >= s.evidence_rounds and step < s.settled:
                message = f"the last step was {step:.2g} standard deviations of a press long"
                success = True
                break
            moved = np.clip(posterior.moved(), -s.longest_move, s.longest_move)
            at = point.s + readings.shift + moved
            if number > s.evidence_rounds:
                pace = self._pace(pace, step / last)
            last = step
            point, change = self._stepped(point, posterior, pace)
            if change == 0:
                message, success = "no step lowers the misfit", near and step < s.unfelt
                break
            near = change < s.near
            if near:
                point = self._corrected(point)
        else:
            message = f"limit of {s.iterations} iterations reached"
        return self._result(point, readings, posterior, message, success)

    def _pace(self, pace: float, ratio: float) -> float:
        """Return the share of the next step; `ratio` is the length of this one over the last.

        Where the readings are as linear as they seem, a share p leaves 1 - p of a step.
        """
        s = self.settings
        if ratio > 1 - s.falls_short * pace:
            return max(s.slowed * pace, s.slowest)
        return min(pace / s.slowed, 1.0) if ratio < 1 - s.as_promised * pace else pace

    def _point(self, model: MeasurementModel, field: np.ndarray, u: np.ndarray) -> _Point:
        self.spent += 1
        space = ParameterSpace(FreeMap(self.grid, self.level + field), (), ())
        return self._at(replace(model, space=space), field, u)

    def _at(self, model: MeasurementModel, field: np.ndarray, u: np.ndarray) -> _Point:
        body = model.body(u)
        return _Point(model, field, u, body, body.by_field(), np.log(body.compliance))

    def _corrected(self, point: _Point) -> _Point:
        """Carry the model to the finer one at a point."""
        if point.model.mechanics.fine is None:
            return point
        self.spent += 1
        return self._at(point.model.corrected(point.u), point.field, point.u)

    def _readings(self, point: _Point, at: np.ndarray, early: bool) -> PressReadings:
        """Linearise the readings near s (j,), at the best compliances beside effects and map."""
        tail = self.settings.early_tail if early else self.settings.tail
        return PressReadings.near(
            point.model, point.body, point.u, at - point.s, self.hyper.error, self.weight, tail,
            self.settings,
        )  # fmt: skip

    def _nearing(self, readings: PressReadings) -> float:
        """Error of the map that counts on the way, a share of the present misfit beyond noise."""
        told = self.weight > 0
        typical = 1.48 * float(np.median(np.abs(readings.error[told])))
        noise = float(np.median(readings.variance[told]))
        return self.settings.nearing * float(np.sqrt(max(typical**2 - noise, 0.0)))

    def _stepped(
        self, point: _Point, posterior: FieldPosterior, pace: float
    ) -> tuple[_Point, float]:
        """Step to where the misfit with the prior falls; the largest change of the field, or 0.

        A step that is too long for the body's derivatives is damped, and the next one less. That
        hardly shortens directions which the readings know well: last the whole step is shortened.
        """
        s, low, high = self.settings, *point.model.unknowns.bounds
        here = self._drawn_here(point.field)
        before = posterior.misfit(np.zeros_like(point.s)) + here.cost
        damped, shorter = s.damped, 1.0
        while shorter > s.shortest:
            share, aim, moved = posterior.damped(self._damping)
            to_field = share * (aim.field - point.field)
            largest = float(np.abs(to_field).max())
            # Damping alone hardly shortens it over a lump as good as rigid
            part = shorter * min(pace, s.longest_step / max(largest, 1e-300))
            drawn = here.towards(aim, part * share)
            u = np.clip(point.u + part * posterior.data.effects.step(moved), low, high)
            with suppress(InadmissibleError, SolverError):
                there = self._point(point.model, point.field + part * to_field, u)
                after = posterior.misfit(there.s - point.s) + drawn.cost
                if after <= before * (1 + s.worse):
                    point.model.mechanics._solutions.clear()  # large, and not asked again
                    self._drawn = self.hyper, drawn
                    self._damping = max(self._damping / s.damped, s.least_damping)
                    return there, part * largest
            if self._damping < s.most_damping:
                self._damping, damped = self._damping * damped, damped * s.more_damped
            else:
                shorter *= s.shorter
        return point, 0.0

    def _drawn_here(self, field: np.ndarray) -> DrawnField:
        """Return the present field (g,) as the prior draws it."""
        if self._drawn is None or self._drawn[0] != self.hyper:
            return DrawnField(self.prior.dual(field), field)
        return self._drawn[1]

    def _accept(self, point: _Point, posterior: FieldPosterior, number: int) -> None:
        """Keep a step of the search."""
        stiffness, at = point.model.space.start, point.model.around(point.body, point.u)
        assert isinstance(stiffness, FreeMap)
        # As the record has it: a recording is made of these steps
        mean = {LEVEL: float(np.exp(stiffness.log_pa[in_sight(posterior.share)].mean()))}
        counted = np.count_nonzero(self.weight[point.model.readings.press])
        chi2, dof = posterior.chi2, max(int(counted) - len(point.u), 1)
        step = FreeMapIteration(number, mean, chi2, chi2 / dof, at.rms_m, stiffness)
        self.history.append(step)
        if self.progress:
            self.progress(step)

    def _result(
        self, point: _Point, readings: PressReadings, posterior: FieldPosterior, message: str,
        success: bool,
    ) -> FitResult:  # fmt: skip
        uncertain = MapUncertainty(
            posterior.of_field,
            posterior.data.error_variance(self.hyper.error),
            posterior.data.here,
            self.weight,
            (self.hyper, self.lengths_m),
        )
        model = replace(point.model, map_uncertainty=uncertain)
        at = model.around(point.body, point.u)
        field = Field.of(
            posterior, point.field, self.hyper, self.level, model, at, self.settings.absorbed,
            success, readings.error, readings.doubt > 0, self.lengths_m,
        )  # fmt: skip
        return fit_result(
            model, point.u, at, replace(PRECISE, curved_intervals=False), success=success,
            message=message, nfev=self.spent, history=tuple(self.history), field=field,
        )  # fmt: skip


def refit_free_map(
    model: MeasurementModel,
    stiffness: GaussianMap,
    progress: Progress | None = None,
    compliance: np.ndarray | None = None,
) -> FitResult:
    """Fit a free map anew, with the effects of a model.

    From the present field, or from `compliance` (j,) of the presses beside these effects where it
    is given: a field that was fitted without them may be a trap.
    """
    uncertain = model.map_uncertainty
    assert uncertain is not None
    assert isinstance(stiffness, FreeMap)
    if compliance is not None:
        assert model.unit_compliance is not None
        told, points = uncertain.felt > 0, model.mechanics.contacts.points_m
        modulus = model.unit_compliance / compliance
        stiffness = FreeMap.below_presses(stiffness.grid, points[told], modulus[told])
    space = ParameterSpace(stiffness, (), ())
    hyper, lengths_m = uncertain.prior
    return FreeMapFit(
        replace(model, map_uncertainty=None, space=space), hyper, lengths_m, progress,
        compliance=compliance, weight=uncertain.felt, warm=compliance is None,
    ).run()  # fmt: skip
