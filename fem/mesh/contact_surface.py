"""The upper surface of a body, z over x and y, through points where a tip touched it.

A thin-plate spline through the points and, beside each, four more in the plane that its press
direction says (within `_BESIDE` of the points' spacing): a coarse grid on a curved body tells its
curvature by the directions. They are used where they help to predict points left out (eight-fold
cross-validation); smoothing is what predicts the heights of these best, or, where directions are
used, their slopes.
Beyond the points' hull the surface goes on with its slope and levels out: a spline would run away.

Finite elements carry no shape finer than their cells. Vertices on a surface that is rougher make a
polyhedron whose edges are sharper than anything on the body: of 80 presses on a scanned silicone
organ (cells of 6.6 mm) one in twenty came out more than a tenth too stiff, the worst by half. A
body is therefore meshed under the surface `smoothed` over its cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import RBFInterpolator, RectBivariateSpline
from scipy.ndimage import gaussian_filter
from scipy.spatial import ConvexHull, KDTree

from fem.errors import FoldedSurfaceError, MeshError

FEWEST_POINTS = 10
STEEPEST_DEG = 75.0  # between two points: a steeper surface is folded, or a point is wrong
_SAME_M = 2e-4  # points nearer than this in x and y are repeats of one
_FOLD_M = 1e-3  # difference in height below which nearness is no fold
_NARROW = 0.05  # width over length of points that lie on a line
_BESIDE = 0.1  # of the spacing, to the points in the plane of a press
_MOST_TANGENTS = 250  # points with directions used: more are dense enough without
_SMOOTHINGS = (0.0, 0.03, 0.3, 3.0, 30.0)
_TRIED = 200  # points of the cross-validation
_FOLDS = 8
_FINER = 4  # points of the smoothed surface along its length


@dataclass(frozen=True, eq=False)
class ContactSurface:
    """Height over x and y.

    Attributes
    ----------
    points_m : (j, 3) points that it was made from, repeats merged
    smoothing : of the spline, 0 goes through all points
    with_directions : whether the press directions shaped it
    error_m : root mean square error of heights of points left out
    level_m : distance over which it levels out beyond the points
    """

    points_m: np.ndarray
    smoothing: float
    with_directions: bool
    error_m: float
    level_m: float
    _spline: RBFInterpolator
    _spacing_m: float

    @classmethod
    def through(cls, points_m: np.ndarray, directions: np.ndarray) -> ContactSurface:
        """Fit the surface.

        Parameters
        ----------
        points_m : (j, 3), z up
        directions : (j, 3) unit vectors into the body

        Raises
        ------
        MeshError
            Fewer than ten different points, points on a line, or points one above another.
        """
        points, inward = _merged(np.asarray(points_m, float), np.asarray(directions, float))
        _refuse(points)
        hull = ConvexHull(points[:, :2])
        spacing = float(np.sqrt(hull.volume / len(points)))
        errors = [_left_out(points, inward, spacing, s, False) for s in _SMOOTHINGS]
        best = min(range(len(errors)), key=lambda k: errors[k][0])
        error_m, with_directions = errors[best][0], False
        if len(points) <= _MOST_TANGENTS:
            errors = [_left_out(points, inward, spacing, s, True) for s in _SMOOTHINGS]
            with_directions = min(heights for heights, _ in errors) < error_m
            if with_directions:
                best = min(range(len(errors)), key=lambda k: errors[k][1])
                error_m = errors[best][0]
        smoothing = _SMOOTHINGS[best]
        spline = _spline(points, inward if with_directions else None, spacing, smoothing)
        return cls(points, smoothing, with_directions, error_m, 2 * spacing, spline, spacing)

    def heights(self, xy_m: np.ndarray) -> np.ndarray:
        """Heights (p,) m at places (p, 2) m."""
        return self._spline(self._within(np.asarray(xy_m, float)) / self._spacing_m)

    def inward_normals(self, xy_m: np.ndarray) -> np.ndarray:
        """Return the unit normals (p, 3) into the body at places (p, 2) m."""
        step = 0.02 * self._spacing_m
        by_x, by_y = (
            (self.heights(xy_m + e) - self.heights(xy_m - e)) / (2 * step) for e in step * np.eye(2)
        )
        return _unit(by_x, by_y)

    def smoothed(
        self,
        length_m: float,
        low_m: np.ndarray,
        high_m: np.ndarray,
        base_m: float = -np.inf,
        clear_m: float = 0.0,
    ) -> SmoothedSurface:
        """Return the surface averaged over a length, m, between corners (2,) m of x and y.

        Where it comes nearer to a base at height `base_m` than `clear_m` it is lifted first: to
        half of that where it would lie in the base, and less, smoothly, above.
        """
        aside = 6 * length_m
        x, y = axes = [
            np.linspace(a - aside, b + aside, math.ceil(_FINER * (b - a + 2 * aside) / length_m))
            for a, b in zip(low_m, high_m, strict=True)
        ]
        rough = self.heights(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2))
        if clear_m:
            over = np.maximum(rough - base_m, 0)
            lifted = base_m + (clear_m + over**2 / clear_m) / 2
            rough = np.where(over < clear_m, lifted, rough)
        width = [length_m / (axis[1] - axis[0]) for axis in axes]
        once = gaussian_filter(rough.reshape(*map(len, axes)), width, mode="nearest")
        smooth = 2 * once - gaussian_filter(once, width, mode="nearest")
        return SmoothedSurface(RectBivariateSpline(x, y, smooth))

    @cached_property
    def _corners(self) -> np.ndarray:
        return self.points_m[ConvexHull(self.points_m[:, :2]).vertices, :2]

    def _within(self, xy: np.ndarray) -> np.ndarray:
        """Places in the hull as they are; others, at a distance s, at L (1 - exp(-s/L))."""
        a = self._corners
        b = np.roll(a, -1, axis=0)
        along, away = b - a, xy[:, None] - a  # (c, 2), (p, c, 2)
        share = np.einsum("pci,ci->pc", away, along) / np.einsum("ci,ci->c", along, along)
        foot = a + np.clip(share, 0, 1)[..., None] * along
        distance = np.linalg.norm(xy[:, None] - foot, axis=2)
        edge = distance.argmin(axis=1)
        each = np.arange(len(xy))
        foot, distance = foot[each, edge], distance[each, edge]
        cross = along[:, 0] * away[..., 1] - along[:, 1] * away[..., 0]  # corners counter-clockwise
        outside = (cross < 0).any(axis=1) & (distance > 0)
        kept = self.level_m * -np.expm1(-distance[outside] / self.level_m)
        result = xy.copy()
        result[outside] = foot[outside] + (kept / distance[outside])[:, None] * (
            xy[outside] - foot[outside]
        )
        return result


@dataclass(frozen=True, eq=False)
class SmoothedSurface:
    """A surface through contact points, smoothed; a paraboloid stays as it is.

    Twice the mean under a Gaussian of a standard deviation, less the mean of that mean.
    """

    _spline: RectBivariateSpline

    def heights(self, xy_m: np.ndarray) -> np.ndarray:
        """Heights (p,) m at places (p, 2) m."""
        x, y = np.asarray(xy_m, float).T
        return self._spline.ev(x, y)

    def inward_normals(self, xy_m: np.ndarray) -> np.ndarray:
        """Return the unit normals (p, 3) into the body at places (p, 2) m."""
        x, y = np.asarray(xy_m, float).T
        return _unit(self._spline.ev(x, y, dx=1), self._spline.ev(x, y, dy=1))


def _unit(by_x: np.ndarray, by_y: np.ndarray) -> np.ndarray:
    """Return the unit normals (p, 3) into a body under a surface of those slopes."""
    normals = np.column_stack([by_x, by_y, -np.ones(len(by_x))])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _merged(points: np.ndarray, inward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge points that are repeats of one, with the mean of their heights and directions."""
    _, first, group = np.unique(
        np.rint(points[:, :2] / _SAME_M), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)  # in the order of the scan
    number = np.empty(len(order), int)
    number[order] = np.arange(len(order))
    group, count = number[group.ravel()], np.bincount(group.ravel())[order]

    def mean(values: np.ndarray) -> np.ndarray:
        total = np.zeros((len(count), 3))
        np.add.at(total, group, values)
        return total / count[:, None]

    direction = mean(inward)
    return mean(points), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _refuse(points: np.ndarray) -> None:
    """Refuse points that make no surface."""
    if len(points) < FEWEST_POINTS:
        raise MeshError(
            f"a surface from contact points needs at least {FEWEST_POINTS} different places, found "
            f'{len(points)}; press at more places, or state a block (shape = "block")'
        )
    centred = points[:, :2] - points[:, :2].mean(axis=0)
    length, width = np.linalg.svd(centred, compute_uv=False)
    if width < _NARROW * length:
        raise MeshError(
            f"the {len(points)} contact points lie on a line in x and y, which spans no surface; "
            'press beside the line too, or state a block (shape = "block")'
        )
    # Any: the declared type depends on k
    near: Any = KDTree(points[:, :2]).query(points[:, :2], k=min(5, len(points)))
    distance, other = near[0][:, 1:], near[1][:, 1:]
    rise = np.abs(points[other, 2] - points[:, None, 2])
    folded = (rise > np.tan(np.radians(STEEPEST_DEG)) * distance) & (rise > _FOLD_M)
    if folded.any():
        one, place = np.argwhere(folded)[int(np.argmax((rise / distance)[folded]))]
        two = other[one, place]
        at = [", ".join(f"{1e3 * c:.1f}" for c in points[k]) for k in (one, two)]
        raise FoldedSurfaceError(
            f"the contact points ({at[0]}) and ({at[1]}) mm lie nearly one above the other "
            f"({int(folded.any(axis=1).sum())} such of {len(points)}): the surface would be "
            "folded; remove presses that touched too early or too late, or give a closed surface "
            '(shape = "surface")',
            points[[one, two]],
        )


