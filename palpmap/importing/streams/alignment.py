"""The clocks of force and pose brought together: a rough offset, then the lag to a millisecond.

The sign: a positive offset is added to the pose's clock to get the force's; the force then lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from models import InputError
from palpmap.importing.streams.stream import Stream

GRID_S = 0.01
SMOOTHED_S = 0.02
LAG_SMOOTHED_S = 0.08
CORNER_S, CORNER = 0.08, 0.7  # a change of speed by this share in twice this time is a corner
CLOSE_S, LOOSE_S = 1.0e-3, 5.0e-3  # what the force's law adds to the lag's error
NEAR_STEP_S = 0.02
SHARED_S = 0.5  # two sensors of one clock are never further apart
NEARLY = 0.9  # of the best correlation: two offsets this close cannot be separated
FURTHEST_S, SEARCH_STEP_S = 0.16, 0.004
TRIMMED_S = 0.08  # of both ends of a contact, where lag and touch mix
RELAXATION_S = (0.1, 0.3, 1.0, 4.0)
CONTACT_SHARE = 0.1  # of a press's travel: below it the touch itself disturbs


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


def rough_offset(force: Stream, pose: Stream, known_s: float | None) -> RoughOffset:
    """Find the offset at which the force's rate and the tip's velocity correlate best.

    Parameters
    ----------
    known_s : offset that the user states; only the direction is then found

    Raises
    ------
    InputError
        Several offsets fit as well as each other.
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
        return RoughOffset(known_s, _line(correlation[best]))
    near = np.abs(offsets) <= SHARED_S
    best = int(strength.argmax())
    if near.any() and strength[near].max() >= NEARLY * strength[best]:
        best = int(np.flatnonzero(near)[strength[near].argmax()])
    else:
        others = np.abs(offsets - offsets[best]) > 2 * SHARED_S
        if strength[others].max(initial=0.0) > NEARLY * strength[best]:
            second = offsets[others][strength[others].argmax()]
            raise InputError(
                "key pose.clock_offset_s: force and pose have clocks of their own, and offsets of "
                f"{offsets[best]:.2f} s and {second:.2f} s fit alike, as the presses follow each "
                "other evenly; state the offset that gives the force's clock"
            )
    return RoughOffset(float(offsets[best]), _line(correlation[best]))


def _line(correlation: np.ndarray) -> np.ndarray:
    """Return the line of motion along which the force changes most, (3,), either way."""
    return np.linalg.svd(correlation)[0][:, 0]


def closer_offset(
    force: Stream, pose: Stream, direction: np.ndarray, spans: Sequence[tuple[float, float]]
) -> tuple[float, float]:
    """Bring the clocks together to some 0.05 s: the force rises with depth beyond a threshold.

    Parameters
    ----------
    force, pose : roughly on one clock; the force along the direction in its first column
    direction : (3,) unit, supposed to point into the body
    spans : begin and end of each press, s

    Returns
    -------
    offset_s : to add to the pose's clock
    correlation : mean over the presses, -1 to 1; of the two ways to point, the higher is right
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
        return 0.0, 0.0
    mean = np.median(found, axis=0)
    k = int(np.abs(mean).argmax())
    return float(offsets[k]), float(mean[k])


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


@dataclass(frozen=True)
class Lag:
    """Correction of the pose's clock beyond the rough offset.

    Attributes
    ----------
    lag_s : at `middle_s`
    rate : seconds of lag gained in a second: the clocks' difference in speed, 0 if not seen
    middle_s : of the recording, on the pose's clock
    error_s : standard deviation of the lag
    presses : number of presses that determine it
    has_corners : whether the tip stops and starts sharply, which fixes the lag within some 2 ms
    """

    lag_s: float
    rate: float
    middle_s: float
    error_s: float
    presses: int
    has_corners: bool

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the lag at times of the pose's clock, s."""
        return self.lag_s + self.rate * (time_s - self.middle_s)


def find_lag(
    force_time: Sequence[np.ndarray],
    force: Sequence[np.ndarray],
    pose_time: Sequence[np.ndarray],
    travel: Sequence[np.ndarray],
) -> Lag | None:
    """Estimate the lag between force and travel from all presses; None if no press shows it.

    In each press the force is taken to be a smooth function of travel, other while the tip goes
    out than while it goes in, plus its relaxation at four rates: a body's own viscosity is thus
    not mistaken for a lag, unless it relaxes faster than in 0.1 s. The lag is where the sum of
    squares is least; corners of the motion decide it.

    Parameters
    ----------
    force_time, force : of each press, s and N, contact only
    pose_time, travel : of each press, s and m, from before the touch; even steps
    """
    middles, lags, errors = [], [], []
    for tf, f, tp, x in zip(force_time, force, pose_time, travel, strict=True):
        found = _press_lag(tf, f, tp, x)
        if found is not None:
            middles.append(tf.mean())
            lags.append(found[0])
            errors.append(found[1])
    if not lags:
        return None
    middle, lag, error = map(np.array, (middles, lags, errors))
    error = np.hypot(error, 0.3 * np.median(error))
    kept = np.ones(len(lag), dtype=bool)
    centre = float(middle.mean())
    design = np.column_stack([np.ones(len(lag)), middle - centre])
    line = np.zeros(2)
    for _ in range(4):
        columns = design if np.sum(kept) >= 6 else design[:, :1]
        weighted = columns[kept] / error[kept, None]
        line[:] = 0
        line[: columns.shape[1]] = np.linalg.lstsq(weighted, lag[kept] / error[kept], rcond=None)[0]
        off = lag - design @ line
        spread = 1.4826 * np.median(np.abs(off[kept])) + 1e-5
        kept = np.abs(off) < 4 * spread
    scale = spread / np.sqrt(np.sum(kept))
    rate_error = spread / np.sqrt(np.sum((middle[kept] - centre) ** 2) + 1e-12)
    if abs(line[1]) < 5 * rate_error or abs(line[1]) * np.ptp(middle) < 1e-3:
        line[:] = float(np.average(lag[kept], weights=error[kept] ** -2)), 0.0
    sharp = [_sharpest(tp, x) for tp, x in zip(pose_time, travel, strict=True)]
    corners = float(np.median(sharp)) > CORNER
    total = float(np.hypot(scale, CLOSE_S if corners else LOOSE_S))
    return Lag(float(line[0]), float(line[1]), centre, total, int(np.sum(kept)), corners)


