"""Depth of first touch, from the readings of one press, for any law of the body.

A touch can only be noticed above the force noise, and on a soft body the tip has then already gone
on by a good part of a millimetre. The samples from before the touch on, loading and unloading, are
fitted by several laws of the depth since touch (`sim.scan.touch_laws`); where they lie on a
straight line as far as the noise shows, by the nearly straight ones, since a curvature that the
noise hides still moves the touch by several times a line's standard deviation. The touch is their
mean, weighted by the Bayesian information criterion (Kass & Raftery, J. Am. Stat. Assoc. 1995).
Under a ball the law is known but for a small part, see `BALL`. Where none holds, the channels of
force and depth may not be of one instant: the lag that lets loading and unloading coincide is taken
out. Else the loading is fitted alone, or its first part. A body that goes on sinking while the
force is held is described by the force's history.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from sim.scan.touch_laws import BALL, BENT, LAWS, NEARLY_STRAIGHT, Ball, Laws, fit_law

BLOCK_S = 0.02
"""Time over which readings are averaged; the tip goes 0.03 mm meanwhile."""

PARTS = ((1.0, True), (1.0, False), (0.4, False), (0.2, False))
"""Of the largest force, up to which the loading is fitted, and whether unloading is: the first on
which a law holds."""

HOLDS = 4.0
"""Standard deviations of chi squared within which a law holds."""

CURVED = 3.5
"""Standard errors beyond which a term that a straight line lacks is real."""

LEAST_NOISE = 1e-4
"""Of the range of force: without noise, deviations below are of no account."""

LONGEST_LAG_S = 0.2
"""Between the channels of force and depth, either way."""

CREEP_TIMES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Times of retardation by which creep is described."""


class FirstTouch(NamedTuple):
    """Depth of first touch and its standard deviation, m."""

    depth_m: float
    sd_m: float


def first_touch(
    depth_m: np.ndarray,
    force_n: np.ndarray,
    wanted_n: np.ndarray,
    part: np.ndarray,
    step_s: float,
    depth_noise_m: float,
    force_noise_n: float,
    ball: Ball | None = None,
) -> FirstTouch:
    """Return the depth at which the tip touched.

    Parameters
    ----------
    depth_m, force_n : (t,) readings of the slow approach, then of loading, holding and unloading
    wanted_n : (t,) set value of the force
    part : (t,) 0 before loading, 1 loading, 2 holding, 3 unloading
    step_s : time from sample to sample
    depth_noise_m, force_noise_n : standard deviations of a sample
    ball : the tip, where it is one; its law is then known but for a small part
    """
    moving = (part == 1) | (part == 3)
    noise = depth_noise_m, force_noise_n
    line = depth_at_zero_force(depth_m[moving], force_n[moving], *noise)
    laws = (BALL,) if ball else LAWS
    straight = not ball and _is_line(depth_m[moving], force_n[moving], part[moving] == 3, *noise)
    if straight:
        laws = NEARLY_STRAIGHT
    size = max(1, round(BLOCK_S / step_s))
    softness = float(np.ptp(depth_m[moving]) / np.ptp(force_n[moving]))
    sinking = np.hypot(depth_noise_m, softness * force_noise_n)  # the control follows that noise
    if not straight and _creeps(depth_m[part == 2], sinking):
        touch, holds = _creeping_start(depth_m, force_n, part, step_s, size, *noise)
        if holds:
            return touch
    sd = depth_noise_m / np.sqrt(size), force_noise_n / np.sqrt(size)

    def start(used: np.ndarray, depth: np.ndarray = depth_m) -> tuple[FirstTouch, bool]:
        means = _means(depth, used, size), _means(force_n, used, size)
        return _law_start(*means, line, *sd, laws, ball)

    touch = FirstTouch(line, 0.0)
    for share, back in PARTS:
        used = (part == 0) | ((part == 1) & (wanted_n <= share * wanted_n.max()))
        used |= back & (part == 3)
        touch, holds = start(used)
        if holds:
            break
        if straight:  # what the approach felt is not what was pressed: the body may have moved
            return FirstTouch(line, _line_sd(depth_m[moving], force_n[moving], *noise))
        if back:
            lag_s, lag_sd_s = _lag(depth_m, force_n, moving, step_s, size, sinking)
            used &= _has_earlier(used, lag_s / step_s)
            touch, holds = start(used, _earlier(depth_m, lag_s / step_s))
            if holds:
                other, _ = start(used, _earlier(depth_m, (lag_s + lag_sd_s) / step_s))
                moved = other.depth_m - touch.depth_m
                return FirstTouch(touch.depth_m, float(np.hypot(touch.sd_m, moved)))
    return touch


