"""Tetrahedral meshes of closed surfaces, made by fTetWild (pytetwild) and kept in a cache."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import zipfile
import zlib
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fem.errors import MeshError
from fem.mesh.block import block_mesh
from fem.mesh.checks import cell_quality, check_mesh
from fem.mesh.focus import FEWEST_CELLS, GROWTH, edge_lengths
from fem.mesh.mesh import Mesh, boundary_faces, promote_to_tet10
from fem.mesh.subprocess_job import run_job
from fem.mesh.surface import Surface, check_surface

VOLUME_TOLERANCE = 0.02
LEAST_QUALITY = 0.01
BASE_FRACTION = 0.02  # of the height, see `_surfaces`
MOST_CELLS = 1_000_000
_CELLS_A_CUBE = 7.5  # cells of a mesh, about, times edge length^3 / volume (measured)
_TRIANGLES_A_SQUARE = 10.0  # of a surface kept as it is; one of the mesh's own has 2.3


def tetrahedralize_surface(
    vertices: ArrayLike,
    triangles: ArrayLike,
    edge_length_m: float,
    *,
    fine_box_m: NDArray[np.float64] | None = None,
    order: int = 2,
    time_limit_s: float = 120.0,
    cache_folder: str | Path | None = None,
) -> Mesh:
    """Fill a closed surface with tetrahedra.

    The mesher runs in its own process. A surface with triangles finer than half the edge length,
    about, is decimated first. The mesh's surface lies within 2 % of the edge length (or 0.1 % of
    the body's diagonal) of the given one. The mesher is not deterministic, so each mesh is kept
    under a hash of surface, edge length and version, and taken from there the next time.

    Parameters
    ----------
    vertices, triangles : (n, 3) m and (t, 3), as `fem.mesh.surface.check_surface` wants them.
    edge_length_m : length that the tetrahedra's edges should have.
    fine_box_m : (2, 3) part of the body where they have it, longer ones elsewhere; see
        `fem.mesh.probed_box`. All of the body where not given.
    order : 1 (four nodes a cell) or 2 (ten).
    time_limit_s : after which the mesher is stopped.
    cache_folder : where meshes are kept; `mesh_cache_folder()` where not given.

    Returns
    -------
    Mesh with the surfaces "base" (faces within 2 % of the height above the lowest point that look
    down) and "top" (the rest).

    Raises
    ------
    MeshError
        The surface cannot be filled, the mesher crashed or took too long, or its mesh is bad: more
        than 2 % away from the surface's volume (the surface intersects itself), flat cells,
        separate parts, no flat underside.
    """
    if order not in (1, 2):
        raise MeshError(f"The order of a mesh must be 1 or 2, got {order}.")
    surface = check_surface(vertices, triangles)
    _check_edge_length(surface, edge_length_m, fine_box_m)
    folder = mesh_cache_folder() if cache_folder is None else Path(cache_folder)
    kept = folder / f"{_content_hash(surface, edge_length_m, fine_box_m)}.npz"
    mesh = _load(kept, surface)
    if mesh is None:
        made = run_job(
            "tetrahedralize",
            time_limit_s,
            vertices=surface.vertices,
            triangles=surface.triangles,
            edge_length_m=edge_length_m,
            most_triangles=_TRIANGLES_A_SQUARE * surface.area / edge_length_m**2,
            **({} if fine_box_m is None else _sizing_field(surface, edge_length_m, fine_box_m)),
        )
        mesh = _checked_mesh(made["nodes"], made["cells"], surface)
        _save(kept, mesh)
    mesh = replace(mesh, focused=fine_box_m is not None)
    return promote_to_tet10(mesh) if order == 2 else mesh


def mesh_cache_folder() -> Path:
    """Folder of the kept meshes: `meshes` in PALPMAP_CACHE or in the user's cache of palpmap."""
    if chosen := os.environ.get("PALPMAP_CACHE"):
        return Path(chosen) / "meshes"
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData/Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library/Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "palpmap" / "meshes"


