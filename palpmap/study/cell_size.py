"""The size of a body and of the cells that mesh it, and the memory that they need."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fem.mesh import FEWEST_CELLS, focused_planes, probed_box, refined_planes
from models import InputError
from palpmap.study.body import Body
from palpmap.study.contact_body import contact_body

if TYPE_CHECKING:
    from fem.mesh import Surface

COARSE_CELLS = 256  # hexahedra of a block: 8 x 8 x 4 of the paper's body
MOST_CELLS = 2048  # the finer of two meshes then has 170,000 to 210,000 unknowns, and takes 4 GB
MOST_FINER_CELLS = 8640  # of the finer mesh; rounding makes up to a quarter more of 2048
FREE_MAP_CELLS = 1000  # most hexahedra under a free map
FREE_MAP_WORK = 3e5  # hexahedra times presses: eight evaluations in a minute of one core
BYTES = (0.5e9, 6e5, 4.5e6)  # base, and for each finer cell and each press, measured
REFINEMENT = 1.5
SURFACE_EDGES = (7, 10)  # edges along the cube root of the volume of a closed surface


def probed_part(body: Body, points_m: np.ndarray, radii_m: np.ndarray) -> np.ndarray | None:
    """Return the part of a body which a scan may show, (2, 3) m; None where that is all of it.

    In the frame of the mesh: of a body that is meshed as a block, its corner is at zero.

    Parameters
    ----------
    points_m, radii_m : (j, 3) contact points in the body's frame, (j,) radii of the tips
    """
    edges = edges_of(body)
    if edges is None:
        vertices = closed_surface(body).vertices
        points, box = points_m, np.array([vertices.min(axis=0), vertices.max(axis=0)])
    else:
        corner = contact_body(body).corner_m[:2] if body.size_m is None else np.zeros(2)
        points = np.column_stack([points_m[:, :2] - corner, np.full(len(points_m), edges[2])])
        box = np.array([np.zeros(3), edges])
    probed = probed_box(points, box, float(radii_m.min()))
    return None if np.array_equal(probed, box) else probed


def cell_size_m(body: Body, probed_m: np.ndarray | None = None) -> float:
    """Return the size of the coarser mesh's cells, m: what the study says, else by the volume.

    Parameters
    ----------
    probed_m : (2, 3) part of the body where cells have it, see `probed_part`

    >>> size_m = (0.096, 0.096, 0.048)
    >>> round(cell_size_m(Body(shape="block", size_m=size_m, poisson_ratio=0.3)), 6)
    0.012

    Raises
    ------
    InputError
        Cells so small that the finer mesh could not be computed with, or so large that fewer than
        two fit the body's smallest edge.
    """
    if body.cell_size_m is None:
        cells = COARSE_CELLS if edges_of(body) is not None else SURFACE_EDGES[0] ** 3
        chosen = float(np.cbrt(_volume(body, probed_m) / cells))
        _refuse_too_wide(body, chosen, probed_m)
        return chosen
    if body.cell_size_m < (least := smallest_cell_m(body, probed_m)):
        _refuse_too_wide(body, min(least, _shortest_edge(body) / 2), probed_m)
        edges = np.cbrt(volume_of(body)) / body.cell_size_m
        raise InputError(
            f"study, key body.cell_size_m: found {body.cell_size_m:g} m, which would make about "
            f"{min(edges, 1e15) ** 3:,.4g} cells of this body; expected at least {least:.3g} m; "
            "make it larger or leave it out"
        )
    largest = _shortest_edge(body) / 2
    if body.cell_size_m > largest * (1 + 1e-9):
        raise InputError(
            f"study, key body.cell_size_m: found {body.cell_size_m:g} m, expected at most "
            f"{largest:.3g} m, so that at least two cells fit the body's smallest edge; make it "
            "smaller or leave it out"
        )
    return body.cell_size_m


def free_map_cell_m(body: Body, presses: int, probed_m: np.ndarray | None = None) -> float:
    """Return the size of the cells under a free map, m: stated, or as fine as the time allows."""
    if edges_of(body) is None:
        return cell_size_m(body, probed_m) * SURFACE_EDGES[0] / SURFACE_EDGES[1]
    cells = float(np.clip(FREE_MAP_WORK / presses, COARSE_CELLS, FREE_MAP_CELLS))
    return body.cell_size_m or float(np.cbrt(_volume(body, probed_m) / cells))


def smallest_cell_m(body: Body, probed_m: np.ndarray | None = None) -> float:
    """Return the least size of cells with which can be computed, m."""
    cell_m = float(f"{np.cbrt(_volume(body, probed_m) / MOST_CELLS):.3g}")
    while _finer_cells(body, cell_m, probed_m) > MOST_FINER_CELLS and cell_m < _shortest_edge(body):
        cell_m = float(f"{1.02 * cell_m:.3g}")  # a thin body has three cells over its height
    return cell_m


def _finer_cells(body: Body, cell_m: float, probed_m: np.ndarray | None) -> int:
    """Return the number of hexahedra of a block's finer mesh; 0 of a closed surface."""
    edges = edges_of(body)
    if edges is None:
        return 0
    return math.prod(len(p) - 1 for p in finer_planes(block_planes(edges, cell_m, probed_m)))


