"""Maps, parameters and single presses before and after the missing effect."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identify.body import ChangedMap
from identify.map import GaussianMap
from identify.select import Explanation, Step
from palpmap.figures.curves import draw_readings
from palpmap.figures.cuts import cut_size, cuts, sample, seen_part
from palpmap.figures.map import (
    color_bar,
    colour_span,
    draw_circles,
    extension,
    hatch_blind,
    limit_to_body,
    show_cut,
)
from palpmap.figures.style import (
    BLUE,
    GREEN,
    GREY,
    MODULUS_COLORS,
    ORANGE,
    legend_below,
    new_figure,
    panel_grid,
)
from palpmap.result.finding import Finding
from palpmap.result.records import ExplainRecord
from palpmap.study.frame import frame_shift_m
from palpmap.units import plain_name, scale, unit_of

_PALE = 0.25  # of the colour, for shifts outside the intervals


def draw_maps(finding: Finding, explained: Explanation) -> Figure:
    """Draw the map without and with the added effects, and the true one where it is known."""
    first, last = explained.ladder[0], explained.final
    shown: list[tuple[str, GaussianMap | ChangedMap]] = [("Found", last.fit.changed_map)]
    if len(explained.ladder) > 1:
        start = (
            " + ".join(("map", *first.fit.effect_names)) if first.fit.effect_names else "map alone"
        )
        names = " + ".join(last.fit.effect_names) or "map alone"
        shown = [
            (f"Before: {start}", first.fit.changed_map),
            (f"After: with {names}", last.fit.changed_map),
        ]
    fits = [first.fit, last.fit][-len(shown) :]
    if finding.truth is not None:
        shown.append(("True", finding.truth))
    both = cuts(finding)
    fields = [[sample(finding, cut, m.modulus) / 1e3 for _, m in shown] for cut in both]
    # Colours of the last map: the error of the first may dwarf it
    fit_of = [*fits, last.fit][: len(shown)]  # the truth is judged where the last map is
    judged = [
        seen_part(finding, fit, cut, v)
        for cut, row in zip(both, fields, strict=True)
        for v, fit in list(zip(row, fit_of, strict=True))[len(explained.ladder) > 1 :]
    ]
    low, high = colour_span(judged)
    sizes = [cut_size(finding, cut) for cut in both]
    heights = [max(height / width, 0.3) for width, height in sizes]
    width = 3.4 * len(shown) + 1.1
    figure = new_figure(width, 3.3 * sum(heights) + 1.3)
    grid = figure.subplots(2, len(shown), squeeze=False, height_ratios=heights)
    image = None
    for row, cut in enumerate(both):
        for column, (title, stiffness) in enumerate(shown):
            axes = grid[row, column]
            image = show_cut(axes, finding, cut, fields[row][column], MODULUS_COLORS, (low, high))
            draw_circles(axes, finding, stiffness.inclusions, cut, "-")
            if column < len(fits):
                hatch_blind(axes, finding, fits[column], cut)
            if finding.truth is not None:
                draw_circles(axes, finding, finding.truth.inclusions, cut, "--")
            limit_to_body(axes, finding, cut)
            if row == 0:
                axes.set_title(_broken(title))
            if column:
                axes.set_ylabel("")
    if image is not None:
        extend = extension([v for row in fields for v in row], (low, high))
        label = "Young's modulus, kPa"
        color_bar(image, ax=grid, label=label, shrink=0.8, extend=extend)
    return figure


def _broken(title: str, width: int = 34) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(title, width))


def draw_parameters(
    finding: Finding, explained: Explanation, record: ExplainRecord
) -> Figure | None:
    """Draw each free parameter of the map with its 95 % interval at every step, and the truth.

    The last step's intervals are those of result.json, pale with the shift by an undetected effect;
    those of the steps before are 1.96 standard errors. None of a held map, or of a single step
    without such shifts.
    """
    steps, last = explained.ladder, explained.final
    shifts = record.unseen_shifts
    names = [n for n in last.fit.map.names if n in last.fit.std]
    if not names or (len(steps) < 2 and not shifts):
        return None
    columns = min(len(names), 6)
    rows = -(-len(names) // columns)
    figure = new_figure(10.4, 2.5 * rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False)
    at = np.arange(len(steps))
    for axes in grid.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(grid.flat, names, strict=False):
        panel_grid(axes)
        factor, unit = scale(unit_of(name))
        shift = frame_shift_m(name, finding.origin_m)
        value = np.array([factor * (step.fit.values.get(name, np.nan) + shift) for step in steps])
        error = np.array([1.96 * factor * step.fit.std.get(name, np.nan) for step in steps])
        low, high = value - error, value + error
        bar = record.parameters[name]
        low[-1], high[-1] = factor * bar.lower95, factor * bar.upper95
        colors = [GREY] * (len(steps) - 1) + [BLUE]
        for x, v, below, above, hue in zip(at, value, low, high, colors, strict=True):
            axes.vlines(x, below, above, color=hue, lw=1.8)
            axes.plot(x, v, "o", color=hue, ms=5)
        if name in shifts:
            further = factor * shifts[name].shift
            ends = low[-1] - further, high[-1] + further
            axes.plot(
                [len(steps) - 1] * 2, ends, color=BLUE, alpha=_PALE, lw=7, solid_capstyle="butt"
            )
        if name in finding.true:
            axes.axhline(factor * finding.true[name], color=GREEN, ls="--", lw=1.5)
        words = ["before", *[""] * (len(steps) - 2), "after"] if len(steps) > 1 else ["found"]
        axes.set_xticks(at, words)
        axes.set_xlim(-0.6, len(steps) - 0.4)
        axes.set_title(f"{plain_name(name)}\n{unit}", size=9)
    return figure


def draw_presses(explained: Explanation) -> Figure:
    """Draw force against displacement of three presses, with the model before and after."""
    first, last = explained.ladder[0], explained.final
    compliance = last.fit.at.body.compliance
    worst = max(range(len(compliance)), key=lambda j: first.comparison.presses[j].misfit)
    chosen: dict[int, str] = {}
    for j, words in (
        (worst, "largest misfit" if first is last else "largest misfit before"),
        (int(np.argmin(compliance)), "stiffest place"),
        (int(np.argmax(compliance)), "softest place"),
    ):
        chosen[j] = f"{chosen[j]}, {words}" if j in chosen else words
    figure = new_figure(10.4, 3.9)
    for axes, (j, words) in zip(
        figure.subplots(1, len(chosen), squeeze=False).flat, chosen.items(), strict=True
    ):
        _press(axes, first, last, j)
        axes.set_title(f"Press {last.comparison.presses[j].press}: {words}")
    legend_below(figure, figure.axes)
    return figure


def _press(axes: Axes, first: Step, last: Step, press: int) -> None:
    panel_grid(axes)
    model = last.fit.model
    rows = model.readings.press == press
    force = model.readings.force_n
    phase = model.readings.phase[rows]
    draw_readings(axes, model.displacement_m[rows], force[rows], phase)
    lines = [(last, ORANGE, 1.6, "model")]
    if first is not last:
        lines = [(first, GREY, 1.4, "model before"), (last, ORANGE, 1.6, "model after")]
    for step, color, width, label in lines:
        predicted = step.fit.at.predicted_m[rows]
        axes.plot(1e3 * predicted, force[rows], color=color, lw=width, label=label)
