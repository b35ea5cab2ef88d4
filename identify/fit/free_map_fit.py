"""Fit a free map: ln E on a grid under a smoothness prior, jointly with effects.

Gauss-Newton in data space (`identify.fit.field_posterior`): each step solves for as many unknowns
as presses have numbers, and the field follows,

    dev = C K' V (I + V' K C K' V)^-1 t,      t = V' (s - s_k) + V' K dev_k

so that nothing grows with the grid but products with its covariance. The prior's length and spread
and the map's own error are found by evidence in the first steps. Towards the end each step is
corrected towards the finer model of the body, as in `identify.fit.joint_fit`. The logarithm keeps
the modulus positive; a step to a body that cannot be evaluated is shortened.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fem import SolverError
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.body.response import BodyResponse
from identify.effects.readings import Readings
from identify.experiment import Experiment
from identify.fit.field import LEVEL, Field
from identify.fit.field_data import FieldData, PressSums
from identify.fit.field_evidence import Hyper, best_hyper
from identify.fit.field_posterior import FieldPosterior
from identify.fit.free_compliance import FreeCompliance, FreeComplianceFit
from identify.fit.free_compliance_start import free_compliance
from identify.fit.result import FitResult, fit_result
from identify.fit.search import FitIteration, Progress
from identify.fit.settings import FREE_COMPLIANCE, FREE_MAP, PRECISE, FreeMapSettings
from identify.map import FreeMap, GaussianMap, Grid, LabelledGrid, MaternField
from identify.map.initial_guess import REFERENCE_PA, apparent_modulus
from identify.map.parameters import ParameterSpace
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import EffectInModel, MeasurementModel
from identify.optimize.result import InadmissibleError
from models import InputError


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


@dataclass(frozen=True, eq=False)
class _Readings:
    """The readings linear around s (j,), with what they ask of each press of a map.

    Attributes
    ----------
    sums : weighted
    s : where they are linear
    error, variance : (j,) of each press's ln C against the map, see `PressSums.errors`
    doubt : (j,) variance of the presses with errors of their own
    """

    sums: PressSums
    s: np.ndarray
    error: np.ndarray
    variance: np.ndarray
    doubt: np.ndarray


class FreeMapFit:
    """The search for a free map.

    Parameters
    ----------
    model : readings, noise, body and effects, which start from their own values; its map gives the
        level from which the field is counted
    hyper : prior and error to start from; what is `given` stays
    lengths_m : least and largest length of the prior
    compliance : (j,) of each press by its own readings, from which the readings are first linear;
        default that of the homogeneous body
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

    @property
    def prior(self) -> MaternField:
        """Prior of the field, as far as it is known."""
        return self.hyper.prior(self.grid, self.settings)

    def run(self) -> FitResult:
        """Search, and gather the record.

        Raises
        ------
        InadmissibleError
            The homogeneous body, from which the search starts, cannot be evaluated.
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
            shift = readings.s - point.s
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
            change = float(np.abs(posterior.mean - point.field).max())
            if near and number >= s.evidence_rounds and step < s.settled:
                message = f"the last step was {step:.2g} standard deviations of a press long"
                success = True
                break
            moved = np.clip(posterior.moved(), -s.longest_move, s.longest_move)
            at = readings.s + moved
            if number > s.evidence_rounds and step > 0.8 * last:
                pace = max(s.slowed * pace, s.slowest)
            last = step
            after, share = self._stepped(point, posterior, pace)
            if share == 0:
                message, success = "no step lowers the misfit", near
                break
            point, near = after, change * share < s.near
            if near:
                point = self._corrected(point)
        else:
            message = f"limit of {s.iterations} iterations reached"
        return self._result(point, readings, posterior, message, success)

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

    def _readings(self, point: _Point, at: np.ndarray, early: bool) -> _Readings:
        """Linearise the readings near s (j,), at the best compliances beside effects and map."""
        s, model, told = self.settings, point.model, self.weight > 0
        for step in range(s.own_steps + 1):
            sums = PressSums.of(model, model.around(point.body, point.u, np.exp(at - point.s)))
            error, variance = sums.errors(at - point.s)
            typical = 1.48 * float(np.median(np.abs(error)[told]))
            size = max(self.hyper.error, typical)
            if step < s.own_steps:
                towards = (error * size**2) / (size**2 + variance) - (at - point.s)
                at = at + np.clip(towards, -s.longest_move, s.longest_move)
        count = np.bincount(model.readings.press, minlength=len(at))
        bent = np.maximum(sums.chi2 / count - 1, 0.0)
        curve = 1 / (1 + bent / FREE_COMPLIANCE.tail)
        variance = variance / curve
        unit = np.hypot(size, np.sqrt(variance))
        tail = s.early_tail if early else s.tail
        gross = np.maximum(np.abs(error) / (tail * unit), 1.0)
        doubt = (gross**2 - 1) * unit**2
        return _Readings(sums.weighted(self.weight * curve), at, error, variance, doubt)

    def _nearing(self, readings: _Readings) -> float:
        """Error of the map that counts on the way, a share of the present misfit beyond noise."""
        told = self.weight > 0
        typical = 1.48 * float(np.median(np.abs(readings.error[told])))
        noise = float(np.median(readings.variance[told]))
        return self.settings.nearing * float(np.sqrt(max(typical**2 - noise, 0.0)))

    def _stepped(
        self, point: _Point, posterior: FieldPosterior, pace: float
    ) -> tuple[_Point, float]:
        """Follow the step as far as the misfit with the prior falls; the share, 0 for none."""
        s = self.settings
        to_field = posterior.mean - point.field
        to_u = posterior.data.effects.step(posterior.moved())
        low, high = point.model.unknowns.bounds
        share = first = min(pace, s.longest_step / max(float(np.abs(to_field).max()), 1e-12))
        before = posterior.misfit(point.s - point.s) + self._cost(point)
        while share > s.shortest_step * first:
            u = np.clip(point.u + share * to_u, low, high)
            try:
                there = self._point(point.model, point.field + share * to_field, u)
            except (InadmissibleError, SolverError):
                share /= 2
                continue
            if posterior.misfit(there.s - point.s) + self._cost(there) <= before * (1 + s.worse):
                point.model.mechanics._solutions.clear()  # large, and not asked again
                return there, share
            share /= 2
        return point, 0.0

    def _cost(self, point: _Point) -> float:
        """Least square of the prior's distance of a field with the point's predictions."""
        of_s = self.prior.product(point.by_field) @ point.by_field.T
        of_s[np.diag_indices_from(of_s)] += 1e-8 * np.trace(of_s) / len(of_s)
        offset = point.by_field @ point.field
        return float(offset @ np.linalg.solve(of_s, offset))

    def _accept(self, point: _Point, posterior: FieldPosterior, number: int) -> None:
        """Keep a step of the search."""
        stiffness, at = point.model.space.start, point.model.around(point.body, point.u)
        assert isinstance(stiffness, FreeMap)
        mean = {LEVEL: float(np.exp(stiffness.log_pa.mean()))}
        chi2, dof = posterior.chi2, max(len(at.residual) - len(point.u), 1)
        step = FreeMapIteration(number, mean, chi2, chi2 / dof, at.rms_m, stiffness)
        self.history.append(step)
        if self.progress:
            self.progress(step)

    def _result(
        self, point: _Point, readings: _Readings, posterior: FieldPosterior, message: str,
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
            posterior, self.hyper, self.level, model, at, self.settings.absorbed, success,
            readings.error, readings.doubt > 0, self.lengths_m,
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

    From the present field, or where `compliance` (j,) of the presses beside these effects is given
    from the homogeneous body: a field that was fitted without them may be a trap.
    """
    uncertain = model.map_uncertainty
    assert uncertain is not None
    assert isinstance(stiffness, FreeMap)
    if compliance is not None:
        assert model.unit_compliance is not None
        level = np.log(np.median((model.unit_compliance / compliance)[uncertain.felt > 0]))
        stiffness = FreeMap(stiffness.grid, np.full_like(stiffness.log_pa, level))
    space = ParameterSpace(stiffness, (), ())
    hyper, lengths_m = uncertain.prior
    return FreeMapFit(
        replace(model, map_uncertainty=None, space=space), hyper, lengths_m, progress,
        compliance=compliance, weight=uncertain.felt, warm=compliance is None,
    ).run()  # fmt: skip


