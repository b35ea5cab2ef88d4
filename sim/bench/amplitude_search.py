"""Amplitude at which an effect makes up a wanted share of the signal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim.bench.press import Planted, Pressed, press
from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect

TOLERANCE = 0.01
ROUNDS = 14


def size_of(planted: Pressed, plain: Pressed) -> float:
    """Size of an effect: rms of its change relative to the signal's rms, over both columns."""
    parts = [
        np.sum((a - b) ** 2) / np.sum(b**2)
        for a, b in (
            (planted.force_n, plain.force_n),
            (planted.displacement_m, plain.displacement_m),
        )
    ]
    return float(np.sqrt(sum(parts)))


def amplitude_for(
    bench: Bench,
    effect: HiddenEffect,
    drawn: Mapping[str, float],
    size: float,
    others: tuple[Planted, ...] = (),
    sign: float = 1.0,
) -> tuple[Planted, float]:
    """Search the amplitude that gives an effect a size.

    Parameters
    ----------
    drawn : the effect's other values
    size : rms(with - without)/rms(without)
    others : effects that are there too; the size is that of the further change
    sign : 1 or -1, of the amplitude

    Returns
    -------
    The effect with its values, and the size that was reached: within 1 % of the wanted one, or
    less where the effect's limit does not allow more.
    """
    without = press(bench, (*others, (effect, {**drawn, effect.amplitude: 0.0})))
    seen: list[tuple[float, float]] = [(0.0, 0.0)]

    def reach(amplitude: float) -> float:
        values = {**drawn, effect.amplitude: sign * amplitude}
        found = size_of(press(bench, (*others, (effect, values))), without)
        seen.append((amplitude, found))
        return found

    reach(min(effect.typical, effect.limit))
    for _ in range(ROUNDS):
        best = min(seen[1:], key=lambda pair: abs(pair[1] - size))
        if abs(best[1] - size) <= TOLERANCE * size or (best[0] >= effect.limit and best[1] < size):
            break
        reach(_next(sorted(seen), size, effect.limit))
    amplitude, found = min(seen[1:], key=lambda pair: abs(pair[1] - size))
    return (effect, {**drawn, effect.amplitude: sign * amplitude}), found


def _next(seen: list[tuple[float, float]], size: float, limit: float) -> float:
    """Amplitude to try next: between the neighbours that enclose the size, or beyond the last."""
    above = [pair for pair in seen if pair[1] >= size]
    if not above:
        (a, low), (b, high) = seen[-2:]
        slope = (high - low) / (b - a) if b > a else 0.0
        ahead = b + (size - high) / slope if slope > 0 else 3 * b
        return min(max(min(ahead, 3 * b), 1.1 * b), limit)
    right = min(above, key=lambda pair: pair[0])
    left = max((pair for pair in seen if pair[0] < right[0]), key=lambda pair: pair[0])
    share = (size - left[1]) / (right[1] - left[1])
    # Kept off the ends: a false position that sticks to one of them would not close in
    return left[0] + (right[0] - left[0]) * min(max(share, 0.03), 0.97)
