"""The residual: over the surface, along force, time, phase and order, and by test."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identify.effects import digits
from identify.residual import Comparison, Level
from palpmap.figures.style import (
    BLUE,
    DIFFERENCE_COLORS,
    GREY,
    LARGEST_DOT,
    ORANGE,
    PINK,
    new_figure,
    panel_grid,
    widest_axes,
)
from palpmap.result.finding import Finding
from palpmap.result.tables import ANSWERS

TITLES = {
    "force": ("By force", "true force (best estimate), N"),
    "time": ("By time within a press", "time since the press's first reading, s"),
    "phase": ("By phase", ""),
    "order": ("By order of pressing", "press number"),
}


def draw_places(f: Finding) -> Figure:
    """Draw each press's mean residual over the surface, in µm and in standard deviations."""
    presses = f.comparison.presses
    points = 1e3 * (np.array([p.point_m for p in presses]) + f.origin_m)
    mean = 1e6 * np.array([p.mean_m for p in presses])
    signed = np.sign(mean) * np.array([p.sigmas for p in presses])
    bad = np.array([p.bad for p in presses])
    right, up = widest_axes(points)
    figure = new_figure(10.4, 4.7)
    left, other = figure.subplots(1, 2, sharex=True, sharey=True)
    extent = np.ptp(points[:, [right, up]], axis=0).max() or 1.0
    spacing = np.sqrt(np.prod(np.maximum(np.ptp(points[:, [right, up]], axis=0), 1)) / len(points))
    size = min((230 * spacing / extent) ** 2 * 0.55, LARGEST_DOT)
    for axes, values, unit, least in (
        (left, mean, "mean residual, µm", 1.0),
        (other, signed, "misfit of the press, standard deviations", 4.0),
    ):
        reach = max(float(np.abs(values).max()), least)
        image = axes.scatter(
            points[:, right], points[:, up], c=values, s=size, cmap=DIFFERENCE_COLORS,
            vmin=-reach, vmax=reach, edgecolors=GREY, linewidths=0.5, clip_on=False,
        )  # fmt: skip
        axes.scatter(
            points[bad, right], points[bad, up], s=size * 1.5, facecolors="none",
            edgecolors=PINK, linewidths=2.0,
        )  # fmt: skip
        figure.colorbar(image, ax=axes, label=unit, shrink=0.85)
        axes.set_aspect("equal")
        axes.margins(0.1)
        axes.set_xlabel(f"{'xyz'[right]}, mm")
    left.set_ylabel(f"{'xyz'[up]}, mm")
    left.set_title("Where the body gives way more (+) or less (−)")
    ringed = "; pink ring: outlier" if bad.any() else ""
    other.set_title(f"The same against the noise{ringed}")
    for press, point in zip(presses, points, strict=True):
        if press.bad:
            other.annotate(
                str(press.press), point[[right, up]], (9, 6), textcoords="offset points", fontsize=9
            )
    return figure


def draw_along(f: Finding) -> Figure:
    """Draw the mean residual along force, time, phase and order with the band of pure noise."""
    c = f.comparison
    figure = new_figure(10.4, 6.4)
    for axes, (name, (title, label)) in zip(
        figure.subplots(2, 2).flat, TITLES.items(), strict=True
    ):
        levels = c.levels.get(name)
        axes.set_title(title)
        if not levels:
            reason = c.test(name).untestable or "too few readings"
            axes.text(
                0.5, 0.5, f"cannot be tested:\n{reason}", ha="center", va="center", color=GREY,
                transform=axes.transAxes, wrap=True,
            )  # fmt: skip
            axes.set_axis_off()
            axes.set_title(title)
            continue
        _steps(axes, levels, name)
        axes.set_xlabel(label)
        axes.set_ylabel("mean residual, µm")
        axes.text(
            0.99, 0.97, _verdict(c, name), transform=axes.transAxes, ha="right", va="top",
            fontsize=9, color=ORANGE if c.test(name).fires else GREY,
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
        )  # fmt: skip
    return figure


