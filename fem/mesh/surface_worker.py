"""Program run in its own process: reads surface files and fills surfaces with tetrahedra.

The libraries for both can crash or never return on bad input (a cut-off PLY, an infinite vertex),
which must not take a whole run along. Called by `fem.mesh.subprocess_job` as

    python surface_worker.py JOB input.npz output.npz

and therefore without imports of this package. Expected failures are written as `error`.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping

import numpy as np

Arrays = dict[str, np.ndarray]


def read(given: Mapping[str, np.ndarray]) -> Arrays:
    """Read the surface file `path` into `vertices` (n, 3) and `triangles` (t, 3)."""
    import pyvista

    with warnings.catch_warnings():
        warnings.simplefilter("error")  # VTK's failures come as warnings and an empty surface
        try:
            surface = pyvista.read(str(given["path"]))
        except Exception:  # what VTK says of it is no help
            text = "it cannot be read: cut off, damaged, or not of the kind that its ending says"
            return {"error": np.array(f"{text}; export it again.")}
    if not isinstance(surface, pyvista.PolyData):
        return {"error": np.array(f"it holds a {type(surface).__name__}, not one surface.")}
    surface = surface.triangulate()
    return {"vertices": np.array(surface.points, float), "triangles": surface.regular_faces}


def tetrahedralize(given: Mapping[str, np.ndarray]) -> Arrays:
    """Fill a checked surface; return `nodes` (n, 3), `cells` (e, 4).

    Edges have one length, or those given on a grid of tetrahedra around the surface.

    The mesh's surface may lie 2 % of the edge length (at least 0.1 % of the body's diagonal) off
    the given one: a narrower envelope costs time and cells without use for the mechanics.
    """
    from pytetwild.pytetwild import tetrahedralize as fill

    vertices, triangles = decimated(
        given["vertices"], given["triangles"], float(given["most_triangles"])
    )
    edge_length = float(given["edge_length_m"])
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    longest, sizes = edge_length, {}
    if "grid_lengths" in given:
        longest = float(given["grid_lengths"].max())
        sizes = {
            "bg_vertices": given["grid_points"],
            "bg_tets": given["grid_cells"].astype(np.int32),
            "bg_values": given["grid_lengths"],
        }
    nodes, cells = fill(
        np.ascontiguousarray(vertices, np.float64),
        np.ascontiguousarray(triangles, np.int32),
        edge_length_abs=longest,
        epsilon=max(1e-3, 0.02 * edge_length / diagonal),
        vtk_ordering=True,  # without it all cells are inverted
        **sizes,
    )
    return {"nodes": np.asarray(nodes, float), "cells": np.asarray(cells, np.int32)}


def decimated(
    vertices: np.ndarray, triangles: np.ndarray, most_triangles: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface with at most so many triangles, where it then is closed and of its volume.

    The mesher's time is driven by triangles that are finer than its edge length.
    """
    if len(triangles) <= most_triangles:
        return vertices, triangles
    import pyvista

    full = pyvista.PolyData.from_regular_faces(vertices, triangles)
    small = full.decimate(1 - most_triangles / len(triangles), volume_preservation=True)
    if not small.is_manifold or abs(small.volume / full.volume - 1) > 0.005:
        return vertices, triangles
    return np.array(small.points, float), small.regular_faces


def main(job: str, source: str, target: str) -> None:
    """Run a job on the arrays in one file and write its results to another."""
    with np.load(source, allow_pickle=False) as file:
        result = {"read": read, "tetrahedralize": tetrahedralize}[job](dict(file))
    with open(target, "wb") as file:
        np.savez(file, **result)  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main(*sys.argv[1:])
