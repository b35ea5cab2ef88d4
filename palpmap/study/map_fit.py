"""The map that explains a placed scan, with the inclusions, guesses and noise of its study."""

from collections.abc import Callable

import numpy as np

from identify.fit.map_fit import fit_scan
from identify.fit.result import Fit, FitIteration
from identify.map.gaussian_map import GaussianMap
from identify.measurement.noise import Noise, scan_noise
from identify.optimize.optimizers import OPTIMIZERS
from models.scan import Scan
from palpmap.study.body_model import BodyModel
from palpmap.study.checks import different_presses
from palpmap.study.placement import Placement
from palpmap.study.study import Study

MOST_INCLUSIONS = 4
AXES = {"x_m": 0, "y_m": 1, "z_m": 2}


def fit_study(
    study: Study,
    placement: Placement,
    body: BodyModel,
    optimizer: str = "gauss-newton",
    callback: Callable[[FitIteration], None] | None = None,
    rough: bool = False,
    noise: Noise | None = None,
) -> Fit:
    """Fit a placed scan with the inclusions, guesses and noise that the study states.

    The noise is what the study states, or estimated from the scan, unless it is given. A `rough`
    fit is a start for another one: without the finer model, with simple intervals.

    With `inclusions = "auto"` their number rises from none until the Bayesian information
    criterion no longer falls.
    """
    scan = placement.scan
    noise = noise or scan_noise(scan.used(), study.noise.displacement_m, study.noise.force_n)
    method = OPTIMIZERS[optimizer]
    fine = None if rough else body.fine
    if study.map.inclusions == "auto":
        start = _best_number(scan, body, noise)
        return fit_scan(
            scan, body.coarse, noise=noise, fine_model=fine, start=start,
            optimizer=method, callback=callback,
            curved_intervals=not rough,
        )  # fmt: skip
    known = {**study.map.initial, **study.map.fixed}
    if not known:
        return fit_scan(
            scan, body.coarse, inclusions=study.map.inclusions, noise=noise,
            search_model=body.search, fine_model=fine, optimizer=method, callback=callback,
            curved_intervals=not rough,
        )  # fmt: skip
    names = GaussianMap.from_values(np.ones(1 + 5 * study.map.inclusions)).names
    if set(known) == set(names):
        values = np.empty(len(names))
    else:  # what the study leaves open starts where a quick fit ends
        quick = fit_scan(
            scan, body.coarse, inclusions=study.map.inclusions, noise=noise,
            search_model=body.search,
        ).map  # fmt: skip
        values = np.array(quick.values)
    for index, name in enumerate(names):
        if name in known:  # the study speaks in the scan's frame
            axis = AXES.get(name.split(".")[-1])
            shift = 0.0 if axis is None else placement.origin_m[axis]
            values[index] = known[name] - shift
    free = [name for name in names if name not in study.map.fixed]
    return fit_scan(
        scan, body.coarse, noise=noise, fine_model=fine, optimizer=method,
        start=GaussianMap.from_values(values), free=free, callback=callback,
        curved_intervals=not rough,
    )  # fmt: skip


def _best_number(scan: Scan, body: BodyModel, noise: Noise) -> GaussianMap:
    """Return the map of the number of inclusions with the least information criterion."""
    rows = np.log(len(scan.used()))
    best, least = None, np.inf
    bearable = (different_presses(scan.used()) - 1) // 5  # as many unknowns as presses
    for inclusions in range(min(MOST_INCLUSIONS, bearable) + 1):
        fit = fit_scan(
            scan, body.coarse, inclusions=inclusions, noise=noise, search_model=body.search
        )
        criterion = fit.chi2 + len(fit.covariance_names) * rows
        if best is not None and criterion > least:
            break
        best, least = fit.map, criterion
    assert best is not None  # the loop has run
    return best
