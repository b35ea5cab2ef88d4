"""From the body's frame to the frame of the scan."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identify.effects import Effect, Readings

_AXES = {"x_m": 0, "y_m": 1, "z_m": 2}
_SHIFTS = ("body_shift.",)  # lengths along the axes, no places


def frame_shift_m(name: str, origin_m: np.ndarray) -> float:
    """Return the addition that takes a parameter to the scan's frame: zero but for positions.

    Parameters
    ----------
    name : of the parameter, of map or effect
    origin_m : (3,)
        Origin of the body's frame in the scan's frame, m.

    Examples
    --------
    >>> origin_m = np.array([0.1, 0.2, 0.3])
    >>> frame_shift_m("inclusion_1.y_m", origin_m), frame_shift_m("inclusion_1.radius_m", origin_m)
    (0.2, 0.0)
    """
    axis = None if name.startswith(_SHIFTS) else _AXES.get(name.rpartition(".")[2])
    return 0.0 if axis is None else float(origin_m[axis])


def in_scan_frame(values: Mapping[str, float], origin_m: np.ndarray) -> dict[str, float]:
    """Return parameters of the body's frame in the frame of the scan."""
    return {name: value + frame_shift_m(name, origin_m) for name, value in values.items()}


def evidence(
    effect: Effect, values: Mapping[str, float], readings: Readings, origin_m: np.ndarray
) -> str:
    """Return an effect's evidence with all places in the frame of the scan.

    Parameters
    ----------
    values, readings : in the body's frame
    """
    shifts = {name: frame_shift_m(f"{effect.name}.{name}", origin_m) for name in values}
    there = {name: value + shifts[name] for name, value in values.items()}
    scales = replace(readings.scales, middle_m=readings.scales.middle_m + origin_m)
    moved = replace(readings, point_m=readings.point_m + origin_m, stated=scales)
    return effect.evidence(there, moved)
