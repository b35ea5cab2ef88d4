"""The found stiffness map beside the true one, cut through the inclusion, and how sure it is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from identify.fit import FitResult
from identify.map import FreeMap, Inclusion
from palpmap.figures.cuts import (
    BLIND,
    Cut,
    centre_m,
    cut_name,
    cut_size,
    cuts,
    sample,
    seen_part,
    seen_share,
)
from palpmap.figures.style import (
    DIFFERENCE_COLORS,
    MODULUS_COLORS,
    is_wide,
    new_figure,
    plain_log_ticks,
)
from palpmap.result.finding import Finding

_BESIDE = 1 / 12  # of the presses' extent across a vertical cut: drawn on it, or the nearest

Law = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Column:
    """One field over both cuts: title, points (p, 3) -> values (p,), label, colours, sign."""

    title: str
    law: Law
    label: str
    colors: str = MODULUS_COLORS
    signed: bool = False


def draw_map(f: Finding) -> Figure:
    """Draw true map, found map and their difference, from above and from the side.

    Without a truth: the found map and its standard deviation.
    """
    columns = [Column("Found", lambda p: f.map.modulus(p) / 1e3, "Young's modulus, kPa")]
    if f.truth is not None:
        truth = f.truth
        columns.insert(0, Column("True", lambda p: truth.modulus(p) / 1e3, columns[0].label))
        columns.append(
            Column(
                "Found − true",
                lambda p: (f.map.modulus(p) - truth.modulus(p)) / 1e3,
                "difference of Young's modulus, kPa",
                DIFFERENCE_COLORS,
                signed=True,
            )
        )
    elif f.fit.unknowns:
        columns.append(_uncertainty(f))
    return _draw_columns(f, columns)


def draw_uncertainty(f: Finding) -> Figure | None:
    """Draw the found map's standard deviation, where `draw_map` does not; None without one."""
    if f.truth is None or not f.fit.unknowns:
        return None
    return _draw_columns(f, [_uncertainty(f)])


def _uncertainty(f: Finding) -> Column:
    found, field = f.fit.map, f.fit.field
    if isinstance(found, FreeMap) and field is not None:

        def relative(points: np.ndarray) -> np.ndarray:
            return 100 * found.grid.interpolated(field.log_sd, points)

        return Column("How sure", relative, "one standard deviation, %", "magma_r")
    # The effects' own parameters are held. An inclusion that may be nowhere may be anywhere, and
    # no place of it has a standard deviation
    names = f.fit.map.names
    known = {name for name in names if name.partition(".")[0] not in f.doubtful}
    own = [i for i, name in enumerate(f.fit.covariance_names) if name in known]
    free = [names.index(f.fit.covariance_names[i]) for i in own]
    covariance = f.fit.covariance[np.ix_(own, own)]
    sure = tuple(i for i in _parted(f)[0] if i in found.inclusions)
    seen = replace(f.map, stiffness=replace(found, inclusions=sure))

    def deviation(points: np.ndarray) -> np.ndarray:
        gradient = f.map.gradient(points)[:, free]
        variance = np.einsum("pk,kl,pl->p", gradient, covariance, gradient)
        return 100 * np.sqrt(np.maximum(variance, 0)) / np.abs(seen.modulus(points))

    title = "How sure, the dotted one left out" if f.doubtful else "How sure"
    return Column(title, deviation, "one standard deviation, %", "magma_r")


def _parted(f: Finding) -> tuple[tuple[Inclusion, ...], tuple[Inclusion, ...]]:
    """Return the found map's inclusions, and of them those that may not be there."""
    sure, doubtful = [], []
    for number, inclusion in enumerate(f.map.inclusions, 1):
        (doubtful if f"inclusion_{number}" in f.doubtful else sure).append(inclusion)
    return tuple(sure), tuple(doubtful)


def _draw_columns(f: Finding, columns: list[Column]) -> Figure:
    both = cuts(f)
    width, height = cut_size(f, both[1])
    ratio = max(height / width, 0.3)
    across = cut_size(f, both[0])
    upper = across[1] / across[0]
    figure = new_figure(3.9 * len(columns) + 0.6, 3.7 * (upper + ratio) + 1.6)
    grid = figure.subplots(2, len(columns), squeeze=False, height_ratios=[upper, ratio])
    fields = [[sample(f, cut, column.law) for column in columns] for cut in both]
    for i, column in enumerate(columns):
        alike = [j for j, other in enumerate(columns) if other.label == column.label]
        own = [
            seen_part(f, f.fit, cut, fields[row][j]) for row, cut in enumerate(both) for j in alike
        ]
        span = colour_span(own, column.signed)
        image = None
        for row, cut in enumerate(both):
            axes = grid[row, i]
            image = show_cut(axes, f, cut, fields[row][i], column.colors, span)
            _decorate(axes, f, cut, column.title == "True")
            if column.title != "True":
                hatch_blind(axes, f, f.fit, cut)
            axes.set_title(f"{column.title}, {cut_name(f, cut)}" if i == 0 else column.title)
            if i:
                axes.set_ylabel("")
        if image is not None:
            color_bar(
                image, ax=list(grid[:, i]), location="bottom", shrink=0.85, pad=0.02,
                label=column.label, extend=extension([fields[0][i], fields[1][i]], span),
            )  # fmt: skip
    return figure


