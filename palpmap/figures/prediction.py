"""A prediction of a scan beside its measurement, with the bands."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identify.residual import Prediction
from palpmap.figures.style import BLACK, BLUE, GREY, ORANGE, SKY, new_figure, panel_grid


def draw_prediction(p: Prediction) -> Figure:
    """Draw measured against predicted travel, errors over their bands, and single presses."""
    figure = new_figure(10.4, 7.4)
    rows = figure.add_gridspec(2, 6)
    _measured(figure.add_subplot(rows[0, :2]), figure.add_subplot(rows[0, 2:]), p)
    near = np.abs(p.press_error_m) / p.press_sd_m
    order = np.argsort(near)
    chosen = dict.fromkeys([int(order[len(order) // 2]), int(order[-1]), int(order[0])])
    words = ("the middle press", "the farthest off", "the nearest")
    for number, (j, said) in enumerate(zip(chosen, words, strict=False)):
        axes = figure.add_subplot(rows[1, 2 * number : 2 * number + 2])
        _curve(axes, p, j)
        axes.set_title(f"Press {p.scan.press_ids[j]}: {said}")
        if number == 0:
            axes.legend(fontsize=9, loc="upper left")
    return figure


def _measured(left: Axes, right: Axes, p: Prediction) -> None:
    measured = p.scan.at_largest_force(p.scan.displacement_m) * 1e3
    predicted = measured - 1e3 * p.press_error_m
    ends = np.array([min(measured.min(), predicted.min()), max(measured.max(), predicted.max())])
    ends += np.array([-0.04, 0.04]) * max(float(np.ptp(ends)), 1e-3)
    panel_grid(left)
    left.plot(ends, ends, color=GREY, lw=1)
    left.errorbar(
        predicted, measured, xerr=1.96e3 * p.press_sd_m, fmt="o", ms=4, lw=0.8, color=BLUE
    )
    left.set_aspect("equal")
    left.set_xlabel("predicted, mm, 95 % band")
    left.set_ylabel("measured, mm")
    left.set_title("Travel near the largest force")
    panel_grid(right)
    right.axhspan(-1.96, 1.96, color=SKY, alpha=0.25, lw=0, label="95 % band")
    right.plot(p.scan.press_ids, p.press_error_m / p.press_sd_m, "o", ms=4, color=BLUE)
    right.axhline(0, color=GREY, lw=1)
    right.set_xlabel("press number")
    right.set_ylabel("error over the band's sd")
    right.set_title("Measured less predicted")
    right.legend(fontsize=9, loc="upper right")


def _curve(axes: Axes, p: Prediction, j: int) -> None:
    rows = np.flatnonzero(p.scan.press_index == j)
    rows = rows[np.argsort(p.scan.force_n[rows], kind="stable")]
    force, travel = p.scan.force_n[rows], 1e3 * p.predicted_m[rows]
    band = 1.96e3 * p.sd_m[rows]
    panel_grid(axes)
    axes.fill_betweenx(force, travel - band, travel + band, color=ORANGE, alpha=0.25, lw=0)
    axes.plot(travel, force, color=ORANGE, label="predicted, 95 %")
    axes.plot(1e3 * p.scan.displacement_m[rows], force, "o", ms=4, color=BLACK, label="measured")
    axes.set_xlabel("travel, mm")
    axes.set_ylabel("force, N")
