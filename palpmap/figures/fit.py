"""The figures of a run as PNG."""

from collections.abc import Callable
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from models import replaced
from palpmap.figures.curves import draw_convergence, draw_curves, draw_measured
from palpmap.figures.map import draw_map, draw_uncertainty
from palpmap.figures.posterior import draw_corner
from palpmap.figures.residual import draw_along, draw_places, draw_tests
from palpmap.figures.style import STYLE, png
from palpmap.result.finding import Finding


def draw_figures(finding: Finding) -> dict[str, bytes]:
    """Draw all figures of a run: PNG by name."""
    drawings: dict[str, Callable[[Finding], Figure | None]] = {
        "map": draw_map,
        "uncertainty": draw_uncertainty,
        "residual_place": draw_places,
        "residual_along": draw_along,
        "residual_tests": draw_tests,
        "measured_modelled": draw_measured,
        "presses": draw_curves,
        "convergence": draw_convergence,
        "posterior": draw_corner,
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
        with replaced(path) as beside:
            beside.write_bytes(picture)
        paths.append(path)
    return tuple(paths)
