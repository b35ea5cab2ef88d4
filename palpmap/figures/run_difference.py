"""Two fitted maps of one body, and where they differ."""

import numpy as np
from matplotlib.figure import Figure

from identify.residual import RunDifference
from palpmap.figures.style import DIFFERENCE_COLORS, new_figure


def draw_difference(d: RunDifference, origin_m: np.ndarray) -> Figure:
    """Draw the ratio of the maps, and the difference in standard errors, where it is largest."""
    figure = new_figure(10.4, 4.4)
    place = np.unravel_index(d.largest, d.grid.counts)
    low = 1e3 * (np.array(d.grid.lower_m) + origin_m)
    high = low + 1e3 * np.array(d.grid.spacing_m) * (np.array(d.grid.counts) - 1)
    depth = low[2] + 1e3 * d.grid.spacing_m[2] * place[2]
    panels = (
        (100 * np.expm1(d.log_ratio), "Other modulus over the one, less 1, %"),
        (d.standard_errors, "Difference in standard errors"),
    )
    for axes, (values, title) in zip(figure.subplots(1, 2), panels, strict=True):
        layer = values.reshape(d.grid.counts)[:, :, place[2]].T
        most = max(float(np.abs(layer).max()), 1e-3)
        image = axes.imshow(
            layer, origin="lower", extent=(low[0], high[0], low[1], high[1]), vmin=-most,
            vmax=most, cmap=DIFFERENCE_COLORS, interpolation="bilinear",
        )  # fmt: skip
        axes.set_title(title)
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        figure.colorbar(image, ax=axes, shrink=0.8)
    figure.suptitle(f"Layer at z = {depth:.1f} mm, where the maps differ most", x=0.02, ha="left")
    return figure
