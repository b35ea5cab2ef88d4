"""The map that explains a placed scan, with the inclusions, guesses and noise of its study."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identify.body.body_model import BodyModel
from identify.fit.map_fit import fit_scan
from identify.fit.number_of_inclusions import best_number
from identify.fit.result import FitResult
from identify.fit.search import FitIteration
from identify.fit.settings import PRECISE
from identify.map.gaussian_map import GaussianMap
from identify.measurement.noise import Noise, scan_noise
from identify.optimize.optimizers import OPTIMIZERS
from palpmap.study.frame import frame_shift_m
from palpmap.study.placement import Placement
from palpmap.study.study import Study


def fit_study(
    study: Study,
    placement: Placement,
    body: BodyModel,
    optimizer: str = "gauss-newton",
    callback: Callable[[FitIteration], None] | None = None,
    rough: bool = False,
    noise: Noise | None = None,
) -> FitResult:
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
    settings = replace(PRECISE, curved_intervals=not rough)
    if study.map.inclusions == "auto":
        start = best_number(scan, body, noise)
        return fit_scan(
            scan, body.coarse, noise=noise, fine_model=fine, start=start,
            optimizer=method, callback=callback,
            settings=settings,
        )  # fmt: skip
    known = {**study.map.initial, **study.map.fixed}
    if not known:
        return fit_scan(
            scan, body.coarse, inclusions=study.map.inclusions, noise=noise,
            search_model=body.search, fine_model=fine, optimizer=method, callback=callback,
            settings=settings,
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
            values[index] = known[name] - frame_shift_m(name, placement.origin_m)
    free = [name for name in names if name not in study.map.fixed]
    return fit_scan(
        scan, body.coarse, noise=noise, fine_model=fine, optimizer=method,
        start=GaussianMap.from_values(values), free=free, callback=callback,
        settings=settings,
    )  # fmt: skip
