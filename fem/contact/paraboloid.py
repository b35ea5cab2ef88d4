"""The body's surface under a tip, as a paraboloid over the tip's plane that levels out beside it.

The near field of a press (`fem.near_field.enrichment`) is known on a half-space. It is bent onto
the body by measuring the depth from

    h(x, y) = c0 + c1 x + c2 y + (c3 x^2 + c4 x y + c5 y^2) / sqrt(1 + (r/L)^4),   L = 5 tip radii,

in the frame of the contact (axis 2 points into the body), so that its rim lies in the body's
surface. It is fitted under the tip and then lifted until no surface there lies above it: the exact
field has no continuation through the tip. On a plane all coefficients are zero.

The near field reaches cells many radii away, where a paraboloid is not what was fitted: under a
tip on the edge of two facets of a rough surface it bends strongly. Followed all the way, it made
presses on such edges of a scanned liver up to twice as stiff as they are.
"""

from __future__ import annotations

import numba
import numpy as np

from fem.contact.contacts import Contacts, PressedSurface, contact_frame
from fem.errors import MeshError
from fem.mesh.surface import Surface

LEVEL = 5.0  # tip radii beyond which the paraboloid levels out
REACH = 1.35  # tip radii within which no surface may lie above the paraboloid
_STEEPEST = 0.5  # least cosine between the press and the faces that it may touch
_FLAT = 1e-9  # relative to the tip's radius
_WIDEST = 4.0  # triangles of a curved surface, in contact radii
_RADII, _ANGLES = np.array([0.25, 0.5, 0.75, 0.9, 1.0, 1.1, 1.2, REACH]), 32


def contact_shape(
    surface: PressedSurface, centre: np.ndarray, frame: np.ndarray, radius: float
) -> np.ndarray:
    """Return the coefficients (6,) of the paraboloid under a tip, and 1/L^4.

    `centre` (3,) is the contact point in m. The rows of `frame` (3, 3) are two tangents and the
    press direction.
    """
    angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = (radius * _RADII[:, None, None] * circle).reshape(-1, 2)
    under = surface.under(centre, frame, points, radius)
    # Beyond an edge of the body lies nothing that the tip touches
    size = np.linalg.norm(surface.normals, axis=1)
    pressed = surface.normals @ frame[2] < -_STEEPEST * size
    hit = under.hit & pressed[under.face]
    corners = (surface.corners[pressed].reshape(-1, 3) - centre) @ frame.T
    near = np.hypot(corners[:, 0], corners[:, 1]) < REACH * radius
    corners = corners[near & (np.abs(corners[:, 2]) < 0.5 * radius)]
    points = np.vstack([points[hit], corners[:, :2]])
    height = np.concatenate([under.depth[hit], corners[:, 2]])
    if not len(height):
        raise MeshError(
            f"the press at {centre} m meets no surface that faces it: its point must lie on the "
            "body's surface, its direction within 60 degrees of the normal into the body"
        )
    if np.abs(height).max() < _FLAT * radius:
        return np.zeros(7)
    x, y = points.T / radius
    level = 1 / np.sqrt(1 + ((x * x + y * y) / LEVEL**2) ** 2)
    bent = level * np.stack([x * x, x * y, y * y])
    terms = np.column_stack([np.ones_like(x), x, y, *bent])
    shape = np.linalg.lstsq(terms, height, rcond=None)[0]
    shape[0] += (height - terms @ shape).min()
    return np.append(shape / radius ** np.array([0, 1, 1, 2, 2, 2]), (LEVEL * radius) ** -4)


def surface_curvature(body: Surface, contacts: Contacts) -> np.ndarray:
    """Mean curvature of a surface under tips, (j,) 1/m, convex positive.

    That of the paraboloid over the contact, or over a triangle where these are larger (up to
    `_WIDEST` contact radii: larger ones are sides of a body with edges).
    """
    surface, found = PressedSurface(body), np.empty(len(contacts))
    presses = zip(contacts.points_m, contacts.directions, contacts.radius_m, strict=True)
    for j, (centre, direction, radius) in enumerate(presses):
        frame = contact_frame(direction)
        corners = surface.corners[surface.under(centre, frame, np.zeros((1, 2)), radius).face[0]]
        edge = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean()
        reach = radius if edge > _WIDEST * radius else max(radius, edge)
        shape = contact_shape(surface, centre, frame, reach)
        found[j] = shape[3] + shape[5]
    return found


@numba.njit(cache=True)
def height(shape, x, y):
    """Return the surface's depth h below the tip's plane."""
    square = x * x + y * y
    bent = shape[3] * x * x + shape[4] * x * y + shape[5] * y * y
    level = np.sqrt(1 + shape[6] * square * square)
    return shape[0] + shape[1] * x + shape[2] * y + bent / level


@numba.njit(cache=True)
def slope(shape, x, y):
    """Return dh/dx and dh/dy."""
    w, by = _levelling(shape, x, y)
    bent = shape[3] * x * x + shape[4] * x * y + shape[5] * y * y
    return (
        shape[1] + w * (2 * shape[3] * x + shape[4] * y) + 2 * x * bent * by,
        shape[2] + w * (shape[4] * x + 2 * shape[5] * y) + 2 * y * bent * by,
    )


@numba.njit(cache=True)
def bending(shape, x, y):
    """Return the second derivatives of h by x twice, by x and y, by y twice."""
    square = x * x + y * y
    w, by = _levelling(shape, x, y)
    twice = shape[6] * w**3 * (3 * shape[6] * square * square * w * w - 1)
    bent = shape[3] * x * x + shape[4] * x * y + shape[5] * y * y
    b_x, b_y = 2 * shape[3] * x + shape[4] * y, shape[4] * x + 2 * shape[5] * y
    return (
        2 * shape[3] * w + 4 * x * b_x * by + bent * (2 * by + 4 * x * x * twice),
        shape[4] * w + 2 * (y * b_x + x * b_y) * by + 4 * x * y * bent * twice,
        2 * shape[5] * w + 4 * y * b_y * by + bent * (2 * by + 4 * y * y * twice),
    )


@numba.njit(cache=True)
def _levelling(shape, x, y):
    """Return w = 1/sqrt(1 + (r/L)^4) and its derivative by r^2."""
    square = x * x + y * y
    w = 1 / np.sqrt(1 + shape[6] * square * square)
    return w, -shape[6] * square * w**3


@numba.njit(cache=True)
def depth_below(shape, x, y, z, radius):
    """Depth of a point below the paraboloid; near the tip, where none may be negative, at least 0.

    Further out the field goes on smoothly above the paraboloid.
    """
    depth = z - height(shape, x, y)
    if depth < 0 and x * x + y * y < (REACH * radius) ** 2:
        return 0.0
    return depth
