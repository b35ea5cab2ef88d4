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

from dataclasses import dataclass, replace

import numpy as np

from fem import SolverError
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.effects.readings import Readings
from identify.experiment import Experiment
from identify.fit.field import LEVEL, Field
from identify.fit.field_data import FieldData, PressSums, field_derivatives
from identify.fit.field_evidence import Hyper, best_hyper
from identify.fit.field_posterior import FieldPosterior
from identify.fit.free_compliance_start import free_compliance
from identify.fit.result import FitResult, fit_result
from identify.fit.search import FitIteration, Progress
from identify.fit.settings import FREE_MAP, PRECISE, FreeMapSettings
from identify.map import FreeMap, GaussianMap, Grid, MaternField
from identify.map.initial_guess import REFERENCE_PA, apparent_modulus
from identify.map.parameters import ParameterSpace
from identify.measurement.model import Linearised, MeasurementModel
from identify.measurement.shared_error import decorrelated
from identify.optimize.result import InadmissibleError
from models import InputError


@dataclass(frozen=True)
class FreeMapIteration(FitIteration):
    """A step towards a free map, which has no named parameters; files leave the map out."""

    stiffness: FreeMap


@dataclass(frozen=True, eq=False)
class _Point:
    """A model linear around a field (g,) and scaled effects' parameters (q,)."""

    model: MeasurementModel
    field: np.ndarray
    u: np.ndarray
    at: Linearised
    sums: PressSums
    by_field: np.ndarray

    def data(self) -> FieldData:
        return FieldData.of(self.sums, self.by_field, self.field)

    def chi2(self, error: float) -> float:
        """Chi-square with the map's own error counted."""
        press, at = self.model.readings.press, self.at
        body = at.body
        own = at.by_compliance * body.compliance[press] - at.by_modulus * body.local_modulus[press]
        shared = at.whitened(error * own[:, None], press)
        r = decorrelated(at.residual, shared, press)
        return float(r @ r)


