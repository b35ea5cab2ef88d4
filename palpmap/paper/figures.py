"""Convergence figures like the paper's Figs. 8-13: each sought parameter against the iteration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models import replaced
from palpmap.figures.style import settle
from palpmap.paper.identical_twin import PaperResult, symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The paper's figure of each test; both runs of test I stand in one.
FIGURES = {"I_1": 8, "I_2": 8, "II": 9, "III": 10, "IV": 11, "V": 12, "VI": 13}
# Colours that differ for colour-blind eyes too (Okabe and Ito).
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
_DPI = 150
_AXES = {"Pa": "Young's modulus / Pa", "mm": "length / mm"}


def draw_figures(results: Sequence[PaperResult], folder: Path) -> list[Path]:
    """Draw the figures of solved tests; return the paths of the PNG and SVG files.

    `folder` is made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    numbers = dict.fromkeys(FIGURES[result.test.name] for result in results)
    return [
        path
        for number in sorted(numbers)
        for path in _draw(number, [r for r in results if FIGURES[r.test.name] == number], folder)
    ]


def _draw(number: int, results: Sequence[PaperResult], folder: Path) -> list[Path]:
    """Draw one figure; moduli and lengths, and each run, have a panel of their own."""
    from matplotlib.figure import Figure

    panels = [
        (result, unit)
        for result in results
        for unit in _AXES
        if any(symbol(theta).unit == unit for theta in result.test.theta)
    ]
    figure = Figure(figsize=(5.0 * len(panels), 3.6), layout="constrained")
    for axes, (result, unit) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels,
                                    strict=True):  # fmt: skip
        _panel(axes, result, unit)
        if len(results) > 1:
            axes.set_title(f"start {result.test.name.split('_')[1]}")
    name = results[0].test.name.split("_")[0]
    figure.suptitle(f"Test {name} (paper: Fig. {number}), identical twin")
    paths = [folder / f"paper_test_{name}{ending}" for ending in (".png", ".svg")]
    settle(figure, _DPI)
    for path in paths:
        with replaced(path, f".part{path.suffix}") as beside:
            figure.savefig(beside, dpi=_DPI)
    return paths


def _panel(axes: Axes, result: PaperResult, unit: str) -> None:
    """Plot the parameters of one unit, each with its correct value dashed."""
    correct = result.values(result.test.correct)
    chosen = [i for i, theta in enumerate(result.test.theta) if symbol(theta).unit == unit]
    # Coordinates that move alike hide one another: the earlier lines are the wider ones.
    for place, (colour, i) in enumerate(zip(_COLOURS, chosen, strict=False)):
        path, label = result.path[:, i], result.test.theta[i]
        width = 1.2 * (len(chosen) - place)
        axes.plot(np.arange(len(path)), path, "o-", ms=3, lw=width, color=colour, label=label)
        axes.axhline(correct[i], ls="--", lw=1, color=colour)
    axes.set(xlabel="iteration", ylabel=_AXES[unit])
    axes.legend(title="dashed: correct")
