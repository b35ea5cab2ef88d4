"""Arguments of the simulated robot from Python: another kind or shape is refused in a sentence."""

from collections.abc import Sequence
from numbers import Integral
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from identify.map import GaussianMap
from models import InputError, PressProgram
from palpmap.study.body import Body
from palpmap.study.faults import shortened
from palpmap.study.study import Probe


def refuse_other_kinds(**given: object) -> None:
    """Refuse arguments, by name, of another kind than the robot takes; None is left to default.

    Raises
    ------
    InputError
        Naming the argument, what was found and what is expected.
    """
    from sim.motion import ScanSettings

    kinds = {
        "body": (Body, "a body, such as pm.Block(...)"),
        "tip": (Probe, "a tip, such as pm.FlatTip(0.005)"),
        "map": (GaussianMap, "a map, such as pm.GaussianMap(6000.0)"),
        "arm": (ScanSettings, "pm.ScanSettings(...)"),
        "program": (PressProgram | str | Path, "a pm.PressProgram or the path of one"),
        "presses": (Integral, "a whole number"),
        "tips": (str, 'a text, such as "3,10"'),
    }
    for key, value in given.items():
        kind, told = kinds[key]
        if value is not None and not isinstance(value, kind):
            raise InputError(f"{key}: found {shortened(value)}, expected {told}")


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
        return np.broadcast_to(np.asarray(given, float), tuple(shape))
    except (TypeError, ValueError) as error:
        one = f"{shape[1]} numbers" if len(shape) > 1 else "one number"
        count = f"of the {shape[0]} points" if shape[0] > 1 else "point"
        raise InputError(
            f"{key}: found {shortened(given)}, expected {one}, or {one} for each {count}"
        ) from error
