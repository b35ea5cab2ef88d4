"""The solid things of the 3-D scene as drawable data: arm shapes and the body's surface."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

_NORMAL_STEPS = 256
SHAPE_KINDS = ("capsule", "cylinder", "box", "sphere", "ellipsoid", "mesh")


@dataclass(frozen=True)
class LinkShape:
    """A shape fixed to a link of the arm, in MuJoCo's conventions for geoms.

    Attributes
    ----------
    link : name of the link
    kind : capsule | cylinder | box | sphere | ellipsoid | mesh
    size_m : (3,) m: radius and half length (capsule, cylinder; along z, centred), radius (sphere),
        half sizes (box, ellipsoid); unused entries are ignored
    position_m : (3,) m, centre in the link's frame
    quaternion : (4,) w, x, y, z, orientation in the link's frame
    rgba : (4,) 0..1
    mesh : vertices (n, 3) m and triangles (t, 3) of a mesh, about its centre
    """

    link: str
    kind: str
    size_m: Sequence[float] | NDArray[np.float64]
    position_m: Sequence[float] | NDArray[np.float64]
    quaternion: Sequence[float] | NDArray[np.float64] = (1.0, 0.0, 0.0, 0.0)
    rgba: Sequence[float] | NDArray[np.float64] = (0.8, 0.8, 0.82, 1.0)
    mesh: tuple[NDArray[np.floating], NDArray[np.integer]] | None = None

    def __post_init__(self) -> None:
        """Refuse a kind of shape that cannot be drawn."""
        if self.kind not in SHAPE_KINDS:
            raise ValueError(
                f"shape on link {self.link!r} is a {self.kind!r}; these can be drawn: "
                + ", ".join(SHAPE_KINDS)
            )


def link_names(shapes: Iterable[LinkShape]) -> tuple[str, ...]:
    """Names of the links in the order of their first shape: the order of poses in a frame."""
    return tuple(dict.fromkeys(shape.link for shape in shapes))


def xyzw(quaternions: ArrayLike) -> NDArray[np.float32]:
    """Quaternions (..., 4) from w, x, y, z (MuJoCo, ours) to x, y, z, w (Rerun)."""
    return np.asarray(quaternions, np.float32)[..., [1, 2, 3, 0]]


def drawn_shape(shape: LinkShape) -> rr.AsComponents:
    """Rerun archetype of one shape."""
    size = np.asarray(shape.size_m, float)
    center = np.asarray(shape.position_m, float)
    look = {
        "quaternions": [xyzw(shape.quaternion)],
        "colors": [np.rint(255 * np.asarray(shape.rgba, float)).astype(np.uint8)],
        "fill_mode": "solid",
    }
    if shape.mesh is not None:
        vertices, triangles = shape.mesh
        w, x, y, z = np.asarray(shape.quaternion, float)
        turned = vertices + 2 * np.cross([x, y, z], np.cross([x, y, z], vertices) + w * vertices)
        return rr.Mesh3D(
            vertex_positions=turned + center,
            triangle_indices=triangles,
            vertex_normals=vertex_normals(turned, triangles),
            albedo_factor=look["colors"][0],
        )
    match shape.kind:
        case "capsule":  # Rerun's starts in the centre of its lower cap
            start = center - size[1] * _z_axis(shape.quaternion)
            return rr.Capsules3D(
                lengths=[2 * size[1]], radii=[size[0]], translations=[start], **look
            )
        case "cylinder":
            return rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], centers=[center], **look)
        case "box":
            return rr.Boxes3D(half_sizes=[size], centers=[center], **look)
        case _:
            half_sizes = size if shape.kind == "ellipsoid" else np.full(3, size[0])
            return rr.Ellipsoids3D(half_sizes=[half_sizes], centers=[center], **look)


def _z_axis(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Third column of the rotation matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = np.asarray(quaternion, float)
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def vertex_normals(
    vertices: NDArray[np.floating], triangles: NDArray[np.integer]
) -> NDArray[np.float32]:
    """Return normals (n, 3) of a triangle surface at its vertices, weighted by area.

    They are rounded to steps that the eye does not see, so that those of parts that hardly moved
    repeat from shape to shape, which halves a recording.
    """
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros(vertices.shape)
    for axis in range(3):
        total[:, axis] = np.bincount(
            triangles.ravel(), np.repeat(face[:, axis], 3), minlength=len(vertices)
        )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit = total / np.maximum(length, 1e-300)
    return (np.rint(unit * _NORMAL_STEPS) / _NORMAL_STEPS).astype(np.float32)


def lifted(
    points: NDArray[np.float64],
    vertices: NDArray[np.floating],
    normals: NDArray[np.floating],
    height_m: float,
) -> NDArray[np.float64]:
    """Move points (j, 3) off the surface along the normal of their nearest vertex."""
    distance = ((points[:, None] - vertices[None]) ** 2).sum(axis=2)
    return points + height_m * normals[distance.argmin(axis=1)]
