"""The ladder of an explanation: error, residuals and evidence, step by step."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D

from identify.select import Diagnosis, Explanation, Step
from palpmap import units
from palpmap.figures.style import (
    BLACK,
    BLUE,
    DIFFERENCE_COLORS,
    GREEN,
    GREY,
    LARGEST_DOT,
    ORANGE,
    PINK,
    new_figure,
    panel_grid,
    plain_log_ticks,
    widest_axes,
)
from palpmap.result.evidence import Axis, Curve, Evidence
from palpmap.result.explain_words import step_labels

FAR_APART = 10.0  # times the usual distance of two bins: no line leads from one to the next
_MISFIT_COLORS = "magma_r"
_PHASE_HUES = {"": BLUE, "load": BLUE, "hold": PINK, "unload": GREEN}


def draw_ladder(explained: Explanation) -> Figure:
    """Draw the error and that of the cross-validation, step by step, down to the noise."""
    figure = new_figure(10.4, 4.6)
    axes = figure.subplots()
    panel_grid(axes)
    steps = explained.ladder
    at = np.arange(len(steps))
    rms = 1e6 * np.array([step.fit.rms_m for step in steps])
    apart = 1e6 * np.array([step.cross_validation.rms_m for step in steps])
    high = [step.cross_validation.high_rms_m for step in steps]
    noise = 1e6 * steps[-1].comparison.expected_rms_m
    axes.set_yscale("log")
    axes.axhspan(noise / 30, noise, color="#eef0f3", zorder=0)
    axes.axhline(noise, color=GREY, ls="--", lw=1.4)
    axes.plot(at, rms, "o-", color=BLUE, ms=9, lw=2.2, label="error of the fit (rms)")
    axes.plot(at, apart, "s--", color=ORANGE, ms=6, lw=1.4, label="cross-validation")
    lowest, lowest_at = min(rms.min(), apart.min()), apart
    if all(value is not None for value in high):
        highest = 1e6 * np.array([float(value or 0) for value in high])
        axes.plot(at, highest, "^:", color=GREEN, ms=6, lw=1.4, label="forces left out")
        lowest, lowest_at = min(lowest, highest.min()), np.minimum(apart, highest)
        apart = np.maximum(apart, highest)
    for x, value, step in zip(at, rms, steps, strict=True):
        under = value <= lowest_at[x]  # no other curve is below left, else none above right
        axes.annotate(
            f"{units.rms(1e-6 * value)}\nχ²/dof {step.fit.chi2_per_dof:.3g}", (x, value),
            (-8, -6) if under else (8, 6), textcoords="offset points",
            ha="right" if under else "left", va="top" if under else "bottom", fontsize=10,
            color=BLUE, bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1},
        )  # fmt: skip
    spread = max(rms.max(), apart.max()) / noise
    axes.set_ylim(min(noise * spread**-0.25, lowest) / 1.35, noise * max(spread, 1.0) ** 1.3 * 1.6)
    axes.set_xlim(-0.55, max(len(steps) - 0.45, 1.45))
    axes.annotate(
        f"the noise alone: {units.rms(1e-6 * noise)}", (0, noise), (6, -4), ha="left", va="top",
        xycoords=("axes fraction", "data"), textcoords="offset points", color="#4b515b",
    )  # fmt: skip
    axes.set_xticks(at, _labels(steps))
    axes.tick_params(axis="x", labelsize=11, length=0)
    plain_log_ticks(axes.yaxis)
    axes.set_ylabel("measured less modelled displacement, µm")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.995), ncols=3, borderaxespad=0.0)
    return figure


def draw_residuals(explained: Explanation, origin_m: np.ndarray) -> Figure:
    """Paint the residual of each press on the surface, at every step on one colour scale.

    Above: the mean residual; below: the rms over the press's readings in units of the noise, which
    also shows errors that average out within a press. Crosses, with their numbers, are presses that
    stand apart and are left out.
    """
    steps, apart = explained.ladder, explained.apart
    points = 1e3 * (np.array([p.point_m for p in steps[0].comparison.presses]) + origin_m)
    right, up = widest_axes(points)
    mean = [1e6 * np.array([p.mean_m for p in step.comparison.presses]) for step in steps]
    rms = [press_rms(step) for step in steps]
    reach = max(float(np.abs(v).max()) for v in mean)
    largest = max(2.0, max(float(v.max()) for v in rms))
    extent = np.ptp(points[:, [right, up]], axis=0)
    wide = len(steps)
    width = min(3.1 * wide + 1.2, 12.5)
    ratio = float(np.clip(extent[1] / max(extent[0], 1e-9), 0.35, 1.6))
    figure = new_figure(width, 2 * 0.93 * (width - 1.2) / wide * ratio + 0.9)
    grid = figure.subplots(2, len(steps), squeeze=False, sharex=True, sharey=True)
    panel = (width - 1.2) / wide * 72 * 0.62  # points across a panel's data
    size = (panel / max(np.sqrt(len(points)), 2)) ** 2 * 0.62
    size = min(size, LARGEST_DOT)
    rows = (
        (mean, DIFFERENCE_COLORS, -reach, reach, "mean residual, µm"),
        (rms, _MISFIT_COLORS, 1.0, largest, "rms in the press, noise = 1"),
    )
    for row, (values, colors, low, high, label) in enumerate(rows):
        image = None
        for column, value in enumerate(values):
            axes = grid[row, column]
            image = axes.scatter(
                points[:, right], points[:, up], c=value, s=size, cmap=colors, vmin=low,
                vmax=high, edgecolors=GREY, linewidths=0.4,
            )  # fmt: skip
            if apart is not None:
                made = 1e3 * (apart.readings.point_m[apart.readings.first] + origin_m)
                axes.plot(made[:, right], made[:, up], "x", color=GREY, ms=0.6 * np.sqrt(size))
                for press, place in zip(apart.presses, made[:, [right, up]], strict=True):
                    axes.annotate(str(press), place, (5, 5), textcoords="offset points")
            axes.set_aspect("equal")
            axes.margins(0.12)
            if row == 0:
                axes.set_title(_labels(steps)[column])
            else:
                axes.set_xlabel(f"{'xyz'[right]}, mm")
        grid[row, 0].set_ylabel(f"{'xyz'[up]}, mm")
        if image is not None:
            figure.colorbar(image, ax=list(grid[row]), label=label, shrink=0.85)
    return figure


def _labels(steps: Sequence[Step]) -> list[str]:
    """Return the change of each step, a line each."""
    return [label.replace(", ", "\n") for label in step_labels([s.fit.effect_names for s in steps])]


def press_rms(step: Step) -> np.ndarray:
    """Root mean square of each press's whitened residuals, (j,); 1 is noise."""
    press = step.fit.model.readings.press
    return np.sqrt(np.bincount(press, step.fit.at.residual**2) / np.bincount(press))


