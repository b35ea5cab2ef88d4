"""Heights over the surface: smooth functions of the place, by Legendre's polynomials."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.polynomial import legendre

from identify.effects.base import Effect, EffectParameter, Values
from identify.effects.readings import Readings
from identify.effects.units import length

_PRESSES_PER_TERM = 1.5  # fewer, and the heights follow the single presses


class Height(Effect):
    """Base of heights added to every displacement, one class for each degree.

    Class attributes
    ----------------
    degree : total degree of its terms
    """

    degree: ClassVar[int]
    source = "derivation: height of a surface, by the orders of the place"
    needs = ("several forces", "several presses")

    def untestable(self, readings: Readings) -> str | None:
        """Refuse scans with hardly more presses than terms."""
        least = math.ceil(_PRESSES_PER_TERM * len(self.parameters))
        if readings.presses < least:
            return f"the scan has only {readings.presses} presses, {least} are needed"
        return super().untestable(readings)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say between which heights the surface lies."""
        height = heights(readings, self.degree, [values[p.name] for p in self.parameters])
        lowest, highest = float(height.min()), float(height.max())
        return (
            f"Displacements are off by {length(lowest)} at some places and by {length(highest)} "
            f"at others, smoothly, at every force: the surface departs by "
            f"{length(highest - lowest)} from the shape from which travel is counted."
        )


def degrees(most: int) -> tuple[tuple[int, int], ...]:
    """Degrees along both directions of all terms up to a total one.

    >>> degrees(1)
    ((0, 0), (1, 0), (0, 1))
    """
    return tuple((total - j, j) for total in range(most + 1) for j in range(total + 1))


def height_parameters(most: int) -> tuple[EffectParameter, ...]:
    """Amplitudes of the terms up to a total degree.

    >>> [p.name for p in height_parameters(1)]
    ['h_00_m', 'h_10_m', 'h_01_m']
    """
    return tuple(
        EffectParameter(f"h_{i}{j}_m", "m", f"height of the term of degrees {i} and {j}",
                        0.0, -0.01, 0.01, 1e-4)
        for i, j in degrees(most)
    )  # fmt: skip


def heights(readings: Readings, most: int, sizes_m: Sequence[float]) -> np.ndarray:
    """Height (m,) at each reading: the sum of the terms up to a total degree.

    Places are shares of the scan's half width, along its two widest directions.
    """
    return _terms(readings, most) @ np.asarray(sizes_m)


@lru_cache(maxsize=4)
def _terms(readings: Readings, most: int) -> np.ndarray:
    """Terms (m, t) of a height of 1 at the readings; kept, as a search asks for them again."""
    along_x, along_y = (legendre.legvander(x, most) for x in readings.in_plane.T)
    return np.column_stack([along_x[:, i] * along_y[:, j] for i, j in degrees(most)])
