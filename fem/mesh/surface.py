"""Closed triangle surfaces of bodies: read from a file and checked."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components

from fem.errors import MeshError
from fem.mesh.subprocess_job import run_job

SUFFIXES = (".stl", ".obj", ".ply")
LARGEST_M, SMALLEST_M = 2.0, 0.001
_READ_LIMIT_S = 60.0


class Surface(NamedTuple):
    """A triangle surface.

    Attributes
    ----------
    vertices : (n, 3) m
    triangles : (t, 3) vertex numbers, counter-clockwise seen from outside.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]

    @property
    def volume(self) -> float:
        """Enclosed volume, m^3; negative where the triangles face inwards."""
        return float(_cone_volumes(*self).sum())

    @property
    def area(self) -> float:
        """Area of all triangles, m^2."""
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def read_surface(path: str | Path, scale: float = 1.0) -> Surface:
    """Read and check a closed surface from an STL, OBJ or PLY file.

    Parameters
    ----------
    path : the file; its ending says its kind.
    scale : metres a unit of the file, 0.001 for millimetres.

    Raises
    ------
    MeshError
        The file is not there or cannot be read, its size looks like millimetres, or the surface
        is not one that `check_surface` lets pass.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: a surface file must end in one of {', '.join(SUFFIXES)}.")
    if not path.is_file():
        raise MeshError(f"{path}: there is no such file; check the path.")
    if not (np.isfinite(scale) and scale > 0):
        raise MeshError(f"The scale of a surface must be a positive number, got {scale}.")
    state = path.stat()
    try:
        return _read(path.resolve(), scale, (state.st_mtime_ns, state.st_size))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


@lru_cache(maxsize=4)  # a study asks for its surface several times, each a process of its own
def _read(path: Path, scale: float, state: tuple[int, int]) -> Surface:
    """Read and check a file in the state that its time of change and size, in bytes, tell."""
    del state
    raw = run_job("read", _READ_LIMIT_S, path=str(path))
    if len(raw["triangles"]) == 0:
        raise MeshError("no triangles in it; export it again as a triangle surface.")
    surface = check_surface(raw["vertices"] * scale, raw["triangles"])
    for array in surface:
        array.setflags(write=False)
    return surface


def check_surface(vertices: ArrayLike, triangles: ArrayLike) -> Surface:
    """Return the surface, equal vertices merged, or say why it cannot be filled with tetrahedra.

    Needed: finite vertices (n, 3) in m, triangles (t, 3) of numbers in range, a size between 1 mm
    and 2 m, each edge shared by two triangles that run through it in opposite directions, normals
    outwards, one body (cavities are allowed). Intersections of the surface with itself are
    not looked for here; they show in the volume of the mesh.

    Raises
    ------
    MeshError
    """
    points, faces = _checked_arrays(vertices, triangles)
    _check_size(points)
    # STL repeats the vertices in each triangle: weld equal ones, drop what they degenerate
    points, number = np.unique(points + 0.0, axis=0, return_inverse=True)  # + 0.0: -0 is 0
    faces = number.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, number = np.unique(faces, return_inverse=True)
    points, faces = points[used], number.reshape(-1, 3).astype(np.int32)
    _check_closed(points, faces)
    _check_bodies(points, faces)
    return Surface(points, faces)


def _checked_arrays(
    vertices: ArrayLike, triangles: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    points, faces = np.asarray(vertices, np.float64), np.asarray(triangles)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        raise MeshError(
            f"The surface's vertices must be (n, 3) with n >= 4, but are {points.shape}."
        )
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) < 4 or faces.dtype.kind not in "iu":
        raise MeshError(
            "The surface's triangles must be whole numbers (t, 3) with t >= 4, but are "
            f"{faces.shape} of type {faces.dtype}."
        )
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise MeshError(
            f"Vertex {bad[0]} of the surface is {points[bad[0]]} ({bad.size} such): all must be "
            "finite numbers; export the surface again."
        )
    wrong = np.flatnonzero(((faces < 0) | (faces >= len(points))).any(axis=1))
    if wrong.size:
        raise MeshError(
            f"Triangle {wrong[0]} of the surface uses the vertices {faces[wrong[0]]}, but they go "
            f"from 0 to {len(points) - 1}."
        )
    return points, faces.astype(np.int64)


def _check_size(points: NDArray[np.float64]) -> None:
    extent = np.ptp(points, axis=0)
    size = " x ".join(f"{length:.4g}" for length in extent)
    if extent.max() > LARGEST_M:
        raise MeshError(
            f"The surface is {size} m large, which looks like millimetres: coordinates must be in "
            "m; pass scale=0.001."
        )
    if extent.max() < SMALLEST_M:
        raise MeshError(
            f"The surface is only {size} m large: coordinates must be in m; pass another scale."
        )
    if extent.min() < 1e-3 * extent.max():
        raise MeshError(f"The surface is flat ({size} m): it must enclose a volume.")


def _check_closed(points: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    size = len(points)
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    there, back = start * size + end, end.astype(np.int64) * size + start
    _, first, count = np.unique(there, return_index=True, return_counts=True)
    alone = ~np.isin(back, there)
    repeated = np.zeros(alone.size, bool)
    repeated[first[count > 1]] = True
    if not (alone | repeated).any():
        return
    one = int(np.flatnonzero(alone | repeated)[0])
    place = ", ".join(f"{x:.4g}" for x in points[[start[one], end[one]]].mean(axis=0))
    if repeated.any():
        raise MeshError(
            f"{repeated.sum()} edges of the surface are run through twice in one direction (one "
            f"near ({place}) m): triangles are doubled, turned, or more than two meet there; "
            "repair the surface (remove doubles, make normals consistent, make it manifold)."
        )
    raise MeshError(
        f"The surface is open: {alone.sum()} edges belong to one triangle only (one near "
        f"({place}) m); fill its holes and merge its vertices."
    )


def _check_bodies(points: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    """One shell outwards; further shells only inwards, as cavities."""
    links = sp.coo_array(
        (np.ones(2 * len(faces), np.int8), (faces[:, [0, 0]].ravel(), faces[:, [1, 2]].ravel())),
        shape=2 * (len(points),),
    )
    shells, part = connected_components(links, directed=False)
    volumes = np.bincount(part[faces[:, 0]], _cone_volumes(points, faces), minlength=shells)
    if volumes.sum() <= 0:
        raise MeshError(
            f"The surface encloses {volumes.sum():.3g} m^3: its normals point inwards; flip them."
        )
    outer = np.flatnonzero(volumes > 0)
    if outer.size > 1:
        raise MeshError(
            f"The surface has {outer.size} separate bodies, of {np.sort(volumes[outer])[::-1]} "
            "m^3: keep one, or unite them to one closed surface (boolean union)."
        )


def _cone_volumes(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Signed volume between each triangle and the middle of the points, (t,) m^3."""
    a, b, c = (points[faces[:, i]] - points.mean(axis=0) for i in range(3))
    return np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