def draw_evidence(evidence: Evidence) -> Figure:
    """Draw the residual before a step, the change of the model, and the residual after it."""
    shown = evidence.shown
    figure = new_figure(10.4, 4.5)
    for number, (axes, (axis, curves)) in enumerate(
        zip(figure.subplots(1, len(shown), squeeze=False).flat, shown, strict=True)
    ):
        panel_grid(axes)
        axes.axhline(0, color=GREY, lw=0.8)
        for curve in curves:
            _evidence_curve(axes, curve)
        axes.set_xlabel(axis.label)
        axes.set_title(_along(axis))
        if number == 0:
            axes.set_ylabel("mean residual in a bin, µm")
    _evidence_legend(figure, [curve.name for _, curves in shown for curve in curves])
    return figure


def _along(axis: Axis) -> str:
    words = {
        "force": "Along the force",
        "order": "In the order of pressing",
        "softness": "From stiff to soft places",
        "time": "Within a press",
        "cycle": "Within the found cycle",
    }
    return words.get(axis.name, f"Along {axis.name}")


def _evidence_curve(axes: Axes, curve: Curve) -> None:
    hue = _PHASE_HUES[curve.name]
    axes.errorbar(
        curve.at, 1e6 * curve.before_m, 1e6 * curve.error_m, fmt="o", ms=5.5, lw=1.2, color=hue
    )
    line = hue if curve.name else ORANGE
    steps = np.diff(curve.at)
    apart = np.flatnonzero(steps > FAR_APART * np.median(steps)) + 1 if len(steps) else []
    at, change = (np.insert(1.0 * v, apart, np.nan) for v in (curve.at, 1e6 * curve.change_m))
    axes.plot(at, change, "-" if len(at) > 1 else "_", color=line, lw=2.0, ms=16, mew=2.0)
    axes.errorbar(
        curve.at, 1e6 * curve.after_m, 1e6 * curve.error_m, fmt="x", ms=4.5, lw=0.8, color=GREY
    )