class FreeMapFit:
    """The search for a free map.

    Parameters
    ----------
    model : readings, noise, body and effects, which start from their own values; its map gives the
        level from which the field is counted
    hyper : prior and error to start from; what is `given` stays
    lengths_m : least and largest length of the prior
    """

    def __init__(
        self,
        model: MeasurementModel,
        hyper: Hyper,
        lengths_m: tuple[float, float],
        progress: Progress | None = None,
        settings: FreeMapSettings = FREE_MAP,
    ) -> None:
        start = model.space.start
        assert isinstance(start, FreeMap)
        self.settings, self.progress, self.lengths_m = settings, progress, lengths_m
        self.level, self.grid, self.hyper = float(start.log_pa[0]), start.grid, hyper
        self.history: list[FitIteration] = []
        self.spent = 0
        self._start = model

    @property
    def prior(self) -> MaternField:
        """Prior of the field, as far as it is known."""
        spread = self.settings.level_spread
        return MaternField(self.grid, self.hyper.length_m, self.hyper.spread, spread)

    def run(self) -> FitResult:
        """Search, and gather the record.

        Raises
        ------
        InadmissibleError
            The homogeneous body, from which the search starts, cannot be evaluated.
        """
        s = self.settings
        u = np.concatenate([np.empty(0), *(part.to_scaled() for part in self._start.effects)])
        point = self._point(self._start, np.zeros(len(self.grid)), u)
        point, near, message, success = self._corrected(point), False, "", False
        for number in range(s.iterations):
            if number < s.evidence_rounds:
                self.hyper = best_hyper(
                    point.sums, point.by_field, point.field, self.prior, self.hyper,
                    self.lengths_m, s,
                )  # fmt: skip
            posterior = FieldPosterior(point.data(), self.prior, self.hyper.error)
            self._accept(point, number)
            step, change = posterior.step, float(np.abs(posterior.mean - point.field).max())
            misfit = np.sqrt(max(1.0, point.chi2(self.hyper.error) / len(point.at.residual)))
            if near and number >= s.evidence_rounds and step < s.settled * misfit:
                message = f"the last step was {step:.2g} standard deviations of the readings long"
                success = True
                break
            point, share = self._stepped(point, posterior)
            if share == 0:
                message, success = "no step lowers the misfit", near
                break
            near = change * share < s.near
            if near:
                point = self._corrected(point)
        else:
            message = f"limit of {s.iterations} iterations reached"
            posterior = FieldPosterior(point.data(), self.prior, self.hyper.error)
        return self._result(point, posterior, message, success)

    def _point(self, model: MeasurementModel, field: np.ndarray, u: np.ndarray) -> _Point:
        self.spent += 1
        space = ParameterSpace(FreeMap(self.grid, self.level + field), (), ())
        model = replace(model, space=space)
        return self._linearised(model, field, u)

    def _linearised(self, model: MeasurementModel, field: np.ndarray, u: np.ndarray) -> _Point:
        at = model.linearise(u)
        sums = PressSums.of(model, at)
        return _Point(model, field, u, at, sums, field_derivatives(at, sums.of_press))

    def _corrected(self, point: _Point) -> _Point:
        """Carry the model to the finer one at a point."""
        if point.model.mechanics.fine is None:
            return point
        self.spent += 1
        return self._linearised(point.model.corrected(point.u), point.field, point.u)

    def _stepped(self, point: _Point, posterior: FieldPosterior) -> tuple[_Point, float]:
        """Follow the step as far as the misfit with the prior falls; the share, 0 for none."""
        s, error = self.settings, self.hyper.error
        to_field = posterior.mean - point.field
        to_u = posterior.data.effects.step(posterior.moved())
        low, high = point.model.unknowns.bounds
        share = first = min(1.0, s.longest_step / max(float(np.abs(to_field).max()), 1e-12))
        before = point.chi2(error) + self._cost(point)
        while share > s.shortest_step * first:
            u = np.clip(point.u + share * to_u, low, high)
            try:
                there = self._point(point.model, point.field + share * to_field, u)
            except (InadmissibleError, SolverError):
                share /= 2
                continue
            if there.chi2(error) + self._cost(there) <= before * (1 + s.worse):
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

    def _accept(self, point: _Point, number: int) -> None:
        """Keep a step of the search."""
        stiffness, at = point.model.space.start, point.at
        assert isinstance(stiffness, FreeMap)
        mean = {LEVEL: float(np.exp(stiffness.log_pa.mean()))}
        dof = max(len(at.residual) - len(point.u), 1)
        step = FreeMapIteration(number, mean, at.chi2, at.chi2 / dof, at.rms_m, stiffness)
        self.history.append(step)
        if self.progress:
            self.progress(step)

    def _result(
        self, point: _Point, posterior: FieldPosterior, message: str, success: bool
    ) -> FitResult:
        model = replace(point.model, press_error=self.hyper.error)
        at = model.linearise(point.u)
        field = Field.of(
            posterior, self.hyper, self.level, model, at, self.settings.absorbed, success
        )
        return fit_result(
            model, point.u, at, replace(PRECISE, curved_intervals=False), success=success,
            message=message, nfev=self.spent, history=tuple(self.history), field=field,
        )  # fmt: skip


def fit_free_map(
    experiment: Experiment,
    progress: Progress | None = None,
    settings: FreeMapSettings = FREE_MAP,
) -> FitResult:
    """Fit a free map and the experiment's effects to its scan, jointly.

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
    shown = presses.fit([part for part in starts if presses.shows(part.effect)])
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
        ParameterSpace(start, (), ()), tuple(parts),
    )  # fmt: skip
    first = settings.first_length * float((box[1] - box[0]).min())
    given = {"length_m": guess.length_m, "spread": guess.spread}
    hyper = Hyper(
        guess.length_m or float(np.clip(first, least, longest)),
        guess.spread or settings.first_spread,
        settings.first_error,
        tuple(name for name, value in given.items() if value is not None),
    )
    return FreeMapFit(model, hyper, (least, longest), progress, settings).run()