def _shown(
    presses: FreeCompliance, parts: list[EffectInModel], weight: np.ndarray
) -> FreeComplianceFit:
    """Fit the presses alone, from the effects' starts and from ordinary sizes; the better one."""
    best = presses.fit(parts, weight=weight)
    for size in (3.0, 10.0) if parts else ():
        begun = []
        for part in parts:
            start = dict(part.start)
            for p in part.parameters:
                if p.null is not None and start[p.name] == p.null:
                    away = -1 if p.upper == p.null else 1
                    start[p.name] = min(max(p.null + away * size * p.typical, p.lower), p.upper)
            begun.append(replace(part, start=start))
        with suppress(InadmissibleError), np.errstate(over="ignore", invalid="ignore"):
            other = presses.fit(begun, weight=weight)
            if robust_sum(other, weight) < robust_sum(best, weight):
                best = other
    return best


def robust_sum(fit: FreeComplianceFit, weight: np.ndarray) -> float:
    """Return the misfit of the presses with a weight."""
    squares, count = fit.by_press
    most = fit.settings.tail * np.maximum(count, 1)
    return float(weight @ (most * np.log1p(squares / most)))


def fit_free_map(
    experiment: Experiment,
    progress: Progress | None = None,
    settings: FreeMapSettings = FREE_MAP,
    weight: np.ndarray | None = None,
) -> FitResult:
    """Fit a free map and the experiment's effects to its scan, jointly.

    Parameters
    ----------
    weight : (j,) of the presses; those of 0 are left out

    Raises
    ------
    InputError
        A length of the prior that the grid or the cells of the body cannot show.
    """
    guess, body = experiment.map.field, experiment.body
    assert guess is not None
    box = body.coarse.mesh.box_m
    spacing = float(np.cbrt(np.prod(box[1] - box[0]) / settings.grid_points))
    grid = Grid.over(box, spacing)
    if guess.regions is not None:
        grid = LabelledGrid(grid.lower_m, grid.spacing_m, grid.counts, guess.regions.cropped(box))
    cell = float(np.cbrt(6 * np.mean(body.coarse.mesh.cell_volumes)))  # six cells make a cube
    least = max(settings.finest * max(grid.spacing_m), settings.finest_cell * cell)
    longest = settings.longest * float((box[1] - box[0]).max())
    if guess.length_m is not None and not least <= guess.length_m <= longest:
        raise InputError(
            f"study, key map.length_m: found {guess.length_m:g} m, expected {least:.2g} to "
            f"{longest:.2g} m, which the finite elements of this body can show; change it, make "
            "body.cell_size_m smaller, or leave it out to have it found"
        )
    used = experiment.scan.used()
    readings = Readings.of(experiment.scan)
    mechanics = BodyMechanics.of(body.coarse, body.fine)
    homogeneous = compliance(body.coarse, GaussianMap(REFERENCE_PA))
    # Without effects each press's own slope, with them its compliance beside them
    presses = free_compliance(experiment.scan, body, experiment.noise)
    starts = [presses.begun(e, dict(initial)) for e, initial in experiment.effects]
    weight = presses.felt * (1.0 if weight is None else weight)
    shown = _shown(presses, [part for part in starts if presses.shows(part.effect)], weight)
    usual = float(np.median(shown.compliance[weight > 0]))
    weight = weight * (shown.compliance < shown.settings.softest * usual)
    shown = _shown(presses, [part for part in starts if presses.shows(part.effect)], weight)
    parts = [
        part
        if part.effect.name not in shown.values or given
        else presses.part(part.effect, shown.values[part.effect.name])
        for part, (_, given) in zip(starts, experiment.effects, strict=True)
    ]
    apparent = apparent_modulus(
        shown.compliance, used.contact_points, used.contact_directions, homogeneous
    ).modulus_pa
    start = FreeMap(grid, np.full(len(grid), np.log(np.median(apparent))))
    model = MeasurementModel(
        readings, used.displacement_m, experiment.noise, mechanics,
        ParameterSpace(start, (), ()), tuple(parts), unit_compliance=REFERENCE_PA * homogeneous,
    )  # fmt: skip
    first = settings.first_length * float((box[1] - box[0]).min())
    given = {"length_m": guess.length_m, "spread": guess.spread}
    hyper = Hyper(
        guess.length_m or float(np.clip(first, least, longest)),
        guess.spread or settings.first_spread,
        settings.first_error,
        tuple(name for name, value in given.items() if value is not None),
    )
    return FreeMapFit(
        model, hyper, (least, longest), progress, settings, shown.compliance, weight
    ).run()
