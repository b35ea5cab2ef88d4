"""Errors of a fit's map at its presses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identify.fit.free_map.field_data import PressSums
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel

ROUNDS, LONGEST = 4, 0.5  # of the search for each press's own ln C, and its longest step


def map_error(model: MeasurementModel, at: Linearised) -> float:
    """Relative error of a map in a press's compliance beyond what the noise explains.

    The best change of ln C of each press alone, robustly, less its own variance and that of the
    unknowns that followed it.
    """
    press, presses = model.readings.press, model.readings.presses
    own = model.by_log_compliance(at) / at.sigma_m
    square = np.maximum(np.bincount(press, own**2, presses), 1e-30)
    change = np.bincount(press, own * at.residual, presses) / square
    freedom = max(1 - at.jacobian.shape[1] / presses, 1 / presses)
    variance = (1.4826 * np.median(np.abs(change))) ** 2 / freedom
    return float(np.sqrt(max(variance - np.median(1 / square), 0.0)))


class OwnErrors(NamedTuple):
    """Error (j,) of ln C that each press of the fit asks for beside the map, and its variance.

    `sums` are those of the readings there.
    """

    change: np.ndarray
    variance: np.ndarray
    sums: PressSums


def own_errors(
    model: MeasurementModel, there: Linearised, u: np.ndarray, error: float
) -> OwnErrors:
    """Find the presses' own errors beside a map of that relative error, by Newton's steps."""
    change, at = np.zeros(model.readings.presses), there
    for _ in range(ROUNDS):
        found, variance = PressSums.of(model, at).errors(change)
        share = error**2 / (error**2 + variance) if error else np.zeros_like(found)
        step = np.clip(share * found - change, -LONGEST, LONGEST)
        change = change + step
        at = model.around(there.body, u, np.exp(change))
    sums = PressSums.of(model, at)
    return OwnErrors(change, sums.errors(change)[1], sums)