def _means(values: np.ndarray, used: np.ndarray, size: int) -> np.ndarray:
    """Return the means of so many neighbours each among the values that are used."""
    count = int(used.sum()) // size
    return values[used][: count * size].reshape(count, size).mean(axis=1)


def _earlier(values: np.ndarray, steps: float) -> np.ndarray:
    """Return the values of so many samples before, between samples by a straight line."""
    at = np.arange(len(values))
    return np.interp(at - steps, at, values)


def _has_earlier(values: np.ndarray, steps: float) -> np.ndarray:
    """Return where `_earlier` has a value of its own: not after the end."""
    return np.arange(len(values)) - steps < len(values)


def _lag(
    depth: np.ndarray,
    force: np.ndarray,
    moving: np.ndarray,
    step_s: float,
    size: int,
    noise_m: float,
) -> tuple[float, float]:
    """Return the time by which the force is read later than the depth, and its error, s.

    With it the depth is one cubic of the force, when loading as when unloading.
    """

    def misfit(steps: float) -> float:
        used = moving & _has_earlier(moving, steps)
        mean, course = (_means(v, used, size) for v in (force, _earlier(depth, steps)))
        cubic = np.linalg.qr(np.vander((mean - mean.mean()) / np.ptp(mean), 4)).Q
        left = course - cubic @ (cubic.T @ course)
        return float(left @ left) / len(left) * moving.sum() / noise_m**2

    noise_m = max(noise_m, LEAST_NOISE * float(np.ptp(depth)))
    most = round(LONGEST_LAG_S / step_s)
    cost = np.array([misfit(steps) for steps in range(-most, most + 1)])
    best = min(max(int(cost.argmin()), 1), 2 * most - 1)
    before, here, after = cost[best - 1 : best + 2]
    bend = max(float(before - 2 * here + after), 1e-9)
    steps = best - most + min(max(float(before - after) / (2 * bend), -1.0), 1.0)
    return steps * step_s, step_s * float(np.sqrt(2 / bend))


def _creeps(depth: np.ndarray, noise: float) -> bool:
    """Whether the tip sinks while the force is held."""
    third = len(depth) // 3
    if third == 0:
        return False
    change = float(depth[-third:].mean() - depth[third : 2 * third].mean())
    return change > CURVED * max(noise, LEAST_NOISE * 1e-2) * np.sqrt(2 / third)


def _creeping_start(
    depth: np.ndarray,
    force: np.ndarray,
    part: np.ndarray,
    step_s: float,
    size: int,
    depth_noise: float,
    noise: float,
) -> tuple[FirstTouch, bool]:
    """Touch of a linear body that creeps: depth = touch + C (F + sum_i s_i F lagging by t_i).

    Linear in all that is unknown, for given times, with s_i >= 0; and whether it holds.
    """
    count = len(depth) // size
    mean_depth, mean_force, last = (
        values[: count * size].reshape(count, size).mean(axis=1) for values in (depth, force, part)
    )
    columns = [np.ones(count), mean_force]
    for time in CREEP_TIMES_S:
        kept, lagging, state = np.exp(-size * step_s / time), np.empty(count), 0.0
        for i, value in enumerate(mean_force):
            state = kept * state + (1 - kept) * value
            lagging[i] = state
        columns.append(lagging)
    rows = last >= 1
    matrix = np.column_stack(columns)[rows]
    # A body's creep has no negative part; free signs would fit the noise that the control follows
    signed, _ = nnls(np.column_stack([matrix, -matrix[:, 0]]), mean_depth[rows])
    found = np.append(signed[0] - signed[-1], signed[1:-1])
    used = np.r_[True, True, found[2:] > 0]
    matrix, found = matrix[:, used], found[used]
    floor = LEAST_NOISE * float(np.ptp(mean_depth[rows]))
    sd = max(float(np.hypot(depth_noise, found[1] * noise)) / np.sqrt(size), floor)
    misfit = mean_depth[rows] - matrix @ found
    free = int(rows.sum()) - len(found)
    excess = (float(misfit @ misfit) / sd**2 - free) / np.sqrt(2 * free)
    inverse = np.linalg.pinv(matrix.T @ matrix, rcond=1e-8)
    return FirstTouch(float(found[0]), sd * float(np.sqrt(inverse[0, 0]))), bool(excess < HOLDS)