def _volume(body: Body, probed_m: np.ndarray | None) -> float:
    """Return the volume over which the number of cells is counted, m^3."""
    return volume_of(body) if probed_m is None else float(np.prod(probed_m[1] - probed_m[0]))


def refuse_too_large(body: Body, presses: int, probed_m: np.ndarray | None = None) -> None:
    """Refuse a body and a number of presses whose models need more memory than there is.

    Raises
    ------
    InputError
        The memory that is needed and the cure.
    """
    base, of_cell, of_press = BYTES
    cells = _finer_cells(body, cell_size_m(body, probed_m), probed_m)
    needed = base + of_cell * cells + of_press * presses
    there = _memory_bytes()
    if needed > there:
        raise InputError(
            f"the models of {presses} presses need about {needed / 1e9:.1f} GB of memory, expected "
            f"at most the {there / 1e9:.1f} GB of this machine; use fewer presses or larger cells "
            "(body.cell_size_m)"
        )


def _memory_bytes() -> float:
    """Return the memory of this machine, infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def _refuse_too_wide(body: Body, cell_m: float, probed_m: np.ndarray | None) -> None:
    """Refuse a block so thin and wide that no cells of the right size fit into the memory."""
    cells = _finer_cells(body, cell_m, probed_m)
    if cells > MOST_FINER_CELLS:
        size = " x ".join(f"{edge:.3g}" for edge in edges_of(body) or ())
        key = "size_m" if body.size_m is not None else "thickness_m"
        raise InputError(
            f"study, key body.{key}: found {size} m, so thin that a mesh with three cells over "
            f"its height would have {cells:,} cells, expected at most {MOST_FINER_CELLS:,}, as "
            "many as fit into 4 GB of memory; state a smaller part of the body around the presses"
        )


def edges_of(body: Body) -> tuple[float, float, float] | None:
    """Return the edges of a body that is meshed as a block is, m; None of a closed surface."""
    if body.shape == "from-contacts":
        x, y, z = contact_body(body).size_m.tolist()
        return x, y, z
    return body.size_m


def volume_of(body: Body) -> float:
    """Return the volume of a body, m^3."""
    edges = edges_of(body)
    return float(np.prod(edges)) if edges is not None else closed_surface(body).volume


def _shortest_edge(body: Body) -> float:
    """Return the smallest edge of the body's bounding box, m."""
    edges = edges_of(body)
    return float(np.min(np.ptp(closed_surface(body).vertices, axis=0) if edges is None else edges))


def block_planes(
    size_m: tuple[float, float, float], cell_m: float, probed_m: np.ndarray | None = None
) -> list[np.ndarray]:
    """Planes between the cells of a block: cubes of about a size, at least three a side.

    Wider ones outside the probed part (2, 3), where one is given.

    >>> [len(planes) - 1 for planes in block_planes((0.096, 0.096, 0.048), 0.012)]
    [8, 8, 4]
    """
    if probed_m is None:
        counts = [max(round(edge / cell_m), FEWEST_CELLS) for edge in size_m]
        return [np.linspace(0, e, n + 1) for e, n in zip(size_m, counts, strict=True)]
    return [
        focused_planes(edge, cell_m, low, high)
        for edge, low, high in zip(size_m, *probed_m.tolist(), strict=True)
    ]


def finer_planes(planes_m: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the planes of the finer of two meshes."""
    return [refined_planes(planes, REFINEMENT) for planes in planes_m]


def closed_surface(body: Body) -> Surface:
    """Return the surface that a study names for its body."""
    from fem import read_surface

    return read_surface(str(body.file))
