"""The surface of the body that is pressed: points and normals on it, lines through it.

The body frame is that of the plan; z points up from the base. A normal under a tip is the mean of
the faces that the tip covers, so that a faceted surface gives the normal of the shape behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import KDTree

from models import InputError

STEEPEST_DEG = 60.0
"""Largest angle between a press and the vertical in a cover of the surface."""

EDGE_SHARE = 0.02  # of a surface's height: presses keep so far from the base's rim
CANDIDATES = 40  # points of the surface for each press of a cover
DROPPED = 0.3  # tip radii around a point where no tip can stand, which are left out
WIDEST = 5.0  # triangles of a curved surface, in radii of the disc under a tip
SPANS_EDGE = 0.5  # least cosine between the faces under a tip and the press
BENT = np.array([0.5, 1.0, 1.4])  # rings for the curvature, in radii
RINGS, SECTORS = np.array([0.35, 0.7, 1.0]), 12  # of the points under a tip
INSIDE = -1e-9  # least barycentric coordinate of a hit


class Footing(NamedTuple):
    """Place of a tip on the surface.

    Attributes
    ----------
    points_m : (j, 3)
    normals : (j, 3) unit, outwards
    borne : (j,) bool, the whole tip lies on the surface
    """

    points_m: np.ndarray
    normals: np.ndarray
    borne: np.ndarray


@dataclass(frozen=True)
class BodySurface:
    """A closed surface of triangles.

    Attributes
    ----------
    vertices_m : (n, 3) body frame
    triangles : (t, 3) vertex numbers, seen from outside anticlockwise
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    _corner: np.ndarray = field(init=False, repr=False)
    _edges: tuple[np.ndarray, np.ndarray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        a, b, c = (self.vertices_m[self.triangles[:, i]] for i in range(3))
        object.__setattr__(self, "_corner", a)
        object.__setattr__(self, "_edges", (b - a, c - a))

    @classmethod
    def block(cls, size_m: tuple[float, float, float]) -> BodySurface:
        """Return the surface of a block that starts at the origin.

        Examples
        --------
        >>> BodySurface.block((2.0, 3.0, 4.0)).normals.sum(axis=0).tolist()
        [0.0, 0.0, 0.0]
        """
        corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
        sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
        return cls(corners * np.asarray(size_m), np.array(triangles))

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals of the triangles, outwards, (t, 3)."""
        return self._normal_vectors / np.linalg.norm(self._normal_vectors, axis=1, keepdims=True)

    @cached_property
    def _normal_vectors(self) -> np.ndarray:
        return np.cross(*self._edges)

    @property
    def lowest_m(self) -> np.ndarray:
        """Lower corner of the bounding box, (3,)."""
        return self.vertices_m.min(axis=0)

    @property
    def extent_m(self) -> np.ndarray:
        """Edges of the bounding box, (3,)."""
        return np.ptp(self.vertices_m, axis=0)

    def along(self, starts: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distance from points (p, 3) to each triangle along a unit direction, (p, t) m.

        Negative behind the point, NaN where the line misses the triangle (Moeller and Trumbore,
        J. Graphics Tools 1997).
        """
        first, second = self._edges
        across = np.cross(direction, second)
        determinant = np.einsum("ti,ti->t", first, across)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / determinant
            offset = starts[:, None] - self._corner
            u = np.einsum("pti,ti->pt", offset, across) * inverse
            turned = np.cross(offset, first)
            v = (turned @ direction) * inverse
            distance = np.einsum("pti,ti->pt", turned, second) * inverse
            hit = (u > INSIDE) & (v > INSIDE) & (u + v < 1 - INSIDE)
        return np.where(hit, distance, np.nan)

    def thickness_m(self, point: np.ndarray, direction: np.ndarray) -> float:
        """Length of a line inside the body, from a point of the surface to where it comes out."""
        way = self.along(np.asarray(point, float)[None], np.asarray(direction, float))[0]
        leaving = (self._normal_vectors @ direction > 0) & (way > 1e-6)
        return float(way[leaving].min()) if leaving.any() else 0.0

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return True for points (p, 3) inside the body."""
        aslant = np.array([0.0123, 0.0271, 0.9996])  # not along the faces of a block
        aslant /= np.linalg.norm(aslant)
        return (self.along(np.atleast_2d(points), aslant) > 0).sum(axis=1) % 2 == 1

    def top(self, xy_m: np.ndarray) -> np.ndarray:
        """Highest points of the surface at places (j, 2), (j, 3) m; NaN beside the body."""
        below = np.column_stack([xy_m, np.full(len(xy_m), self.lowest_m[2] - 1.0)])
        up = np.array([0.0, 0.0, 1.0])
        way = np.where(self.normals[:, 2] > 0, self.along(below, up), np.nan)
        highest = np.nanmax(np.where(np.isnan(way), -np.inf, way), axis=1)
        found = np.where(np.isfinite(highest), highest, np.nan)
        return below + found[:, None] * up

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Closest points of the surface to points (j, 3), and their triangles (j,)."""
        found = np.empty((len(points), 3))
        faces = np.empty(len(points), int)
        for j, point in enumerate(np.asarray(points, float)):
            near = _closest_on_triangles(point, self._corner, *self._edges)
            faces[j] = np.argmin(((near - point) ** 2).sum(axis=1))
            found[j] = near[faces[j]]
        return found, faces

    def footing(self, points: np.ndarray, radius_m: np.ndarray | float) -> Footing:
        """Return the normals under tips of a radius at points (j, 3) on or near the surface."""
        placed, faces = self.closest(points)
        radii = np.broadcast_to(radius_m, len(placed))
        normals = self.normals[faces].copy()
        borne = np.ones(len(placed), bool)
        for j, (point, radius) in enumerate(zip(placed, radii, strict=True)):
            for _ in range(2):
                normals[j], borne[j] = self._mean_normal(point, normals[j], float(radius))
        return Footing(placed, normals, borne)

    def bends(self, points: np.ndarray, normals: np.ndarray, radius_m: np.ndarray) -> np.ndarray:
        """Mean curvature of the surface under discs of given radii (j,), convex positive, 1/m.

        That of the shape behind the triangles, where these are wider than the disc.
        """
        angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        disc = (BENT[:, None, None] * circle).reshape(-1, 2)
        square = np.repeat(BENT**2 / 2, SECTORS)
        found = np.zeros(len(points))
        _, faces = self.closest(points)
        width = np.sqrt(np.linalg.norm(np.cross(*self._edges), axis=1))[faces]
        wide = np.where(width < WIDEST * radius_m, np.maximum(width, radius_m), radius_m)
        for j, (point, normal, radius) in enumerate(zip(points, normals, wide, strict=True)):
            near, frame = self._near(point, 2.5 * radius), _tangents(normal)
            way = near.along(point + radius * disc @ frame, -normal)
            way = np.where((near.normals @ normal > 0) & (np.abs(way) < radius), way, np.inf)
            depth = way.min(axis=1)
            hit = np.isfinite(depth)
            # With a height of its own: the point may lie in a triangle or at a corner
            found[j] = np.polyfit(square[hit], depth[hit], 1)[0] / radius**2
        return found

    def bears(self, points: np.ndarray, normals: np.ndarray, radius_m: np.ndarray) -> np.ndarray:
        """Return True where a tip pressed against given normals (j, 3) lies on the surface."""
        rows = zip(points, normals, radius_m, strict=True)
        return np.array([self._mean_normal(p, n, float(r))[1] for p, n, r in rows])

    def _mean_normal(
        self, point: np.ndarray, normal: np.ndarray, radius: float
    ) -> tuple[np.ndarray, bool]:
        frame = _tangents(normal)
        angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
        disc = (RINGS[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(
            -1, 2
        )
        near = self._near(point, 2.5 * radius)
        way = near.along(point + radius * disc @ frame, -normal)
        way = np.where(near.normals @ normal > 0, way, np.nan)
        hit = np.isfinite(way) & (np.abs(way) < radius)
        under = np.where(hit, np.abs(way), np.inf).argmin(axis=1)
        met = hit.any(axis=1)
        faces = near.normals[under[met]]
        steep = not met.all() or (faces @ normal < SPANS_EDGE).any()
        mean = faces.sum(axis=0) if met.any() else normal
        return mean / np.linalg.norm(mean), not steep

    def _near(self, point: np.ndarray, reach: float) -> BodySurface:
        """Return the triangles that come within a distance of a point."""
        a, (first, second) = self._corner, self._edges
        away = a + (first + second) / 3 - point
        size = np.linalg.norm(first, axis=1) + np.linalg.norm(second, axis=1)
        kept = np.linalg.norm(away, axis=1) < reach + size
        return BodySurface(self.vertices_m, self.triangles[kept]) if kept.any() else self

    def cover(
        self, count: int, radius_m: float, steepest_deg: float = STEEPEST_DEG, seed: int = 0
    ) -> Footing:
        """Spread presses evenly over the upper surface, in an order without long ways.

        The presses stand at the centres of equal parts of the surface (k-means of points drawn
        evenly over its area), where the whole tip lies on it.

        Parameters
        ----------
        count : of the presses
        radius_m : of the tip
        steepest_deg : largest angle of a press to the vertical
        seed : of the draw

        Raises
        ------
        InputError
            The surface has no room for the tip.
        """
        if count < 1:
            raise InputError(f"A cover of {count} presses; give one press or more.")
        rng = np.random.default_rng([seed, 5])
        kept = self._drawn(max(CANDIDATES * count, 600), steepest_deg, rng)
        while len(kept) >= count:
            chosen = self.footing(_even(kept, count), radius_m)
            good = chosen.borne & (chosen.normals[:, 2] >= np.cos(np.radians(steepest_deg)))
            if good.all():
                order = _rows(chosen.points_m)
                return Footing(*(part[order] for part in chosen))
            away = KDTree(chosen.points_m[~good]).query(kept)[0]
            kept = kept[away > DROPPED * radius_m]
        raise InputError(
            f"The body's upper surface has no room for {count} presses with a tip of "
            f"{radius_m * 1e3:g} mm radius within {steepest_deg:g} degrees of level: a smaller tip "
            "or fewer presses are needed."
        )

    def _drawn(self, count: int, steepest_deg: float, rng: np.random.Generator) -> np.ndarray:
        """Points drawn evenly over the area of the faces that are not too steep, (count, 3)."""
        area = np.linalg.norm(self._normal_vectors, axis=1)
        area = np.where(self.normals[:, 2] >= np.cos(np.radians(steepest_deg)), area, 0.0)
        if not area.any():
            raise InputError(
                f"No part of the body's surface is within {steepest_deg:g} degrees of level."
            )
        face = rng.choice(len(area), size=count, p=area / area.sum())
        u, v = np.sort(rng.random((2, count)), axis=0)
        first, second = self._edges
        points = self._corner[face] + u[:, None] * first[face] + (v - u)[:, None] * second[face]
        floor = self.lowest_m[2] + EDGE_SHARE * self.extent_m[2]
        return points[points[:, 2] > floor]


def _tangents(normal: np.ndarray) -> np.ndarray:
    """Two unit vectors across a normal, (2, 3)."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def _even(points: np.ndarray, count: int) -> np.ndarray:
    """Points (count, 3) of many that divide them into even parts."""
    middle = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())
    chosen, nearest = [middle], np.full(len(points), np.inf)
    for _ in range(count - 1):  # farthest-point sampling starts k-means well apart
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    centres, _ = kmeans2(points, points[chosen], minit="matrix", iter=25)
    free, found = np.ones(len(points), bool), []
    for centre in centres:  # two centres may have one nearest point
        away = np.where(free, ((points - centre) ** 2).sum(axis=1), np.inf)
        found.append(int(away.argmin()))
        free[found[-1]] = False
    return points[found]


def _rows(points: np.ndarray) -> np.ndarray:
    """Order of points (j, 3) along x in rows of y, to and fro."""
    if len(points) < 4:
        return np.argsort(points[:, 0], kind="stable")
    tree = KDTree(points)
    spacing = float(np.median(tree.query(points, k=2)[0][:, 1]))
    row = np.floor((points[:, 1] - points[:, 1].min()) / max(spacing, 1e-9)).astype(int)
    towards = np.where(row % 2 == 0, points[:, 0], -points[:, 0])
    return np.lexsort((towards, row))


def _closest_on_triangles(
    point: np.ndarray, corner: np.ndarray, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """Closest point of each triangle to a point, (t, 3): the inside, or the nearest edge."""
    away = point - corner
    aa, ab = np.einsum("ti,ti->t", first, first), np.einsum("ti,ti->t", first, second)
    bb = np.einsum("ti,ti->t", second, second)
    pa, pb = np.einsum("ti,ti->t", away, first), np.einsum("ti,ti->t", away, second)
    determinant = np.maximum(aa * bb - ab * ab, 1e-300)
    u, v = (bb * pa - ab * pb) / determinant, (aa * pb - ab * pa) / determinant
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    best = corner + u[:, None] * first + v[:, None] * second
    distance = np.where(inside, ((best - point) ** 2).sum(axis=1), np.inf)
    for start, edge in ((corner, first), (corner, second), (corner + first, second - first)):
        length = np.maximum(np.einsum("ti,ti->t", edge, edge), 1e-300)
        along = np.clip(np.einsum("ti,ti->t", point - start, edge) / length, 0, 1)
        near = start + along[:, None] * edge
        squared = ((near - point) ** 2).sum(axis=1)
        best = np.where((squared < distance)[:, None], near, best)
        distance = np.minimum(distance, squared)
    return best