def _sizing_field(
    surface: Surface, edge_length_m: float, fine_box_m: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Lengths of edges on a grid around the surface, as the mesher wants them."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    size = high - low + 2 * edge_length_m  # points outside would have the longest edges
    counts = np.ceil(size / edge_length_m).astype(int)
    grid = block_mesh(size.tolist(), counts.tolist(), order=1)
    points = grid.nodes + low - edge_length_m
    longest = float((high - low).min()) / FEWEST_CELLS
    lengths = np.minimum(edge_lengths(points, edge_length_m, fine_box_m), longest)
    return {"grid_points": points, "grid_cells": grid.cells, "grid_lengths": lengths}


def _check_edge_length(
    surface: Surface, edge_length_m: float, fine_box_m: NDArray[np.float64] | None
) -> None:
    shortest = float(np.ptp(surface.vertices, axis=0).min())
    if not 0 < edge_length_m <= shortest:
        raise MeshError(
            f"The edge length must be above 0 and at most the body's shortest side, "
            f"{shortest:.3g} m; got {edge_length_m} m."
        )
    box = np.inf if fine_box_m is None else float(np.prod(fine_box_m[1] - fine_box_m[0]))
    volume = min(surface.volume, box)  # outside are hardly more cells than in the box
    cells = _CELLS_A_CUBE * volume / edge_length_m**3
    if cells > MOST_CELLS:
        least = (_CELLS_A_CUBE * volume / MOST_CELLS) ** (1 / 3)
        raise MeshError(
            f"An edge length of {edge_length_m} m gives about {cells:.1e} cells, more than "
            f"{MOST_CELLS:.0e}: choose at least {least:.2g} m."
        )


def _checked_mesh(nodes: NDArray[np.float64], cells: NDArray[np.int32], surface: Surface) -> Mesh:
    """Return the four-node mesh with its surfaces; `MeshError` names its fault."""
    if len(cells) == 0:
        raise MeshError("The mesher made no tetrahedra: the surface encloses nothing.")
    used, number = np.unique(cells, return_inverse=True)
    nodes, cells = nodes[used], number.reshape(-1, 4).astype(np.int32)
    mesh = Mesh(nodes, cells, _surfaces(nodes, boundary_faces(cells)))
    check_mesh(mesh)
    ratio = mesh.volume / surface.volume
    if abs(ratio - 1) > VOLUME_TOLERANCE:
        raise MeshError(
            f"The mesh has {ratio:.3f} times the surface's volume: the surface intersects itself "
            "or has parts thinner than the edge length; repair it or choose a shorter edge length."
        )
    worst = float(cell_quality(mesh).min())
    if worst < LEAST_QUALITY:
        raise MeshError(
            f"The mesh has a nearly flat cell (quality {worst:.1e}, at least {LEAST_QUALITY} is "
            "needed): smooth the surface or choose another edge length."
        )
    return mesh


def check_underside(surface: Surface) -> None:
    """Refuse a surface without a flat underside to rest on, before it is filled.

    Raises
    ------
    MeshError
    """
    _surfaces(surface.vertices, surface.triangles)


def _surfaces(nodes: NDArray[np.float64], faces: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
    """Split the boundary into "base" and "top"; a face looks down at 45 degrees or steeper."""
    a, b, c = (nodes[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    down = -normal[:, 2] > np.sqrt(0.5) * np.linalg.norm(normal, axis=1)
    z = nodes[:, 2]
    low = (z[faces] <= z.min() + BASE_FRACTION * np.ptp(z)).all(axis=1)
    base = low & down
    if not base.any():
        raise MeshError(
            f"The body has no underside to rest on: no face lies within {BASE_FRACTION:.0%} of its "
            "height above its lowest point; cut it flat at z = const, with z pointing up."
        )
    return {"base": faces[base], "top": faces[~base]}


def _content_hash(
    surface: Surface, edge_length_m: float, fine_box_m: NDArray[np.float64] | None
) -> str:
    made_by = ["1", version("pytetwild"), float(edge_length_m).hex()]  # 1: of this file's recipe
    if fine_box_m is not None:
        made_by += [GROWTH.hex(), *(value.hex() for value in fine_box_m.ravel().tolist())]
    digest = hashlib.sha256(" ".join(made_by).encode())
    for array in surface:
        digest.update(f"{array.shape} {array.dtype.str}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _load(path: Path, surface: Surface) -> Mesh | None:
    """Return a kept mesh; None where there is none or the file is damaged."""
    damage = (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error)
    with suppress(*damage), open(path, "rb") as raw, np.load(raw) as file:
        return _checked_mesh(file["nodes"], file["cells"], surface)
    return None


def _save(path: Path, mesh: Mesh) -> None:
    """Keep a mesh, whole or not at all; a folder that cannot be written costs only time."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
            np.savez_compressed(file, nodes=mesh.nodes, cells=mesh.cells)
        Path(file.name).replace(path)