def _evidence_legend(figure: Figure, names: Sequence[str]) -> None:
    """Name the marks once beside the panels, in black, and the phases by their colour."""
    from matplotlib.lines import Line2D

    phases = [name for name in _PHASE_HUES if name and name in names]
    dots, line = (BLACK, BLACK) if phases else (BLUE, ORANGE)
    handles = [
        Line2D([], [], marker="o", ls="", color=dots, label="residual before"),
        Line2D([], [], lw=2.0, color=line, label="change of the model"),
        Line2D([], [], marker="x", ls="", color=GREY, label="residual after"),
    ]
    handles += [
        Line2D([], [], marker="o", lw=2.0, color=_PHASE_HUES[name], label=name) for name in phases
    ]
    figure.legend(handles=handles, fontsize=8.5, loc="outside upper right", ncols=len(handles))


def draw_cosines(diagnosis: Diagnosis) -> Figure | None:
    """Draw the similarity of the effects in this scan, beyond the map; None of fewer than two."""
    tested = [i for i, score in enumerate(diagnosis.scores) if score.untestable is None]
    if len(tested) < 2:
        return None
    cosines = diagnosis.cosines[np.ix_(tested, tested)]
    order = alike_order(cosines)
    cosines = cosines[np.ix_(order, order)]
    names = [diagnosis.scores[tested[i]].name for i in order]
    n = len(names)
    side = max(0.34 * n, 2.0)
    figure = new_figure(side + 3.4, side + 2.2)
    axes = figure.subplots()
    edges = np.arange(n + 1) - 0.5  # an image would be resampled to millions of pixels
    mesh = axes.pcolormesh(edges, edges, cosines, cmap="Blues", vmin=0, vmax=1)
    axes.invert_yaxis()
    others = ~np.eye(n, dtype=bool)
    alike = (cosines > diagnosis.settings.alike) & others
    cells = np.argwhere((cosines >= 0.5) & others)
    _write_percents(axes, cells, cosines[tuple(cells.T)], alike[tuple(cells.T)])
    around = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    squares = [cell[::-1] + around for cell in np.argwhere(alike)]
    axes.add_collection(
        PolyCollection(squares, facecolors="none", edgecolors=ORANGE, lw=1.6), autolim=False
    )
    axes.set_xticks(range(n), names, rotation=90)
    axes.set_yticks(range(n), names)
    axes.tick_params(length=0)
    for side_of in axes.spines.values():
        side_of.set_visible(False)
    figure.colorbar(mesh, ax=axes, label="cosine of the patterns beyond the map", shrink=0.7)
    return figure


def _write_percents(axes: Axes, cells: np.ndarray, shares: np.ndarray, bold: np.ndarray) -> None:
    """Write shares (n,) as percent into cells (n, 2) of a matrix, white on a dark one.

    As outlines of one collection: a thousand texts would take as long as all other figures.
    """

    @cache
    def outline(text: str, weight: str) -> Path:
        path = TextPath((0, 0), text, size=7.5, prop=FontProperties(weight=weight))
        box = path.get_extents()
        return path.transformed(Affine2D().translate(-(box.x0 + box.x1) / 2, -box.height / 2))

    weights = np.where(bold, "bold", "normal")
    written = PathCollection(
        [outline(f"{100 * share:.0f}", w) for share, w in zip(shares, weights, strict=True)],
        offsets=cells[:, ::-1],
        offset_transform=axes.transData,
        facecolors=np.where(shares > 0.6, "white", BLACK).tolist(),
        linewidths=0,
    )
    # Points, whatever the resolution
    written.set_transform(Affine2D().scale(1 / 72) + axes.figure.dpi_scale_trans)
    axes.add_collection(written, autolim=False)


def alike_order(cosines: np.ndarray) -> np.ndarray:
    """Order (e,) that puts similar effects side by side."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    distance = np.clip(1 - (cosines + cosines.T) / 2, 0, None)
    np.fill_diagonal(distance, 0)
    tree = linkage(squareform(distance, checks=False), "average", optimal_ordering=True)
    return leaves_list(tree)
