"""A contact is a weight vector: B_j[i] = int p_j(x) N_i(x) d_j dA, with int p_j dA = 1.

The same weights make the load (F B_j) and the reading (B_j' u), so the error of a compliance is of
second order in the error of the assumed pressure p_j.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from fem.contact.half_space import FLAT, HERTZ
from fem.errors import MeshError
from fem.linear.assembly import shape_functions
from fem.mesh.mesh import Mesh
from fem.mesh.surface import Surface

DISC_RULE = (10, 32)  # rings and sectors of the quadrature over a tip


@dataclass(frozen=True)
class Contacts:
    """Presses of a tip on a body.

    Attributes
    ----------
    points_m : (j, 3) contact points on the undeformed surface
    directions : (j, 3) unit vectors into the body
    radius_m : (j,) radius of the contact (ignored by "nodal")
    profile : "flat" (rigid punch, p ~ 1/sqrt(1 - r^2/a^2)), "hertz" (p ~ sqrt(1 - r^2/a^2)) or
        "nodal" (the nearest node carries the force, as in the paper)
    curvature_per_m : (j,) mean curvature of the body's surface under the tips, convex positive;
        no compliance has it in it, but the gap beside a ball
    """

    points_m: np.ndarray
    directions: np.ndarray
    radius_m: np.ndarray
    profile: str = "flat"
    curvature_per_m: np.ndarray | float = 0.0

    def __post_init__(self) -> None:
        points = np.atleast_2d(np.array(self.points_m, float))
        directions = np.array(self.directions, float)
        radius = np.array(self.radius_m, float)
        j = len(points)
        if (
            not points.size
            or points.shape != (j, 3)
            or directions.shape not in ((3,), (1, 3), (j, 3))
            or radius.shape not in ((), (1,), (j,))
        ):
            raise MeshError(
                "contacts need points (j, 3) of one press at least, directions (3,) or (j, 3) and "
                f"one radius or (j,); got {points.shape}, {directions.shape} and {radius.shape}"
            )
        if not np.isfinite(points).all():
            raise MeshError("contact points must be finite, in m")
        directions = np.broadcast_to(directions, points.shape).copy()
        radius = np.broadcast_to(radius, j).copy()
        if self.profile not in ("flat", "hertz", "nodal"):
            raise MeshError(f"contact profile is 'flat', 'hertz' or 'nodal', got '{self.profile}'")
        if not np.allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6):
            raise MeshError("press directions must be unit vectors")
        if self.profile != "nodal" and not (radius > 0).all():
            raise MeshError("contact radii must be positive")
        curvature = np.broadcast_to(np.asarray(self.curvature_per_m, float), j).copy()
        for name, array in (
            ("points_m", points),
            ("directions", directions),
            ("radius_m", radius),
            ("curvature_per_m", curvature),
        ):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.points_m)

    def some(self, presses: np.ndarray) -> Contacts:
        """Return some of the presses, by their indices (k,)."""
        return Contacts(
            self.points_m[presses], self.directions[presses], self.radius_m[presses],
            self.profile, np.asarray(self.curvature_per_m)[presses],
        )  # fmt: skip

    def same_presses(self, other: Contacts) -> bool:
        """Return True if the other presses are the same."""
        return self.profile == other.profile and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("points_m", "directions", "radius_m")
        )

    @property
    def profile_code(self) -> int:
        """The number by which `fem.contact.half_space` knows the pressure profile."""
        return HERTZ if self.profile == "hertz" else FLAT


def contact_frame(direction: np.ndarray) -> np.ndarray:
    """Rotation whose rows are two tangents and the press direction, (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first), direction])


def contact_weights(
    mesh: Mesh, contacts: Contacts, rule: tuple[int, int] = DISC_RULE
) -> np.ndarray:
    """Weights of all contacts as nodal vectors, (j, n, 3), 1.

    Raises
    ------
    MeshError
        A tip that hangs over the edge of the surface; the press is named.
    """
    weights = np.zeros((len(contacts), len(mesh.nodes), 3))
    if contacts.profile == "nodal":
        distance, node = _nearest_nodes(mesh, contacts.points_m)
        spacing = np.cbrt(mesh.volume / len(mesh.cells))
        if distance.max() > 0.1 * spacing:
            worst = int(distance.argmax())
            raise MeshError(f"press {worst}: no node within {0.1 * spacing:.2g} m of the contact "
                            "point; a nodal force needs a point at a node")  # fmt: skip
        weights[np.arange(len(contacts)), node] = contacts.directions
        return weights
    surface = PressedSurface(mesh)
    for j in range(len(contacts)):
        nodes, scalar = surface.weights(contacts, j, rule)
        weights[j, nodes] = scalar[:, None] * contacts.directions[j]
    return weights


