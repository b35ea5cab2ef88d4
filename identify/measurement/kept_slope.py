"""Slopes of travel over force at nearby forces, the part of a memory found once.

Beside an effect with a memory a slope takes a prediction for each reading of a press
(`Chain.by_force`). The slope of a ball's elastic travel changes much with a small force, but what
such an effect makes of it hardly does.
"""

import numpy as np

from identify.measurement.chain import Chain, OperatingPoint


class KeptSlope:
    """Slope of travel over force of a chain, for nearby forces and all else the same.

    The ratio of the whole slope to that of the elastic travel is kept from the first forces on.
    Without an effect that may remember nothing is kept.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._ratio = np.zeros(0)

    def __call__(self, at: OperatingPoint) -> np.ndarray:
        """Return the slope (m,), m/N."""
        if not self._chain.feels_others:
            return self._chain.by_force(at)
        elastic = self._chain.elastic_slope(at)
        if len(self._ratio):
            return self._ratio * elastic
        slope = self._chain.by_force(at)
        self._ratio = np.divide(slope, elastic, out=np.zeros_like(slope), where=elastic != 0)
        return slope
