"""Readings of a scan, linear around each press's own compliance, with their demand on a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identify.body.response import BodyResponse
from identify.fit.free_map.field_data import PressSums
from identify.fit.free_map.settings import FREE_MAP, FreeMapSettings
from identify.measurement.model import MeasurementModel


@dataclass(frozen=True)
class PressReadings:
    """Readings linear at the compliances C of the presses, with their demand on each of a map.

    A press whose curve the model bends wrongly counts less, as its own compliance is less sure.

    Attributes
    ----------
    sums : weighted
    shift : (j,) ln C where they are linear, less the map's
    error, variance : (j,) of each press's ln C against the map, see `PressSums.errors`
    doubt : (j,) variance of the presses with errors of their own
    """

    sums: PressSums
    shift: np.ndarray
    error: np.ndarray
    variance: np.ndarray
    doubt: np.ndarray

    @classmethod
    def near(
        cls,
        model: MeasurementModel,
        body: BodyResponse,
        u: np.ndarray,
        shift: np.ndarray,
        error_of_map: float,
        weight: np.ndarray,
        tail: float,
        settings: FreeMapSettings = FREE_MAP,
    ) -> PressReadings:
        """Linearise at the best compliances beside effects and map, from a shift (j,) on.

        Parameters
        ----------
        error_of_map : relative, of each press's compliance
        weight : (j,) of the presses
        tail : standard deviations from which on a press has an error of its own
        """
        s, told = settings, weight > 0
        for step in range(s.own_steps + 1):
            sums = PressSums.of(model, model.around(body, u, np.exp(shift)))
            error, variance = sums.errors(shift)
            typical = 1.48 * float(np.median(np.abs(error)[told]))
            size = max(error_of_map, typical)
            if step < s.own_steps:
                towards = (error * size**2) / (size**2 + variance) - shift
                shift = shift + np.clip(towards, -s.longest_move, s.longest_move)
        count = np.bincount(model.readings.press, minlength=len(shift))
        bent = np.maximum(sums.chi2 / count - 1, 0.0)
        curve = 1 / (1 + bent / s.bent)
        variance = variance / curve
        unit = np.hypot(size, np.sqrt(variance))
        gross = np.maximum(np.abs(error) / (tail * unit), 1.0)
        return cls(sums.weighted(weight * curve), shift, error, variance, (gross**2 - 1) * unit**2)
