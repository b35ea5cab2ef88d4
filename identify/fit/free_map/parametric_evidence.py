"""Evidence of a map of few parameters, told as that of a free map is, so that both compare.

A free map leaves each press an error of its own and counts curves that the model bends wrongly
less; where an effect is missing this alone would decide for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from identify.body.response import BodyResponse
from identify.fit.free_map.field_data import FieldData
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.press_readings import PressReadings
from identify.fit.free_map.settings import FREE_MAP, FreeMapSettings
from identify.map import Grid, MaternField
from identify.measurement.model import MeasurementModel

_NO_FIELD = MaternField(Grid.over(np.array([[0.0] * 3, [1.0] * 3]), 1.0), 1.0, 0.0)


def parametric_evidence(
    model: MeasurementModel,
    body: BodyResponse,
    u: np.ndarray,
    weight: np.ndarray,
    settings: FreeMapSettings = FREE_MAP,
) -> float:
    """Return the log evidence of the fitted map and effects u (k,), each press with an error.

    The map's parameters cost half the logarithm of the number of readings each (Schwarz), the
    effects' parameters what they cost beside a free map. `weight` (j,) is that of the presses.
    """
    s, error = settings, settings.first_error
    for _ in range(s.evidence_rounds):
        readings = PressReadings.near(
            model, body, u, np.zeros(len(weight)), error, weight, s.tail, s
        )
        none = np.zeros((len(weight), len(_NO_FIELD.grid)))
        data = FieldData.of(readings.sums, none, none[0], readings.shift, readings.doubt)

        def misfit(log: float, data: FieldData = data) -> float:
            return -FieldPosterior(data, _NO_FIELD, float(np.exp(log))).log_evidence

        bounds = np.log([s.least_error, s.largest_error])
        best: Any = minimize_scalar(misfit, bounds=bounds, method="bounded")
        error, found = float(np.exp(best.x)), -float(best.fun)
    of_map = len(u) - sum(len(part.to_scaled()) for part in model.effects)
    wide = np.linalg.slogdet(data.effects.normal[:of_map, :of_map])[1] - of_map * np.log(2 * np.pi)
    told = float(np.count_nonzero(weight[model.readings.press]))
    return found + 0.5 * float(wide - of_map * np.log(told))
