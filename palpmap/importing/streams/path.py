"""The tip's path without the noise of its readings."""

from __future__ import annotations

import numpy as np

from palpmap.importing.streams.stream import Stream, noise_of_moving, widest

WIDTHS_S = (0.04, 0.06, 0.09, 0.13, 0.2, 0.3)


def smooth_path(pose: Stream) -> Stream:
    """Return the pose on an even clock, its position smoothed over as long as it moves smoothly.

    At each time the position is that of a parabola through the readings around it. Of several
    widths the widest is taken whose parabola agrees with those of all narrower ones within the
    noise: a corner of the motion stays sharp, a straight way and a hold lose nearly all of it.
    """
    time = np.arange(pose.time_s[0], pose.time_s[-1], pose.step_s)
    values = pose.at(time)
    sigma = noise_of_moving(pose.values[:, :3])
    for axis in range(3):
        values[:, axis] = _smoothed(values[:, axis], pose.step_s, float(sigma[axis]))
    return Stream(time, values, pose.gaps)


def _smoothed(x: np.ndarray, step_s: float, sigma: float) -> np.ndarray:
    fits: list[tuple[np.ndarray, float]] = [(x, np.inf)]
    for half in sorted({round(width / 2 / step_s) for width in WIDTHS_S}):
        if half < 2 or 2 * half + 1 > len(x):
            continue
        at = np.arange(-half, half + 1) / half
        weights = np.linalg.pinv(np.vander(at, 3))[2]  # of the parabola's value in the middle
        around = np.concatenate([2 * x[0] - x[half:0:-1], x, 2 * x[-1] - x[-2 : -half - 2 : -1]])
        fits.append((np.convolve(around, weights, "valid"), sigma * float(np.linalg.norm(weights))))
    return widest(fits)
