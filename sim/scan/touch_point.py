"""Where along the press direction the tip first touched, from the press's own samples."""

from __future__ import annotations

import numpy as np


def depth_at_zero_force(
    depth_m: np.ndarray, force_n: np.ndarray, depth_noise_m: float, force_noise_n: float
) -> float:
    """Depth at which a straight line through the samples has no force, m.

    A touch can only be noticed above the force noise, and on a soft body the tip has then already
    travelled by a good part of a millimetre. The line through the rising and falling samples
    gives the true point of first touch. Both columns are noisy, so an ordinary regression of
    either on the other would be biased; this is Deming's line for the known ratio of the
    variances (Deming, Statistical Adjustment of Data, 1943).

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