def _nearest_nodes(mesh: Mesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used = np.unique(mesh.boundary)
    distance = np.linalg.norm(points[:, None] - mesh.nodes[used], axis=2)
    nearest = distance.argmin(axis=1)
    return distance[np.arange(len(points)), nearest], used[nearest]


@cache
def disc_quadrature(
    profile: int, rule: tuple[int, int] = DISC_RULE
) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y) of the unit disc, and weights that hold the pressure and sum to one.

    With s = sqrt(1 - r^2) the flat punch has uniform weight in s, the Hertz pressure 3 s^2. Both
    arrays are kept, and not to be written to.
    """
    rings, sectors = rule
    s, w = np.polynomial.legendre.leggauss(rings)
    s, w = (s + 1) / 2, w / 2
    if profile == HERTZ:
        w = w * 3 * s**2
    angle = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    r = np.sqrt(1 - s**2)
    points = np.stack([np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle))], axis=-1)
    points, weights = points.reshape(-1, 2), np.repeat(w / sectors, sectors)
    for array in (points, weights):
        array.setflags(write=False)
    return points, weights


class Footprint(NamedTuple):
    """Points of a body's surface under points of a tip's plane.

    Attributes
    ----------
    hit : (p,) bool, true where a surface lies under the point; the rest holds only there
    face : (p,) number of the boundary face
    barycentric : (p, 3) place in it
    depth : (p,) m below the tip's plane
    """

    hit: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    depth: np.ndarray


class PressedSurface:
    """Boundary faces, ready for projecting the points of a disc onto them along a direction."""

    def __init__(self, body: Mesh | Surface) -> None:
        if isinstance(body, Surface):
            self.nodes, self.faces, self.order = body.vertices, body.triangles, 1
        else:
            self.nodes, self.faces, self.order = body.nodes, body.boundary, body.order
        corners = self.nodes[self.faces[:, :3]]
        self.normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.corners = corners
        self.centres = corners.mean(axis=1)
        self.reach = np.linalg.norm(corners - self.centres[:, None], axis=2).max(axis=1)

    def under(
        self, centre: np.ndarray, frame: np.ndarray, points: np.ndarray, radius: float
    ) -> Footprint:
        """Project points (p, 2) m of the plane of a tip of that radius along its direction.

        `frame` (3, 3) has two tangents and the direction as rows.
        """
        # Faces that look against the press and reach the cylinder below the points
        offset = (self.centres - centre) @ frame.T
        widest = np.linalg.norm(points, axis=1).max()
        near = (self.normals @ frame[2] < 0) & (
            np.hypot(offset[:, 0], offset[:, 1]) < widest + self.reach
        )
        near &= np.abs(offset[:, 2]) < 2 * radius + self.reach
        index = np.flatnonzero(near)
        if not len(index):
            nothing = np.zeros(len(points))
            return Footprint(nothing > 0, nothing.astype(int), np.zeros((len(points), 3)), nothing)
        local = (self.corners[index] - centre) @ frame.T  # (t, 3, 3)
        barycentric = _barycentric_2d(local[:, :, :2], points)  # (p, t, 3)
        depth = np.einsum("ptv,tv->pt", barycentric, local[:, :, 2])
        # Where faces overlap in projection, the one nearest to the tip's plane is pressed
        rank = np.where(barycentric.min(axis=2) > -1e-7, np.abs(depth), np.inf)
        chosen = rank.argmin(axis=1)
        each = np.arange(len(points))
        return Footprint(
            np.isfinite(rank[each, chosen]),
            index[chosen],
            barycentric[each, chosen],
            depth[each, chosen],
        )

    def bears(self, contacts: Contacts) -> np.ndarray:
        """Return True for each press whose whole tip lies on the surface, (j,)."""
        disc, _ = disc_quadrature(contacts.profile_code)
        return np.array([self._beneath(contacts, j, disc).hit.all() for j in range(len(contacts))])

    def _beneath(self, contacts: Contacts, j: int, disc: np.ndarray) -> Footprint:
        centre, radius = contacts.points_m[j], contacts.radius_m[j]
        return self.under(centre, contact_frame(contacts.directions[j]), disc * radius, radius)

    def weights(
        self, contacts: Contacts, j: int, rule: tuple[int, int] = DISC_RULE
    ) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and scalar weights of press j."""
        centre, radius = contacts.points_m[j], contacts.radius_m[j]
        disc, weight = disc_quadrature(contacts.profile_code, rule)
        under = self._beneath(contacts, j, disc)
        if not under.hit.all():
            x, y, z = centre * 1e3
            raise MeshError(
                f"press {j}: the tip of radius {radius * 1e3:.3g} mm at "
                f"({x:.1f}, {y:.1f}, {z:.1f}) mm hangs over the edge of the body or does not lie "
                "on its surface; move the contact point inwards or check the body's size and place"
            )
        shape = shape_functions(under.barycentric, self.order)
        faces = self.faces[under.face]
        total = sp.coo_array((
            (shape * weight[:, None]).ravel(), (np.zeros(faces.size, int), faces.ravel())
        )).tocsr()  # fmt: skip
        total.sum_duplicates()
        return total.indices, total.data


def _barycentric_2d(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of points (p, 2) in triangles (t, 3, 2): (p, t, 3)."""
    edge = np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], axis=2)
    relative = points[:, None] - triangles[:, 0]
    determinant = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    safe = np.where(np.abs(determinant) > 0, determinant, np.nan)
    second = (relative[..., 0] * edge[:, 1, 1] - relative[..., 1] * edge[:, 0, 1]) / safe
    third = (edge[:, 0, 0] * relative[..., 1] - edge[:, 1, 0] * relative[..., 0]) / safe
    result = np.stack([1 - second - third, second, third], axis=2)
    return np.nan_to_num(result, nan=-1.0)
