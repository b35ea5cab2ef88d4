"""Orientations as robots write them: quaternion, rotation vector, angles in turn, or matrix."""

from __future__ import annotations

import re

import numpy as np
from scipy.spatial.transform import Rotation

UNIT_LENGTH = 0.02  # off one: a quaternion or a column of a matrix that is none
USUAL = {3: "vector", 4: "xyzw", 9: "rows"}
"""Order of so many columns where none is stated."""
ORDERS = {
    3: '"vector" (axis times angle) or turns in order such as "ZYX" (about the axes as they are '
    'by then) or "xyz" (about axes that stay)',
    4: '"xyzw" or "wxyz"',
    9: '"rows" or "columns"',
}
_TURNS = re.compile(r"(?:([xyz])(?!\1)([xyz])(?!\2)[xyz]|([XYZ])(?!\3)([XYZ])(?!\4)[XYZ])$")


def fits_order(count: int, order: str) -> bool:
    """Whether so many columns can stand in an order.

    >>> fits_order(3, "ZYX"), fits_order(3, "ZZX"), fits_order(4, "ZYX")
    (True, False, False)
    """
    if count == 3:
        return order == "vector" or _TURNS.match(order) is not None
    return order in {4: ("xyzw", "wxyz"), 9: ("rows", "columns")}[count]


def quaternions(values: np.ndarray, order: str) -> tuple[np.ndarray, np.ndarray]:
    """Return quaternions (m, 4) in the order w, x, y, z, and which rows are no orientation, (m,).

    Parameters
    ----------
    values : (m, 3), angles in rad; (m, 4) or (m, 9); NaN where there is none
    order : see `ORDERS`; of a matrix, the axis that runs slowest

    Examples
    --------
    >>> half_turn = [[np.pi, 0.0, 0.0]]
    >>> quaternions(np.array(half_turn), "vector")[0].round(6).tolist()
    [[0.0, 1.0, 0.0, 0.0]]
    """
    known = np.isfinite(values).all(axis=1)
    result = np.full((len(values), 4), np.nan)
    good = values[known]
    bad = np.zeros(len(values), dtype=bool)
    if values.shape[1] == 4:
        bad[known] = np.abs(np.linalg.norm(good, axis=1) - 1) > UNIT_LENGTH
        result[known] = np.roll(good, 1, axis=1) if order == "xyzw" else good
        return result, bad
    if values.shape[1] == 9:
        turns = good.reshape(-1, 3, 3)
        turns = turns if order == "rows" else turns.swapaxes(1, 2)
        off = turns @ turns.swapaxes(1, 2) - np.eye(3)
        bad[known] = (np.abs(off).max(axis=(1, 2)) > UNIT_LENGTH) | (np.linalg.det(turns) < 0)
        found = Rotation.from_matrix(turns[~bad[known]])
    elif order == "vector":
        found = Rotation.from_rotvec(good)
    else:
        found = Rotation.from_euler(order, good)
    result[known & ~bad] = np.roll(found.as_quat(), 1, axis=1)
    return result, bad
