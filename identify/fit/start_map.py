"""The map of an experiment, with its number of inclusions, guesses and noise."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identify.fit.free_compliance_start import free_compliance, straight
from identify.fit.free_map.settings import FREE_MAP
from identify.fit.free_map_start import fit_free_map
from identify.fit.map_fit import fit_scan
from identify.fit.result import FitResult
from identify.fit.search import FitIteration
from identify.fit.settings import PRECISE, FitSettings
from identify.map.gaussian_map import GaussianMap
from identify.measurement.experiment import PlacedExperiment, different_presses
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.optimizers import Optimizer


def fit_map(
    experiment: PlacedExperiment,
    optimizer: Optimizer = minimize_gauss_newton,
    callback: Callable[[FitIteration], None] | None = None,
    rough: bool = False,
    settings: FitSettings = PRECISE,
) -> FitResult:
    """Fit the map alone.

    A `rough` fit is a start for another one: carried to the finer model at its start alone, with
    simple intervals, of readings that are straight lines (those of a ball are made straight for
    it), of a free map by few steps.

    With `inclusions = "auto"` their number rises from none until the Bayesian information
    criterion no longer falls. A free map is fitted jointly with the experiment's effects.
    """
    scan, body, guess = experiment.scan, experiment.body, experiment.map
    if guess.field is not None:
        few = FREE_MAP.evidence_rounds + FREE_MAP.rough_steps
        return fit_free_map(experiment, callback, replace(FREE_MAP, iterations=few) if rough
                            else FREE_MAP)  # fmt: skip
    if body.coarse.contacts.profile == "hertz" and not rough:
        presses = free_compliance(scan, body, experiment.noise)
        lines = replace(experiment, scan=straight(scan, presses.fit(())))
        first = fit_map(lines, optimizer, callback, rough=True, settings=settings).map
        free = [name for name in first.names if name not in guess.fixed]
        return fit_scan(
            scan, body.coarse, noise=experiment.noise, fine_model=body.fine, start=first, free=free,
            straight=False, optimizer=optimizer, callback=callback, settings=settings,
        )  # fmt: skip
    if guess.inclusions == "auto":
        start = _best_number(experiment, settings)
        free = [name for name in start.names if name not in guess.fixed]
    else:
        start, free = _known_start(experiment, guess.inclusions, settings)
    return fit_scan(
        scan, body.coarse, inclusions=0 if guess.inclusions == "auto" else guess.inclusions,
        noise=experiment.noise, search_model=body.search if start is None else None,
        fine_model=body.fine, start=start, free=free, optimizer=optimizer, callback=callback,
        settings=replace(settings, rounds=0, curved_intervals=False) if rough else settings,
    )  # fmt: skip


def _known_start(
    experiment: PlacedExperiment, inclusions: int, settings: FitSettings
) -> tuple[GaussianMap | None, list[str] | None]:
    """Return a map with the values that the study states and its free names; None if it has none.

    Open values start at the end of a quick fit.
    """
    guess = experiment.map
    names = GaussianMap.from_values(np.ones(1 + 5 * inclusions)).names
    stated = {**guess.initial, **guess.fixed}
    known = {name: value for name, value in stated.items() if name in names}
    if not known:
        return None, None
    values = dict.fromkeys(names, np.nan)
    if set(known) != set(names):
        quick = _quick_fit(experiment, inclusions, settings).map
        values = dict(zip(names, quick.values, strict=True))
    start = GaussianMap.from_values(np.array(list((values | known).values())))
    return start, [name for name in names if name not in guess.fixed]


def _quick_fit(
    experiment: PlacedExperiment,
    inclusions: int,
    settings: FitSettings,
    start: GaussianMap | None = None,
    free: list[str] | None = None,
) -> FitResult:
    body = experiment.body
    return fit_scan(
        experiment.scan, body.coarse, inclusions=inclusions, noise=experiment.noise,
        search_model=body.search if start is None else None, start=start, free=free,
        settings=settings,
    )  # fmt: skip


def _best_number(experiment: PlacedExperiment, settings: FitSettings) -> GaussianMap:
    """Return the map of the number of inclusions with the least information criterion."""
    used = experiment.scan.used()
    best, least = None, np.inf
    bearable = (different_presses(used) - 1) // 5  # as many unknowns as presses
    for inclusions in range(min(settings.most_inclusions, bearable) + 1):
        fit = _quick_fit(
            experiment, inclusions, settings, *_known_start(experiment, inclusions, settings)
        )
        criterion = fit.chi2 + len(fit.covariance_names) * np.log(len(used))
        if best is not None and criterion > least:
            break
        best, least = fit.map, criterion
    assert isinstance(best, GaussianMap)  # the loop has run
    return best
