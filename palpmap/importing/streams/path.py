"""The tip's path without the noise of its readings."""

from __future__ import annotations

import numpy as np

from palpmap.importing.streams.stream import Stream, noise_of_moving

WIDTHS_S = (0.04, 0.06, 0.09, 0.13, 0.2, 0.3)
AGREE = 2.5  # standard deviations: so close a wider fit must stay to all narrower ones


def smooth_path(pose: Stream) -> Stream:
    """Return the pose on an even clock, its position smoothed over as long as it moves smoothly.

    At each time the position is that of a parabola through the readings around it. Of several
    widths the widest is taken whose parabola agrees with those of all narrower ones within the
    noise (intersection of confidence intervals, Goldenshluger and Nemirovski 1997): a corner of
    the motion stays sharp, a straight way and a hold lose nearly all their noise.
    """
    time = np.arange(pose.time_s[0], pose.time_s[-1], pose.step_s)
    values = pose.at(time)
    sigma = noise_of_moving(pose.values[:, :3])
    for axis in range(3):
        values[:, axis] = _smoothed(values[:, axis], pose.step_s, float(sigma[axis]))
    return Stream(time, values, pose.gaps)


def _smoothed(x: np.ndarray, step_s: float, sigma: float) -> np.ndarray:
    low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    best, agrees = x.copy(), np.ones(len(x), dtype=bool)
    for half in sorted({round(width / 2 / step_s) for width in WIDTHS_S}):
        if half < 2 or 2 * half + 1 > len(x):
            continue
        at = np.arange(-half, half + 1) / half
        weights = np.linalg.pinv(np.vander(at, 3))[2]  # of the parabola's value in the middle
        around = np.concatenate([2 * x[0] - x[half:0:-1], x, 2 * x[-1] - x[-2 : -half - 2 : -1]])
        fit = np.convolve(around, weights, "valid")
        width = AGREE * sigma * np.linalg.norm(weights)
        low, high = np.maximum(low, fit - width), np.minimum(high, fit + width)
        agrees &= low <= high
        best[agrees] = fit[agrees]
    return best
