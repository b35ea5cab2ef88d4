"""Curves that only rise, the free form of a law that bends one way: splines with amplitudes >= 0.

A rise S(x) over a level x is a sum of I-splines with amplitudes that are not negative: it begins at
0 without a jump, and its slope is linear between knots at 0, 1/3, 2/3 and 1. A law with the slope
1 + S, or 1 / (1 + S), bends one way and never turns back.

Source: J. O. Ramsay, Monotone regression splines in action, Statist. Sci. 3 (1988) 425-441.
"""

from collections.abc import Sequence

import numba
import numpy as np

PLACES = ("at the start", "at a third", "at two thirds", "at the end")
"""Knots in words; the amplitude of each is the rise of S by the hat of its slope there."""

_AREAS = np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6])  # of the hats
_NODES, _WEIGHTS = (array / 2 for array in np.polynomial.legendre.leggauss(16))


def risen(level: np.ndarray, rises: Sequence[float]) -> np.ndarray:
    """Rise S (m,) at levels (m,), constant from 1 on.

    Parameters
    ----------
    rises : by the hats of the slope at even knots from 0 to 1, >= 0

    >>> risen(np.array([0.0, 0.5, 1.0, 2.0]), (0.25, 0.5, 0.25))
    array([0. , 0.5, 1. , 1. ])
    """
    knots = np.linspace(0.0, 1.0, len(rises))
    width = knots[1]
    areas = np.full(len(rises), width)
    areas[[0, -1]] /= 2
    slopes = np.asarray(rises, float) / areas
    before = np.append(0.0, np.cumsum((slopes[1:] + slopes[:-1]) / 2 * width))
    within = np.clip(level, 0.0, 1.0)
    piece = np.clip(np.searchsorted(knots, within, "right") - 1, 0, len(knots) - 2)
    x = within - knots[piece]
    return before[piece] + (slopes[piece] + np.diff(slopes)[piece] / width * x / 2) * x


def bent(level: np.ndarray, rises: Sequence[float], stiffer: bool) -> np.ndarray:
    """Integral (m,) from 0 to a level (m,) of 1 / (1 + S), or of 1 + S.

    Straight below 0, where noise alone is, and with the last slope of S beyond 1.

    Parameters
    ----------
    rises : one for each of `PLACES`, >= 0
    stiffer : the former
    """
    slopes = np.asarray(rises, float) / _AREAS
    return _integral(np.ascontiguousarray(level, float), slopes, stiffer, _NODES, _WEIGHTS)


@numba.njit(cache=True)
def _integral(level, slopes, stiffer, nodes, weights):
    found = np.empty(len(level))
    pieces = len(slopes) - 1
    for i in range(len(level)):
        if level[i] <= 0:
            found[i] = level[i]
            continue
        total, start = 0.0, 0.0  # start: of S at the piece's first knot
        for piece in range(pieces + 1):  # the last one lies beyond 1
            low = piece / pieces
            if level[i] <= low:
                break
            high = min(level[i], (piece + 1) / pieces) if piece < pieces else level[i]
            after = slopes[min(piece + 1, pieces)]
            slope, growth = slopes[piece], (after - slopes[piece]) * pieces
            for q in range(len(nodes)):
                x = (0.5 + nodes[q]) * (high - low)
                rise = start + slope * x + 0.5 * growth * x * x
                value = 1 / (1 + rise) if stiffer else 1 + rise
                total += weights[q] * (high - low) * value
            start += 0.5 * (slope + after) / pieces
        found[i] = total
    return found
