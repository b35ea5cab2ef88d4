"""Slopes of travel over force along a search, the part of a memory found once.

Beside an effect with a memory a slope takes two predictions for each reading of a press
(`Chain.by_force`), in which the elastic travel changes with every compliance and force that are
tried, but what the effect makes of its slope hardly does.
"""

import numpy as np

from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.settings import LATENT_FORCE, LatentForceSettings


class KeptSlope:
    """Slope of travel over force of a chain, for nearby points of the same values of its effects.

    The ratio of the whole slope to that of the elastic travel is kept until a force has moved by
    more than `LatentForceSettings.kept`. Without an effect that may remember nothing is kept.
    """

    def __init__(self, chain: Chain, settings: LatentForceSettings = LATENT_FORCE) -> None:
        self._chain = chain
        self._most_n = settings.kept * chain.readings.largest_force_n
        self._ratio = self._found_at_n = np.zeros(0)

    def __call__(self, at: OperatingPoint) -> np.ndarray:
        """Return the slope (m,), m/N."""
        chain = self._chain
        if not chain.feels_others:
            return chain.by_force(at)
        elastic = chain.elastic_slope(at)
        if len(self._ratio) and np.abs(at.force_n - self._found_at_n).max() <= self._most_n:
            return self._ratio * elastic
        slope = chain.by_force(at)
        self._ratio = np.divide(slope, elastic, out=np.zeros_like(slope), where=elastic != 0)
        self._found_at_n = at.force_n
        return slope
