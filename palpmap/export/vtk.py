"""The map for ParaView: as the finite elements' mesh, as a grid, and as a table of that grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpmap.export.body import ExportedBody

QUADRATIC_TETRA = 24  # VTK's number of a cell with ten nodes
NAME = "young_modulus_pa"


def _mesh(body: ExportedBody, origin_m: np.ndarray):
    import pyvista

    cells = body.mesh.cells
    table = np.hstack([np.full((len(cells), 1), cells.shape[1]), cells])
    kinds = np.full(len(cells), QUADRATIC_TETRA, np.uint8)
    return pyvista.UnstructuredGrid(table.ravel(), kinds, body.mesh.nodes + origin_m)


def write_vtu(body: ExportedBody, path: Path) -> None:
    """Write the mesh with the moduli of cells and nodes, in the scan's frame."""
    grid = _mesh(body, body.origin_m)
    grid.cell_data[NAME] = body.cell_modulus
    grid.point_data[NAME] = body.modulus(body.mesh.nodes)
    grid.save(path)


def _sampled(body: ExportedBody) -> tuple[np.ndarray, np.ndarray]:
    """Points of the grid (p, 3), x fastest, and their moduli (p,); NaN outside the body."""
    start, step, count = body.grid()
    axes = [start[a] + step[a] * np.arange(count[a]) for a in range(3)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    values = body.modulus(points)
    if body.run.experiment.study.body.shape != "block":
        outside = _mesh(body, np.zeros(3)).find_containing_cell(points) < 0
        values = np.where(outside, np.nan, values)
    return points, values


def write_vti(body: ExportedBody, path: Path) -> None:
    """Write the map on an even grid, in the scan's frame."""
    import pyvista

    start, step, count = body.grid()
    grid = pyvista.ImageData(
        dimensions=tuple(count.tolist()),
        spacing=tuple(step.tolist()),
        origin=tuple((start + body.origin_m).tolist()),
    )
    grid.point_data[NAME] = _sampled(body)[1]
    grid.save(path)


def write_csv(body: ExportedBody, path: Path) -> None:
    """Write the grid's points inside the body as a table x_m, y_m, z_m, young_modulus_pa."""
    points, values = _sampled(body)
    inside = np.isfinite(values)
    table = np.column_stack([points + body.origin_m, values])[inside]
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=f"x_m,y_m,z_m,{NAME}", comments="")