def extension(fields: list[np.ndarray], span: tuple[float, float]) -> str:
    """Return the ends of a colour scale beyond which some values lie, as Matplotlib names them."""
    below = any(np.nanmin(v, initial=np.inf) < span[0] for v in fields)
    above = any(np.nanmax(v, initial=-np.inf) > span[1] for v in fields)
    return "both" if below and above else "min" if below else "max" if above else "neither"


def colour_span(fields: Sequence[np.ndarray], signed: bool = False) -> tuple[float, float]:
    """Return the ends of the colour scale of some fields; signed: alike on both sides of zero."""
    inside = np.concatenate([v[np.isfinite(v)] for v in fields])  # a cut may miss the body
    low, high = (inside.min(), inside.max()) if inside.size else (0.0, 1.0)
    if signed:
        reach = max(-low, high, 1e-6)
        return -reach, reach
    return widened(low, high)


def color_bar(image: AxesImage, **options: Any) -> None:
    """Draw the colour bar of an image, with plain numbers on a logarithmic one."""
    figure = image.axes.figure
    assert figure is not None
    bar = figure.colorbar(image, **options)
    if isinstance(image.norm, LogNorm):
        plain_log_ticks(bar.long_axis)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return the ends of a colour scale; an even field gets 5 % to both sides."""
    if high - low > 1e-3 * max(abs(low), abs(high)):
        return low, high
    margin = 0.05 * abs(low) or 1e-6
    return low - margin, high + margin


def show_cut(
    axes: Axes, f: Finding, cut: Cut, values: np.ndarray, colors: str, span: tuple[float, float]
) -> AxesImage:
    """Paint the values on a cut, with the scan's coordinates in mm.

    Moduli that differ by more than tenfold are on a logarithmic scale: beside a hard lump all else
    would be of one colour.
    """
    right, up = cut.axes
    wide = colors == MODULUS_COLORS and is_wide(span)
    norm = LogNorm(*span) if wide else Normalize(*span)
    low = 1e3 * (f.outline.lower_m + f.origin_m)
    high = 1e3 * (f.outline.upper_m + f.origin_m)
    axes.set_xlabel(f"{'xyz'[right]}, mm")
    axes.set_ylabel(f"{'xyz'[up]}, mm")
    return axes.imshow(
        values, origin="lower", cmap=colors, norm=norm,
        extent=(low[right], high[right], low[up], high[up]), interpolation="bilinear",
    )  # fmt: skip


def hatch_blind(axes: Axes, f: Finding, fit: FitResult, cut: Cut) -> None:
    """Fade and hatch the places that the scan does not see."""
    share = seen_share(f, fit, cut)
    if share is None:
        return
    low, high = 1e3 * (f.outline.lower_m + f.origin_m), 1e3 * (f.outline.upper_m + f.origin_m)
    (right, up), (rows, columns) = cut.axes, share.shape
    x = low[right] + (np.arange(columns) + 0.5) / columns * (high[right] - low[right])
    y = low[up] + (np.arange(rows) + 0.5) / rows * (high[up] - low[up])
    if np.nanmin(share, initial=np.inf) < BLIND:
        axes.contourf(x, y, share, levels=[-1.0, BLIND], colors=[(1, 1, 1, 0.55)], hatches=["////"])


def _decorate(axes: Axes, f: Finding, cut: Cut, is_truth: bool) -> None:
    """Draw contact points and each inclusion's one-radius circle.

    It is dashed where it is the truth, dotted where the inclusion may not be there.
    """
    right, up = cut.axes
    points = 1e3 * (f.scan.contact_points + f.origin_m)
    top = cut.normal == 2
    if top:
        axes.plot(points[:, right], points[:, up], ".", color="white", ms=3, alpha=0.55)
    else:
        across = np.abs(points[:, cut.normal] - 1e3 * (cut.at_m + f.origin_m[cut.normal]))
        beside = points[across <= max(_BESIDE * np.ptp(points[:, cut.normal]), across.min())]
        axes.plot(beside[:, right], beside[:, up], "v", color="#222222", ms=3.5, clip_on=False)
    if f.truth is not None:
        draw_circles(axes, f, f.truth.inclusions, cut, "--")
    if not is_truth:
        for inclusions, line in zip(_parted(f), ("-", ":"), strict=True):
            draw_circles(axes, f, inclusions, cut, line)
    limit_to_body(axes, f, cut)


def limit_to_body(axes: Axes, f: Finding, cut: Cut) -> None:
    """Limit the axes of a cut to the body."""
    right, up = cut.axes
    low, high = 1e3 * (f.outline.lower_m + f.origin_m), 1e3 * (f.outline.upper_m + f.origin_m)
    axes.set_xlim(low[right], high[right])
    axes.set_ylim(low[up], high[up])


def draw_circles(
    axes: Axes, f: Finding, inclusions: Sequence[Inclusion], cut: Cut, line: str
) -> None:
    """Draw each inclusion one radius around its centre."""
    right, up = cut.axes
    angle = np.linspace(0, 2 * np.pi, 73)
    for inclusion in inclusions:
        centre = 1e3 * (centre_m(inclusion) + f.origin_m)
        radius = 1e3 * inclusion.radius_m
        x, y = centre[right] + radius * np.cos(angle), centre[up] + radius * np.sin(angle)
        axes.plot(x, y, line, color="black", lw=2.2)
        axes.plot(x, y, line, color="white", lw=1.1)
