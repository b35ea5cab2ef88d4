"""Begin the fit of a free map to a scan: its grid, the prior and where the presses alone put it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from fem import PalpationModel
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.effects.readings import Readings
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.free_compliance_start import free_compliance
from identify.fit.free_map.field_evidence import STEEP, Hyper
from identify.fit.free_map.settings import FREE_MAP, FreeMapSettings
from identify.fit.free_map_fit import FreeMapFit
from identify.fit.result import FitResult
from identify.fit.search import Progress
from identify.map import FreeMap, GaussianMap, Grid, LabelledGrid
from identify.map.initial_guess import REFERENCE_PA, apparent_modulus
from identify.map.parameters import ParameterSpace
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from models import InputError, LabelVolume


def fit_free_map(
    experiment: PlacedExperiment,
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
    grid = _grid(guess.regions, box if guess.regions else body.coarse.probed_m, settings)
    least, longest = lengths_m = _lengths_m(guess.length_m, grid, body.coarse, settings)
    used = experiment.scan.used()
    readings = Readings.of(experiment.scan)
    mechanics = BodyMechanics.of(body.coarse, body.fine)
    homogeneous = compliance(body.coarse, GaussianMap(REFERENCE_PA))
    # Without effects each press's own slope, with them its compliance beside them
    presses = free_compliance(experiment.scan, body, experiment.noise)
    starts = [presses.begun(e, dict(initial)) for e, initial in experiment.effects]
    shown, weight = _shown_by_presses(presses, starts, weight)
    parts = [
        part
        if part.effect.name not in shown.values or given
        else presses.part(part.effect, shown.values[part.effect.name])
        for part, (_, given) in zip(starts, experiment.effects, strict=True)
    ]
    apparent = apparent_modulus(
        shown.compliance, used.contact_points, used.contact_directions, homogeneous
    ).modulus_pa
    told = weight > 0
    start = FreeMap.below_presses(grid, used.contact_points[told], apparent[told])
    model = MeasurementModel(
        readings, used.displacement_m, experiment.noise, mechanics,
        ParameterSpace(start, (), ()), tuple(parts), unit_compliance=REFERENCE_PA * homogeneous,
    )  # fmt: skip
    first = settings.first_length * float(np.ptp(body.coarse.probed_m, axis=0).min())
    given = {"length_m": guess.length_m, "spread": guess.spread, "smoothness": guess.smoothness}
    hyper = Hyper(
        guess.length_m or float(np.clip(first, least, longest)),
        guess.spread or settings.first_spread,
        settings.first_error,
        tuple(name for name, value in given.items() if value is not None),
        guess.smoothness or STEEP,
    )
    return FreeMapFit(model, hyper, lengths_m, progress, settings, shown.compliance, weight).run()


def _grid(regions: LabelVolume | None, box_m: np.ndarray, settings: FreeMapSettings) -> Grid:
    """Grid of the field over a body of that box (2, 3), with the regions that a study names."""
    grid = Grid.over(box_m, float(np.cbrt(np.prod(box_m[1] - box_m[0]) / settings.grid_points)))
    if regions is None:
        return grid
    return LabelledGrid(grid.lower_m, grid.spacing_m, grid.counts, regions.cropped(box_m))


def _lengths_m(
    stated_m: float | None, grid: Grid, model: PalpationModel, settings: FreeMapSettings
) -> tuple[float, float]:
    """Least and largest length of the prior that grid and cells show; refuse another stated one."""
    mesh, (low, high) = model.mesh, model.probed_m
    centres = mesh.centres_m
    shown = ((centres >= low) & (centres <= high)).all(axis=1)
    cell = float(np.cbrt(6 * np.mean(mesh.cell_volumes[shown])))  # six cells make a cube
    least = max(settings.finest * max(grid.spacing_m), settings.finest_cell * cell)
    longest = settings.longest * float((high - low).max())
    if stated_m is not None and not least <= stated_m <= longest:
        raise InputError(
            f"study, key map.length_m: found {stated_m:g} m, expected {least:.2g} to "
            f"{longest:.2g} m, which the finite elements of this body can show; change it, make "
            "body.cell_size_m smaller, or leave it out to have it found"
        )
    return least, longest


def _shown_by_presses(
    presses: FreeCompliance, starts: list[EffectInModel], weight: np.ndarray | None
) -> tuple[FreeComplianceFit, np.ndarray]:
    """Fit the presses alone; the fit, and their weight (j,) without those that feel no body."""
    weight = presses.felt * (1.0 if weight is None else weight)
    parts = [part for part in starts if presses.shows(part.effect)]
    shown = _shown(presses, parts, weight)
    usual = float(np.median(shown.compliance[weight > 0]))
    weight = weight * (shown.compliance < shown.settings.softest * usual)
    return _shown(presses, parts, weight), weight


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
            if _robust_sum(other, weight) < _robust_sum(best, weight):
                best = other
    return best


def _robust_sum(fit: FreeComplianceFit, weight: np.ndarray) -> float:
    """Return the misfit of the presses with a weight."""
    squares, count = fit.by_press
    most = fit.settings.tail * np.maximum(count, 1)
    return float(weight @ (most * np.log1p(squares / most)))
