"""The outline of a study's body: its box, its inside, and the height of its surface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from palpmap.study.contact_body import contact_body
from palpmap.study.study import Study

_ROUNDING = 1e-9  # of a triangle: a place on an edge lies in both


@dataclass(frozen=True, eq=False)
class Outline:
    """The body's box and its inside.

    Attributes
    ----------
    lower_m, upper_m : (3,)
        Corners of the box, body frame, m.
    inside : callable
        Points (p, 3) -> (p,) bool, True in the body.
    top : callable
        Places (p, 2) -> (p,) m, height of the surface there; NaN beside the body.
    """

    lower_m: np.ndarray
    upper_m: np.ndarray
    inside: Callable[[np.ndarray], np.ndarray]
    top: Callable[[np.ndarray], np.ndarray]


def study_outline(study: Study) -> Outline:
    """Return the body's box; of a surface, also its inside and its heights."""
    if study.body.size_m is not None:
        size = np.array(study.body.size_m)
        return Outline(
            np.zeros(3),
            size,
            lambda points: np.ones(len(points), dtype=bool),
            lambda places: np.full(len(places), size[2]),
        )
    if study.body.shape == "from-contacts":
        made = contact_body(study.body)
        low, high = made.box_m()
        return Outline(low, high, made.inside, made.surface.heights)
    import pyvista

    surface: Any = pyvista.read(str(study.body.file))
    lower, upper = np.array(surface.bounds).reshape(3, 2).T

    def inside(points: np.ndarray) -> np.ndarray:
        distance = pyvista.PolyData(np.asarray(points)).compute_implicit_distance(surface)
        return np.asarray(distance["implicit_distance"]) <= 0

    flat = surface.triangulate()
    triangles = np.asarray(flat.points[flat.regular_faces])

    def top(places: np.ndarray) -> np.ndarray:
        return _highest(triangles, np.asarray(places))

    return Outline(lower, upper, inside, top)


def _highest(triangles: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the greatest heights (p,) of triangles (t, 3, 3) over places (p, 2); else NaN."""
    corners = triangles[:, :, :2]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    near = KDTree(places).query_ball_point(centres, reach * (1 + 1e-9))
    triangle = np.repeat(np.arange(len(near)), [len(found) for found in near])
    place = np.concatenate([np.asarray(found, int) for found in near])
    first, *edges = np.moveaxis(triangles[triangle], 1, 0)
    (ax, ay, az), (bx, by, bz) = ((end - first).T for end in edges)
    x, y = (places[place] - first[:, :2]).T
    area = ax * by - ay * bx
    area = np.where(area == 0, np.nan, area)  # upright: over no place
    u, v = (x * by - y * bx) / area, (ax * y - ay * x) / area
    over = (u >= -_ROUNDING) & (v >= -_ROUNDING) & (u + v <= 1 + _ROUNDING)
    heights = np.full(len(places), -np.inf)
    np.maximum.at(heights, place[over], (first[:, 2] + u * az + v * bz)[over])
    return np.where(np.isfinite(heights), heights, np.nan)
