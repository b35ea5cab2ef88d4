"""One look for all figures, safe for colour-blind eyes, without global state."""

from collections.abc import Iterable
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

# Okabe & Ito's palette: distinct for all common kinds of colour vision.
BLACK, BLUE, ORANGE, GREEN, PINK, SKY = (
    "#222222", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9",
)  # fmt: skip
GREY = "#8a8f98"
MODULUS_COLORS = "viridis"
_WIDE = 10.0  # ratio of moduli from which on their colours are logarithmic
DIFFERENCE_COLORS = "PuOr_r"
STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555b66",
    "axes.labelcolor": "#333a45",
    "xtick.color": "#555b66",
    "ytick.color": "#555b66",
    "legend.frameon": False,
    "figure.facecolor": "white",
}
DPI = 130
_RUNS = 3  # zlib's Z_RLE: as small for flat colours, in two thirds of the time


LARGEST_DOT = 500.0
"""Area of a press's dot at most, square points: few presses make no discs."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches with its own canvas."""
    margins = ConstrainedLayoutEngine(rect=(0.01, 0.01, 0.98, 0.98))
    figure = Figure(figsize=(width, height), layout=margins)
    FigureCanvasAgg(figure)
    return figure


def settle(figure: Figure, dpi: float = DPI) -> None:
    """Place all parts of a constrained figure for good; without it each save does so twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        figure.set_dpi(dpi)
        engine.execute(figure)
        figure.set_layout_engine(None)


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    settle(figure)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, pil_kwargs={"compress_type": _RUNS})
    return buffer.getvalue()


def panel_grid(axes: Axes) -> None:
    """Give a plot a faint grid behind its data."""
    axes.grid(color="#e3e6ea", linewidth=0.8)
    axes.set_axisbelow(True)


def plain_log_ticks(axis: Axis) -> None:
    """Write 20, 50, 100 on a logarithmic axis, not powers; of many decades their ends alone."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    low, high = axis.get_view_interval()
    steps = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0) if high < 10 * low else (1.0, 2.0, 5.0)
    steps = (1.0,) if high > 300 * low else steps
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_below(figure: Figure, axes: Iterable[Axes]) -> None:
    """Put one legend of all panels under them, where it hides no curve."""
    named = {
        label: handle
        for panel in axes
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        named.values(), named.keys(), loc="outside lower center", ncols=len(named), fontsize=9
    )


def widest_axes(points: np.ndarray) -> tuple[int, int]:
    """Return the two axes along which points (j, 3) spread most, in their own order."""
    first, second = sorted(np.argsort(-np.ptp(points, axis=0), kind="stable")[:2])
    return int(first), int(second)


def is_wide(span: tuple[float, float]) -> bool:
    """Return True for moduli so far apart that their colours are logarithmic.

    >>> is_wide((5.0, 30.0)), is_wide((5.0, 80.0))
    (False, True)
    """
    return span[1] > _WIDE * span[0] > 0
