"""The clocks of force and pose brought together roughly.

The sign: a positive offset is added to the pose's clock to get the force's; the force then lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpmap.importing.streams.stream import Stream

GRID_S = 0.01
SMOOTHED_S = 0.02
NEAR_STEP_S = 0.02
SAME_TIMES = 0.9  # of the messages
SHARED_S = 0.5  # two sensors of one clock are never further apart
NEARLY = 0.9  # of the best correlation: so good, an offset of one clock is preferred
POSSIBLE, MOST_POSSIBLE = 0.7, 8  # of the best correlation: offsets that are looked at closer


@dataclass(frozen=True)
class RoughOffset:
    """Where force and motion go together best.

    Attributes
    ----------
    offset_s : to add to the pose's clock
    line : (3,) unit, the line of motion along which the force changes, either way
    """

    offset_s: float
    line: np.ndarray


def rough_offsets(force: Stream, pose: Stream, known_s: float | None) -> list[RoughOffset]:
    """Find the offsets at which the force's rate and the tip's velocity correlate well, best first.

    Parameters
    ----------
    known_s : offset that the user states; only the direction is then found

    Messages at the same times have one clock: the offset is small then.
    """
    start_f, start_p = force.time_s[0], pose.time_s[0]
    rate, velocity = _rate(force, slice(None), cut=True), _rate(pose, slice(0, 3), cut=False)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    # fast moves from place to place, in which the tip turns, must not outweigh the presses
    velocity = velocity / (speed + np.median(speed) + 1e-12)
    size = len(rate) + len(velocity)
    rates, velocities = np.fft.rfft(rate, size, axis=0), np.fft.rfft(velocity, size, axis=0)
    product = np.conj(velocities)[:, :, None] * rates[:, None, :]
    correlation = np.fft.irfft(product, size, axis=0)  # (size, 3, k)
    lags = np.arange(size)
    lags[lags > len(rate)] -= size
    offsets = lags * GRID_S + start_f - start_p
    strength = np.linalg.norm(correlation, axis=(1, 2))
    if known_s is not None:
        best = int(np.abs(offsets - known_s).argmin())
        return [RoughOffset(known_s, _line(correlation[best]))]
    near = np.abs(offsets) <= SHARED_S
    one_clock = share_clock(force, pose)
    if near.any() and (one_clock or strength[near].max() >= NEARLY * strength.max()):
        strength = np.where(near, strength, 0.0)
    least, found = POSSIBLE * strength.max(), []
    while strength.max() > least and len(found) < MOST_POSSIBLE:
        best = int(strength.argmax())
        found.append(RoughOffset(float(offsets[best]), _line(correlation[best])))
        strength[np.abs(offsets - offsets[best]) <= 2 * SHARED_S] = 0.0
    return found


def share_clock(force: Stream, pose: Stream) -> bool:
    """Return True for streams whose messages come at the same times, as columns of one table do."""
    few, many = sorted((force.time_s, pose.time_s), key=len)  # frozen messages may be left out
    return bool(np.isin(few, many).mean() > SAME_TIMES)


def _line(correlation: np.ndarray) -> np.ndarray:
    """Return the line of motion along which the force changes most, (3,), either way."""
    return np.linalg.svd(correlation)[0][:, 0]


def closer_offset(
    force: Stream, pose: Stream, direction: np.ndarray, spans: Sequence[tuple[float, float]]
) -> tuple[float, float, float]:
    """Bring the clocks together to some 0.05 s: the force rises with depth beyond a threshold.

    Parameters
    ----------
    force, pose : roughly on one clock; the force along the direction in its first column
    direction : (3,) unit, supposed to point into the body
    spans : begin and end of each press, s

    Returns
    -------
    offset_s : to add to the pose's clock
    correlation : median over the presses, -1 to 1; of the two ways to point, the higher is right
    agreement : mean over the presses, which one that does not fit lowers
    """
    offsets = np.arange(-SHARED_S, SHARED_S + NEAR_STEP_S / 2, NEAR_STEP_S)
    found = []
    for start, end in spans:
        time = np.arange(start, end, GRID_S)
        if len(time) < 20:
            continue
        depth = smoothed(pose.at(time)[:, :3] @ direction[:, None], 5)
        levels = depth.min() + np.array([0.2, 0.35, 0.5, 0.65, 0.8, 0.9]) * np.ptp(depth)
        pressed = np.maximum(depth - levels, 0.0)
        pressed = pressed - pressed.mean(axis=0)
        pressed /= np.linalg.norm(pressed, axis=0) + 1e-12
        moved = np.array([np.interp(time + o, force.time_s, force.values[:, 0]) for o in offsets])
        moved -= moved.mean(axis=1, keepdims=True)
        moved /= np.linalg.norm(moved, axis=1, keepdims=True) + 1e-12
        each = moved @ pressed  # (offsets, levels)
        found.append(each[:, np.abs(each).max(axis=0).argmax()])
    if not found:
        return 0.0, 0.0, 0.0
    usual = np.median(found, axis=0)
    k = int(np.abs(usual).argmax())
    return float(offsets[k]), float(usual[k]), float(np.mean(found, axis=0)[k])


def _rate(stream: Stream, columns: slice, cut: bool) -> np.ndarray:
    """Rates of change on an even grid, (p, k); the largest are cut, as jumps are no motion."""
    time = np.arange(stream.time_s[0], stream.time_s[-1], GRID_S)
    values = smoothed(Stream(stream.time_s, stream.values[:, columns], stream.gaps).at(time), 5)
    rate = np.gradient(values, GRID_S, axis=0)
    if cut:
        largest = 3 * np.quantile(np.abs(rate), 0.95, axis=0)
        rate = np.clip(rate, -largest, largest)
    return rate


def smoothed(values: np.ndarray, count: int) -> np.ndarray:
    """Return the moving mean of `count` samples (odd), (m, k); shorter at the ends."""
    half = count // 2
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    m = len(values)
    low, high = np.maximum(np.arange(m) - half, 0), np.minimum(np.arange(m) + half + 1, m)
    return (total[high] - total[low]) / (high - low)[:, None]


def smooth(values: np.ndarray, time: np.ndarray, width_s: float = SMOOTHED_S) -> np.ndarray:
    """Return the moving mean over a width in time, (m,)."""
    step = float(np.median(np.diff(time)))
    return smoothed(values[:, None], 2 * int(width_s / step / 2) + 1)[:, 0]
