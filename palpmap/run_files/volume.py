"""A free map as a volume for ParaView and others: map.vti."""

from pathlib import Path

import numpy as np

from identify.map import FreeMap
from models import replaced
from palpmap.result.finding import Finding


def write_vti(finding: Finding, path: Path) -> None:
    """Write a free map on its grid, in the scan's frame, m and Pa.

    Point data: `modulus_pa` and its 95 % band `lower95_pa`, `upper95_pa`; `log_sd`, the standard
    deviation of its logarithm; `seen`, the share of the prior's variance that the scan takes away;
    `inside`, 1 in the body.
    """
    import pyvista

    stiffness, field = finding.fit.map, finding.fit.field
    assert isinstance(stiffness, FreeMap)
    assert field is not None
    grid = stiffness.grid
    volume = pyvista.ImageData(
        dimensions=grid.counts, spacing=grid.spacing_m, origin=grid.lower_m + finding.origin_m
    )
    reach = 1.96 * field.log_sd
    values = {
        "modulus_pa": np.exp(stiffness.log_pa),
        "lower95_pa": np.exp(stiffness.log_pa - reach),
        "upper95_pa": np.exp(stiffness.log_pa + reach),
        "log_sd": field.log_sd,
        "seen": field.share,
        "inside": finding.outline.inside(grid.points_m).astype(float),
    }
    for name, value in values.items():
        # VTK's first axis runs fastest
        volume.point_data[name] = value.reshape(grid.counts).ravel(order="F").astype(np.float32)
    volume.set_active_scalars("modulus_pa")
    with replaced(path, ".part.vti") as beside:
        volume.save(beside)