def _spline(
    points: np.ndarray, inward: np.ndarray | None, spacing: float, smoothing: float
) -> RBFInterpolator:
    if inward is not None:
        points = np.vstack([points, _beside(points, inward, _BESIDE * spacing)])
    return RBFInterpolator(
        points[:, :2] / spacing, points[:, 2], smoothing=smoothing, kernel="thin_plate_spline"
    )


def _beside(points: np.ndarray, inward: np.ndarray, aside_m: float) -> np.ndarray:
    """Four points (4 j, 3) beside each, along x and y in the plane that its direction says."""
    aside = aside_m * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    rise = -inward[:, :2] @ aside.T / inward[:, 2:]
    beside = np.dstack([np.broadcast_to(aside, (len(points), 4, 2)), rise])
    return (points[:, None] + beside).reshape(-1, 3)


def _left_out(
    points: np.ndarray, inward: np.ndarray, spacing: float, smoothing: float, with_directions: bool
) -> tuple[float, float]:
    """Root mean square error at points left out, an eighth at a time, m; and of slopes there."""
    tested = np.random.default_rng(0).permutation(len(points))[:_TRIED]
    heights, slopes = [], []
    for fold in range(_FOLDS):
        out = tested[fold::_FOLDS]
        kept = np.setdiff1d(tested, out)
        directions = inward[kept] if with_directions else None
        try:
            spline = _spline(points[kept], directions, spacing, smoothing)
        except np.linalg.LinAlgError:  # the rest lies on a line
            return np.inf, np.inf
        beside = _beside(points[out], inward[out], _BESIDE * spacing)
        error, other = (spline(at[:, :2] / spacing) - at[:, 2] for at in (points[out], beside))
        heights.append(error)
        slopes.append((other.reshape(-1, 4) - error[:, None]).ravel() / (_BESIDE * spacing))
    height_m, slope = (float(np.sqrt(np.mean(np.concatenate(e) ** 2))) for e in (heights, slopes))
    return height_m, slope