def _sharpest(time: np.ndarray, travel: np.ndarray) -> float:
    """Return the largest change of speed within twice `CORNER_S`, by the largest speed."""
    speed = np.gradient(smooth(travel, time, LAG_SMOOTHED_S), time)
    apart = max(1, round(CORNER_S / float(np.median(np.diff(time)))))
    inside = travel > CONTACT_SHARE * travel.max()
    inside[: 2 * apart] = inside[-2 * apart :] = False
    if not inside.any():
        return 0.0
    change = np.zeros(len(speed))
    change[apart:-apart] = np.abs(speed[2 * apart :] - speed[: -2 * apart])
    return float(change[inside].max() / np.quantile(np.abs(speed), 0.95))


def _press_lag(
    force_time: np.ndarray, force: np.ndarray, pose_time: np.ndarray, travel: np.ndarray
) -> tuple[float, float] | None:
    """Lag of one press and its standard deviation, s; None where it is at the search's edge."""
    # both alike; a pose's remaining noise would make the force seem to lead
    travel = smooth(travel, pose_time, LAG_SMOOTHED_S)
    force = smooth(force, force_time, LAG_SMOOTHED_S)
    free, relaxing = _bases(pose_time, travel)
    basis = np.hstack([free, relaxing])
    inside = travel > CONTACT_SHARE * travel.max()
    first, last = pose_time[inside][[0, -1]] if inside.any() else (0.0, 0.0)
    used = (force_time > first + TRIMMED_S) & (force_time < last - TRIMMED_S)
    tf, f = force_time[used], force[used]
    if len(tf) < 4 * basis.shape[1]:
        return None

    def squares(lags: np.ndarray) -> np.ndarray:
        return np.array(
            [_residual(_at(tf - lag, pose_time, basis), f, free.shape[1]) for lag in lags]
        )

    wide = np.arange(-FURTHEST_S, FURTHEST_S + SEARCH_STEP_S, 2 * SEARCH_STEP_S)
    k = int(squares(wide).argmin())
    if not 1 <= k < len(wide) - 1:
        return None
    lags = wide[k] + SEARCH_STEP_S * np.arange(-3, 4)
    near = squares(lags)
    k = int(np.clip(near.argmin(), 2, 4))
    curve = np.polyfit(lags[k - 2 : k + 3], near[k - 2 : k + 3], 2)
    if curve[0] <= 0:
        return None
    best = float(np.clip(-curve[1] / (2 * curve[0]), lags[k - 1], lags[k + 1]))
    variance = near[k] / (len(tf) - basis.shape[1])
    return best, float(np.sqrt(variance / curve[0]))


def _bases(time: np.ndarray, travel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Functions of travel, (p, 7), and of its past, (p, r), that a press's force is made of.

    The latter relax; a body gives them only positive weights. Negative ones would make a lag.
    """
    x = np.maximum(travel, 0.0) / travel.max()
    top = int(x.argmax())
    going_out = np.zeros(len(x))
    going_out[top:] = x.max() - x[top:]
    free = [np.ones(len(x)), x, x**2, x**3, going_out, going_out**2, going_out**3]
    step = float(np.median(np.diff(time)))
    relaxing = [
        lfilter([1.0], [1.0, -np.exp(-step / tau)], np.diff(power, prepend=power[0]))
        for tau in RELAXATION_S
        for power in (x, x**2)
    ]
    return np.column_stack(free), np.column_stack(relaxing)


def _at(time: np.ndarray, grid: np.ndarray, basis: np.ndarray) -> np.ndarray:
    at = np.clip((time - grid[0]) / (grid[1] - grid[0]), 0, len(basis) - 1.000001)
    k = at.astype(int)
    part = (at - k)[:, None]
    return basis[k] * (1 - part) + basis[k + 1] * part


def _residual(columns: np.ndarray, force: np.ndarray, free: int) -> float:
    """Least sum of squares, the columns behind the first `free` with weights of at least zero."""
    q, _ = np.linalg.qr(columns[:, :free])
    rest, f = columns[:, free:], force - q @ (q.T @ force)
    rest = rest - q @ (q.T @ rest)
    scale = np.sqrt(np.sum(rest**2, axis=0)) + 1e-12
    rest = rest / scale
    factor = np.linalg.cholesky(rest.T @ rest + 1e-9 * np.eye(rest.shape[1]))
    y = np.linalg.solve(factor, rest.T @ f)
    return float(f @ f - y @ y + nnls(factor.T, y)[1] ** 2)
