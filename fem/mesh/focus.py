"""Cells where a scan sees, and wider ones elsewhere, in a body much larger than its probed part.

A press's field decays with the distance from the tip, and presses tell the body apart to a depth
of about half the width over which they are spread. A mesh of even cells over a body many times
larger has no cell as small as what the scan shows: in a block of 200 x 200 x 100 mm whose middle
80 mm were pressed, an inclusion of 8 mm came out a third as hard as it is, beside a residual of
noise (docs/trust.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import root_scalar

from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh

FEWEST_PRESSES = 20  # fewer say little of where a scan looks
MARGIN = 0.15  # beside the presses, of the width over which they are spread
DEPTH = 0.6  # below them, of the same
NEARLY_ALL = 0.5  # of the body's volume: then the probed part is all of it
EVEN_CELLS = 256  # of a block, 8 x 8 x 4 ...
FINE_ENOUGH = 3.5  # ... are fine enough up to so many radii of the tip: those of the measured small
# balls (2.8) are, and with finer ones their free map lost both; those of the block above are 5
WIDER = 3.0  # most that a layer of cells may be, of the one before it: with 4 presses at the rim of
# the probed part were 0.3 % too stiff, with 3 they are 0.1 %, for a quarter more cells
TRULY_WIDER = 2.0  # the same of the laboratory's truth, whose fine cells need more layers
GROWTH = 0.7  # of the edges of tetrahedra, for each metre away from the probed part
FEWEST_CELLS = 3
_THIN = 0.5  # of a cell: a layer thinner than this is no layer of its own


def probed_box(points_m: np.ndarray, box_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Return the part of a body that a scan's presses may show, a box (2, 3) m.

    All of the body where that is hardly more, where even cells all over are as fine as the tip
    sees, and for fewer than twenty presses.

    Parameters
    ----------
    points_m : (j, 3) contact points, z up
    box_m : (2, 3) of the body
    radius_m : of the smallest tip

    Examples
    --------
    >>> line = np.linspace(0.06, 0.14, 5)
    >>> points = np.stack(np.meshgrid(line, line, [0.1]), axis=-1).reshape(-1, 3)
    >>> probed_box(points, np.array([[0, 0, 0], [0.2, 0.2, 0.1]]), 0.005).round(3).tolist()
    [[0.048, 0.048, 0.052], [0.152, 0.152, 0.1]]
    """
    points, box = np.asarray(points_m, float), np.asarray(box_m, float)
    width = float(np.ptp(points[:, :2], axis=0).max())
    even = np.cbrt(np.prod(box[1] - box[0]) / EVEN_CELLS)
    if len(points) < FEWEST_PRESSES or width == 0 or even <= FINE_ENOUGH * radius_m:
        return box
    aside = np.array([MARGIN, MARGIN, 0]) * width
    low = np.maximum(points.min(axis=0) - aside - [0, 0, DEPTH * width], box[0])
    high = np.minimum(np.append((points.max(axis=0) + aside)[:2], box[1, 2]), box[1])
    if np.prod(high - low) >= NEARLY_ALL * np.prod(box[1] - box[0]):
        return box
    return np.array([low, high])


def planes_over(
    size_m: Sequence[float], counts: Sequence[int], points_m: np.ndarray, radius_m: float
) -> list[np.ndarray]:
    """Planes of so many even cells along x, y and z of a block, or of the part that presses show.

    For a laboratory's truth: outside that part its layers grow less than those of a model.

    Parameters
    ----------
    points_m : (j, 3) contact points on the top
    radius_m : of the smallest tip
    """
    box = np.array([np.zeros(3), size_m])
    probed = probed_box(points_m, box, radius_m)
    if np.array_equal(probed, box):
        return [np.linspace(0, e, n + 1) for e, n in zip(size_m, counts, strict=True)]
    cell = float(np.cbrt(np.prod(probed[1] - probed[0]) / np.prod(counts)))
    return [
        focused_planes(edge, cell, low, high, TRULY_WIDER)
        for edge, low, high in zip(size_m, *probed.tolist(), strict=True)
    ]


def focused_planes(
    edge_m: float, cell_m: float, low_m: float, high_m: float, wider: float = WIDER
) -> np.ndarray:
    """Planes between cells along an edge: about a size apart from low to high, wider outside.

    A layer outside is at most so many times as thick as the one before.

    >>> focused_planes(0.1, 0.01, 0.0, 0.1).round(4).tolist()
    [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1]
    >>> focused_planes(0.1, 0.01, 0.06, 0.1).round(4).tolist()
    [0.0, 0.04, 0.06, 0.07, 0.08, 0.09, 0.1]
    """
    low = 0.0 if low_m < _THIN * cell_m else low_m
    high = edge_m if edge_m - high_m < _THIN * cell_m else high_m
    count = max(round((high - low) / cell_m), FEWEST_CELLS)
    inner = np.linspace(low, high, count + 1)
    before, after = (
        _outside(distance, inner[1] - inner[0], wider) for distance in (low, edge_m - high)
    )
    return np.concatenate([low - before[::-1], inner, high + after])


def _outside(distance_m: float, cell_m: float, wider: float) -> np.ndarray:
    """Distances of planes from the even cells, up to the last one; none for no distance."""
    if distance_m == 0:
        return np.zeros(0)
    count = 1
    while cell_m * np.sum(wider ** np.arange(1, count + 1)) < distance_m:
        count += 1
    powers = np.arange(1, count + 1)
    growth = root_scalar(
        lambda q: cell_m * np.sum(q**powers) - distance_m, bracket=(0, 1.001 * wider)
    ).root
    places = cell_m * np.cumsum(growth**powers)
    return places * distance_m / places[-1]


def edge_lengths(points_m: np.ndarray, cell_m: float, box_m: np.ndarray) -> np.ndarray:
    """Return the lengths of edges at points (n, 3): a size in a box (2, 3), longer outside, (n,) m.

    >>> box = np.array([[0, 0, 0], [0.1, 0.1, 0.05]])
    >>> points = np.array([[0.05, 0.05, 0.02], [0.05, 0.15, 0.02]])
    >>> edge_lengths(points, 0.01, box).round(4).tolist()
    [0.01, 0.045]
    """
    beside = np.maximum(np.maximum(box_m[0] - points_m, points_m - box_m[1]), 0)
    return cell_m + GROWTH * np.linalg.norm(beside, axis=1)


def refined_planes(planes_m: np.ndarray, factor: float) -> np.ndarray:
    """Return so many times as many planes, as dense beside each other as before."""
    last = len(planes_m) - 1
    count = round(factor * last)
    return np.interp(np.linspace(0, last, count + 1), np.arange(last + 1), planes_m)


def mesh_between(planes_m: Sequence[np.ndarray], split: str = "kuhn") -> Mesh:
    """Return a block's mesh with cells between planes along x, y and z, the first at 0.

    See `fem.block_mesh` for the split.
    """
    size = [float(planes[-1]) for planes in planes_m]
    mesh = block_mesh(size, [len(planes) - 1 for planes in planes_m], split=split)
    nodes, focused = mesh.nodes.copy(), False
    for axis, planes in enumerate(planes_m):
        last = len(planes) - 1
        if not np.allclose(planes, np.linspace(0, size[axis], last + 1), rtol=0, atol=1e-9):
            focused = True
            place = nodes[:, axis] / size[axis] * last
            nodes[:, axis] = np.interp(place, np.arange(last + 1), planes)
    return Mesh(nodes, mesh.cells, mesh.surfaces, focused)