def depth_at_zero_force(
    depth_m: np.ndarray, force_n: np.ndarray, depth_noise_m: float, force_noise_n: float
) -> float:
    """Depth at which a straight line through the samples has no force, m.

    Both columns are noisy, so an ordinary regression of either on the other would be biased; this
    is Deming's line for the known ratio of the variances (Deming, Statistical Adjustment of Data,
    1943).

    Parameters
    ----------
    depth_m, force_n : (m,) samples in contact. They must be chosen by time, not by force: a cut
        at a measured force would bias.
    depth_noise_m, force_noise_n : standard deviations of a sample

    Examples
    --------
    >>> depth = np.array([0.001, 0.002, 0.003])
    >>> round(depth_at_zero_force(depth, 100 * (depth - 0.0004), 2e-5, 5e-3), 9)
    0.0004
    """
    x, y = depth_m - depth_m.mean(), force_n - force_n.mean()
    sxx, syy, sxy = x @ x, y @ y, x @ y
    if depth_noise_m == 0:
        slope = sxy / sxx
    else:
        ratio = (force_noise_n / depth_noise_m) ** 2
        half = (syy - ratio * sxx) / 2
        slope = (half + np.hypot(half, np.sqrt(ratio) * sxy)) / sxy
    return float(depth_m.mean() - force_n.mean() / slope)


def _line_sd(depth: np.ndarray, force: np.ndarray, depth_noise: float, noise: float) -> float:
    """Return the standard deviation of `depth_at_zero_force`, m."""
    spread = float(((force - force.mean()) ** 2).sum())
    softness = float(np.ptp(depth) / np.ptp(force))
    by_sample = 1 / len(force) + force.mean() ** 2 / spread
    return float(np.hypot(depth_noise, softness * noise) * np.sqrt(by_sample))


def _is_line(
    depth: np.ndarray, force: np.ndarray, falling: np.ndarray, depth_noise: float, noise: float
) -> bool:
    """Whether a curvature, or another course when unloading, adds nothing to a straight line."""
    scale = float(np.ptp(depth)) or 1.0
    x = (depth - depth.mean()) / scale
    columns = np.column_stack([np.ones_like(x), x, x * x, falling, falling * x])
    inverse = np.linalg.pinv(columns.T @ columns)
    found = inverse @ (columns.T @ force)
    spread = np.hypot(noise, depth_noise * abs(found[1]) / scale)
    error = np.maximum(spread, LEAST_NOISE * np.ptp(force)) * np.sqrt(np.diag(inverse))
    return bool((np.abs(found[2:]) < CURVED * error[2:]).all())


def _law_start(
    depth: np.ndarray,
    force: np.ndarray,
    line: float,
    depth_noise: float,
    noise: float,
    laws: Laws,
    ball: Ball | None,
) -> tuple[FirstTouch, bool]:
    """Fit the laws to block means; return their mean touch and whether the best one holds."""
    far = float(depth.max() - depth.min())
    x = depth / far
    first = line / far
    floor = LEAST_NOISE * float(np.ptp(force))
    slope = float(np.ptp(force))
    found_by, spread = [], BENT if ball else np.inf
    for law, start in laws:
        sd = np.full(len(x), np.hypot(max(noise, floor), depth_noise * slope / far))
        expected = ball.series(far) if ball else np.array(start)
        found = np.r_[first - 0.05, expected]
        for _ in range(2):  # the slope, by which the depth's noise counts, is known after one fit
            found, scale, cost, variance = fit_law(law, found, x, force, sd, expected, spread)
            step = 1e-4
            there = np.maximum(x - found[0], 0.0)
            steep = scale * (law(there + step, *found[1:]) - law(there, *found[1:])) / step
            sd = np.hypot(max(noise, floor), depth_noise * np.abs(steep) / far)
        count = len(found) + 2
        # The spread differs from law to law, and so does the likelihood's normalisation
        score = cost + 2 * np.log(sd).sum() + count * np.log(len(x))
        excess = (cost - (len(x) - count)) / np.sqrt(2 * (len(x) - count))
        found_by.append((score, found[0] * far, excess, variance * far**2))
    score, touch, excess, variance = np.array(found_by).T
    weight = np.exp((score.min() - score) / 2)
    weight /= weight.sum()
    mean = float(weight @ touch)
    error = float(np.sqrt(weight @ (variance + (touch - mean) ** 2)))
    return FirstTouch(mean, error), bool(excess[score.argmin()] < HOLDS)