def draw_tests(f: Finding) -> Figure:
    """Draw the size of the residuals against the noise, and all tests with their results."""
    figure = new_figure(10.4, 4.3)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
    r = f.fit.residual_m / f.fit.sigma_m
    reach = min(max(4.5, float(np.abs(r).max()) * 1.05), 12.0)
    edges = np.linspace(-reach, reach, 61)
    left.hist(np.clip(r, -reach, reach), edges, density=True, color=BLUE, alpha=0.55)
    x = np.linspace(-reach, reach, 400)
    left.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color=ORANGE, lw=2)
    left.set_xlabel("residual of a reading, standard deviations")
    left.set_yticks([])
    left.spines["left"].set_visible(False)
    left.set_title(f"All {len(r)} readings; curve: pure noise")
    _answers(right, f.comparison)
    return figure


def _answers(axes: Axes, c: Comparison) -> None:
    """Draw -log10 of each test's adjusted p-value as a bar, and the level of significance.

    Each bar ends in a dot, as one of no length would look as if it were missing.
    """
    tests = c.tests[::-1]
    floor = 1e-12
    values = [-np.log10(max(t.p_adjusted, floor)) for t in tests]
    colors = [ORANGE if t.fires else BLUE for t in tests]
    axes.barh(range(len(tests)), values, color=colors, height=0.62)
    for row, test in enumerate(tests):
        if test.untestable:
            axes.text(2.15, row, "cannot be tested", va="center", color=GREY, fontsize=9)
        else:
            axes.plot(values[row], row, "o", ms=8, color=colors[row], clip_on=False, zorder=3)
    axes.axvline(-np.log10(c.alpha), color="#333a45", lw=1, ls="--")
    axes.set_yticks(range(len(tests)), [ANSWERS[t.name] for t in tests])
    axes.tick_params(axis="y", length=0, pad=9)  # room for a dot on the axis
    ticks = [0, 2, 4, 8, 12]
    axes.set_xticks(ticks, ["1", "0.01", "1e-4", "1e-8", "≤ 1e-12"])
    axes.set_xlim(0, 12.3)
    axes.set_xlabel("p-value (corrected for all tests)")
    axes.set_title("Structure found: bars beyond the dashed line")


def _steps(axes: Axes, levels: tuple[Level, ...], name: str) -> None:
    mean = 1e6 * np.array([v.mean_m for v in levels])
    error = 1e6 * np.array([v.error_m for v in levels])
    if name == "phase":
        x = np.arange(len(levels), dtype=float)
        axes.set_xticks(x, [v.label for v in levels])
        half = np.full(len(levels), 0.35)
        axes.set_xlim(-0.6, len(levels) - 0.4)
    else:
        low = np.array([v.low for v in levels])
        high = np.array([v.high for v in levels])
        x, half = (low + high) / 2, np.maximum((high - low) / 2, 0.015 * (high[-1] - low[0]))
    panel_grid(axes)
    # Two standard errors: 95 % of the means of pure noise.
    axes.bar(x, 4 * error, 2 * half, -2 * error, color="#d9dde3", label="pure noise, 95 %")
    axes.axhline(0, color=GREY, lw=0.8)
    style: dict[str, Any] = {"color": BLUE, "ms": 5, "lw": 1.4, "capsize": 0}
    axes.errorbar(x, mean, error, fmt="o-" if name != "phase" else "o", **style)
    reach = max(float(np.max(np.abs(mean) + 2.2 * error)), 1e-3) * 1.3
    axes.set_ylim(-reach, reach)
    axes.legend(loc="lower right", fontsize=8.5, handlelength=1.2)


def _verdict(c: Comparison, name: str) -> str:
    test = c.test(name)
    if test.untestable:
        return "cannot be tested"
    if not test.fires:
        return "like noise"
    return f"{digits(test.times_noise)} times the noise"
