"""Measured against modelled displacement, single presses, and how the fit got there."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpmap.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PINK,
    SKY,
    legend_below,
    new_figure,
    panel_grid,
    plain_log_ticks,
)
from palpmap.result.finding import Finding
from palpmap.study.frame import frame_shift_m
from palpmap.units import plain_name, scale, unit_of

MARKS = {"load": "o", "hold": "s", "unload": "^"}
HUES = (BLUE, ORANGE, GREEN, PINK, SKY, "#E69F00")


def draw_measured(f: Finding) -> Figure:
    """Draw the mean displacement of each press near its largest force, measured and modelled."""
    measured, modelled, sigma = near_largest_force(f)
    figure = new_figure(10.4, 4.1)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.9])
    ends = np.array([min(measured.min(), modelled.min()), max(measured.max(), modelled.max())])
    ends += np.array([-0.04, 0.04]) * np.ptp(ends)
    panel_grid(left)
    left.plot(ends, ends, color=GREY, lw=1)
    left.errorbar(modelled, measured, 2 * sigma, fmt="o", ms=4, lw=0.8, color=BLUE)
    left.set_aspect("equal")
    left.set_xlabel("modelled, mm")
    left.set_ylabel("measured, mm")
    left.set_title("Displacement near the largest force")
    ids = f.scan.press_ids
    panel_grid(right)
    right.errorbar(
        ids, measured, 2 * sigma, fmt="o", ms=4, lw=0.8, color=BLUE, label="measured, ± 2 sd"
    )
    right.plot(ids, modelled, "_", color=ORANGE, ms=8, mew=2, label="modelled")
    right.set_xlabel("press number")
    right.set_ylabel("displacement, mm")
    right.set_title("The same, press by press")
    right.margins(y=0.18)
    right.legend(ncols=2, loc="upper right", fontsize=9)
    return figure


def draw_curves(f: Finding) -> Figure:
    """Draw force against displacement of the stiffest, softest, and least well fitted press."""
    stiffness = 1 / f.fit.compliance_m_per_n
    worst = f.comparison.worst_presses[0].press
    chosen: dict[int, str] = {}
    for j, words in (
        (int(np.argmax(stiffness)), "stiffest place"),
        (int(np.argmin(stiffness)), "softest place"),
        (int(np.flatnonzero(f.scan.press_ids == worst)[0]), "largest misfit"),
    ):
        chosen[j] = f"{chosen[j]}, {words}" if j in chosen else words
    figure = new_figure(10.4, 3.9)
    for axes, (j, words) in zip(
        figure.subplots(1, len(chosen), squeeze=False).flat, chosen.items(), strict=True
    ):
        _curve(axes, f, j)
        x, y = 1e3 * (f.scan.contact_points[j] + f.origin_m)[:2]
        axes.set_title(f"Press {f.scan.press_ids[j]}: {words}\nat x {x:.0f}, y {y:.0f} mm")
    legend_below(figure, figure.axes)
    return figure


def draw_convergence(f: Finding) -> Figure | None:
    """Draw parameters and error against iteration; None without at least two iterations."""
    history = f.fit.history
    if len(history) < 2:
        return None
    steps = [step.iteration for step in history]
    # Of the map: effects join it at the end
    free = [n for n, e in f.fit.parameters.items() if e.free and n in f.fit.map.names]
    kinds = {unit: [n for n in free if unit_of(n) == unit] for unit in ("Pa", "m")}
    panels = [(unit, names) for unit, names in kinds.items() if names]
    figure = new_figure(10.4, 4.6)
    grid = figure.subplots(1, 1 + len(panels))
    for axes, (unit, names) in zip(np.atleast_1d(grid)[1:], panels, strict=True):
        _paths(axes, f, names)
        kind = "Modulus" if unit == "Pa" else "Position and radius"
        axes.set_title(f"{kind}, {scale(unit)[1]}")
    error = np.atleast_1d(grid)[0]
    panel_grid(error)
    error.semilogy(steps, [1e6 * step.rms_m for step in history], "o-", color=BLUE, ms=4)
    noise = 1e6 * f.comparison.expected_rms_m
    error.axhline(noise, color=GREY, ls="--", lw=1.2)
    error.text(steps[-1], noise, "noise alone ", ha="right", va="bottom", color=GREY, fontsize=9)
    plain_log_ticks(error.yaxis)
    error.set_title("Error of the displacement (rms), µm")
    for axes in np.atleast_1d(grid):
        axes.set_xlabel("iteration")
    return figure


def _paths(axes: Axes, f: Finding, names: list[str]) -> None:
    """Plot each parameter over the iterations; a dotted line marks its true value."""
    panel_grid(axes)
    steps = [step.iteration for step in f.fit.history]
    for i, name in enumerate(names):
        hue, shift = HUES[i % len(HUES)], frame_shift_m(name, f.origin_m)
        factor, _ = scale(unit_of(name))
        path = [factor * (step.parameters[name] + shift) for step in f.fit.history]
        axes.plot(steps, path, "o-", color=hue, ms=3.5, label=plain_name(name))
        if name in f.true:
            axes.axhline(factor * f.true[name], color=hue, ls=":", lw=1.6)
    if f.true:
        axes.plot([], [], ":", color=GREY, label="true")
    # Below, where it hides no curve
    axes.legend(fontsize=8.5, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16))


def near_largest_force(f: Finding) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean measured and modelled displacement of each press and its standard deviation, mm (j,).

    Over all readings within 10 % of the press's largest force: the single largest would be the one
    whose noise is largest.
    """
    mean = f.scan.used().at_largest_force
    measured, modelled = mean(f.fit.displacement_m), mean(f.fit.predicted_m)
    readings = np.bincount(f.fit.press_index, f.scan.used().near_largest_force)
    sigma = np.sqrt(mean(f.fit.sigma_m**2) / readings)
    return 1e3 * measured, 1e3 * modelled, 1e3 * sigma


def _curve(axes: Axes, f: Finding, press: int) -> None:
    panel_grid(axes)
    rows = f.fit.press_index == press
    draw_readings(axes, f.fit.displacement_m[rows], f.fit.force_n[rows], f.scan.phase[rows])
    top = float(f.fit.latent_force_n[rows].max())
    axes.plot(
        [0, 1e3 * f.fit.compliance_m_per_n[press] * top], [0, top], color=ORANGE, lw=1.8,
        label="model",
    )  # fmt: skip


def draw_readings(
    axes: Axes, displacement_m: np.ndarray, force_n: np.ndarray, phase: np.ndarray
) -> None:
    """Draw force against displacement of the readings of a press, (m,), a mark for each phase."""
    for name, mark in MARKS.items():
        at = phase == name
        if at.any():
            axes.plot(
                1e3 * displacement_m[at], force_n[at], mark, ms=4.5, color=BLUE, ls="",
                mfc=BLUE if name == "load" else "white", label=f"measured, {name}",
            )  # fmt: skip
    axes.set_xlabel("displacement, mm")
    axes.set_ylabel("force, N")
