"""The number of inclusions that a scan supports, by the Bayesian information criterion."""

import numpy as np

from identify.body.body_model import BodyModel
from identify.fit.map_fit import fit_scan
from identify.map.gaussian_map import GaussianMap
from identify.measurement.noise import Noise
from models.scan import Scan

MOST_INCLUSIONS = 4
_SAME_M, _SAME_DIRECTION = 1e-4, 1e-2  # presses that differ by less are repeats


def best_number(scan: Scan, body: BodyModel, noise: Noise) -> GaussianMap:
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


def different_presses(scan: Scan) -> int:
    """Return the number of presses that differ in place, direction or tip radius."""
    kinds = np.column_stack(
        [
            scan.contact_points / _SAME_M,
            scan.contact_directions / _SAME_DIRECTION,
            scan.contact_radii / _SAME_M,
        ]
    )
    return len(np.unique(np.rint(kinds), axis=0))
