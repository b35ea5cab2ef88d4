"""Points and numbers for the simulated robot: another shape is refused in a sentence."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from models import InputError, shortened


def rows(key: str, given: ArrayLike, width: int) -> np.ndarray:
    """Return one row of numbers, or several, as (j, width).

    >>> rows("points_m", (0.03, 0.04, 0.05), 3).shape
    (1, 3)
    """
    try:
        found = np.atleast_2d(np.asarray(given, float))
    except (TypeError, ValueError):
        found = np.empty((0, 0))
    if found.ndim != 2 or found.shape[1] != width or not len(found) or not np.isfinite(found).all():
        raise InputError(
            f"{key}: found {shortened(given)}, expected {width} finite numbers, or rows of {width}"
        )
    return found


def for_each(key: str, given: ArrayLike, shape: Sequence[int]) -> np.ndarray:
    """Return numbers of each of j points, or the same ones of all, in the shape (j,) or (j, 3).

    >>> for_each("force_n", 0.2, (2,)).tolist()
    [0.2, 0.2]
    """
    try:
        found = np.broadcast_to(np.asarray(given, float), tuple(shape))
        if np.isfinite(found).all():
            return found
        raise ValueError("not finite")
    except (TypeError, ValueError) as error:
        one = f"{shape[1]} numbers" if len(shape) > 1 else "one number"
        count = f"of the {shape[0]} points" if shape[0] > 1 else "point"
        raise InputError(
            f"{key}: found {shortened(given)}, expected {one}, or {one} for each {count}"
        ) from error
