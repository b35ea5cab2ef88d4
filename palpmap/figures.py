"""The figures of a run as PNG: one look for all, safe for colour-blind eyes, no global state."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from palpmap.finding import Finding

# Okabe & Ito's palette: distinct for all common kinds of colour vision.
BLACK, BLUE, ORANGE, GREEN, PINK, SKY = (
    "#222222", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9",
)  # fmt: skip
GREY = "#8a8f98"
MODULUS_COLORS = "viridis"
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


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches with its own canvas."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def panel_grid(axes: Axes) -> None:
    """Give a plot a faint grid behind its data."""
    axes.grid(color="#e3e6ea", linewidth=0.8)
    axes.set_axisbelow(True)


def draw_figures(finding: Finding) -> dict[str, bytes]:
    """Draw all figures of a run: PNG by name."""
    from palpmap.fit_figures import draw_convergence, draw_curves, draw_measured
    from palpmap.map_figures import draw_map, draw_uncertainty
    from palpmap.residual_figures import draw_along, draw_places, draw_tests

    drawings: dict[str, Callable[[Finding], Figure | None]] = {
        "map": draw_map,
        "uncertainty": draw_uncertainty,
        "residual_place": draw_places,
        "residual_along": draw_along,
        "residual_tests": draw_tests,
        "measured_modelled": draw_measured,
        "presses": draw_curves,
        "convergence": draw_convergence,
    }
    pictures = {}
    with rc_context(STYLE):
        for name, draw in drawings.items():
            figure = draw(finding)
            if figure is not None:
                pictures[name] = png(figure)
    return pictures


def save_figures(pictures: dict[str, bytes], folder: Path) -> tuple[Path, ...]:
    """Write pictures as `folder`/NAME.png and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, picture in pictures.items():
        path = folder / f"{name}.png"
        path.write_bytes(picture)
        paths.append(path)
    return tuple(paths)
