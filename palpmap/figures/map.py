"""The found stiffness map beside the true one, cut through the inclusion, and how sure it is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from identify.fit import SPOTS, FitResult
from identify.map import FreeMap, Inclusion
from palpmap.figures.style import (
    DIFFERENCE_COLORS,
    MODULUS_COLORS,
    new_figure,
    plain_log_ticks,
)
from palpmap.result.finding import Finding

CELLS = 160
_WIDE = 10.0  # ratio of moduli from which on their colours are logarithmic
BLIND = SPOTS.seen  # share of the prior's variance taken away, below which a place is blind


@dataclass(frozen=True)
class Cut:
    """A plane through the body at `at_m` along the axis `normal` (0 x, 1 y, 2 z), body frame."""

    normal: int
    at_m: float

    @property
    def axes(self) -> tuple[int, int]:
        """The axes drawn to the right and upwards."""
        right, up = (a for a in range(3) if a != self.normal)
        return right, up


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
        span = _span(own, column.signed)
        image = None
        for row, cut in enumerate(both):
            axes = grid[row, i]
            image = show_cut(axes, f, cut, fields[row][i], column.colors, span)
            _decorate(axes, f, cut, column.title == "True")
            if column.title != "True":
                hatch_blind(axes, f, f.fit, cut)
            axes.set_title(f"{column.title}, {_where(f, cut)}" if i == 0 else column.title)
            if i:
                axes.set_ylabel("")
        if image is not None:
            color_bar(
                image, ax=list(grid[:, i]), location="bottom", shrink=0.85, pad=0.02,
                label=column.label, extend=extension([fields[0][i], fields[1][i]], span),
            )  # fmt: skip
    return figure


def seen_part(f: Finding, fit: FitResult, cut: Cut, values: np.ndarray) -> np.ndarray:
    """Values of a cut where the scan sees; NaN elsewhere, where a map is a guess and hatched."""
    share = _share(f, fit, cut)
    if share is None:
        return values
    part = np.where(share >= BLIND, values, np.nan)
    return part if np.isfinite(part).any() else values


def _share(f: Finding, fit: FitResult, cut: Cut) -> np.ndarray | None:
    """Share of a free map's prior variance taken away on a cut; of others 1 in the probed part."""
    field, found = fit.field, fit.map
    if field is not None and isinstance(found, FreeMap):
        return sample(f, cut, lambda p: found.grid.interpolated(field.share, p))
    if (probed := f.probed_m) is None:
        return None
    return sample(f, cut, lambda p: ((probed[0] <= p) & (p <= probed[1])).all(axis=1).astype(float))


def extension(fields: list[np.ndarray], span: tuple[float, float]) -> str:
    """Return the ends of a colour scale beyond which some values lie, as Matplotlib names them."""
    below = any(np.nanmin(v, initial=np.inf) < span[0] for v in fields)
    above = any(np.nanmax(v, initial=-np.inf) > span[1] for v in fields)
    return "both" if below and above else "min" if below else "max" if above else "neither"


def _span(fields: list[np.ndarray], signed: bool) -> tuple[float, float]:
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


def cuts(f: Finding) -> tuple[Cut, Cut]:
    """Return a horizontal and a vertical cut through the found map's strongest inclusion.

    The vertical one lies across x or y, whichever comes nearer to the other inclusions.
    """
    middle = (f.outline.lower_m + f.outline.upper_m) / 2
    if isinstance(f.fit.map, FreeMap):
        place = _free_place(f, f.fit.map)
        return Cut(2, float(place[2])), Cut(1, float(place[1]))
    inclusions = f.map.inclusions
    if not inclusions:
        return Cut(2, float(middle[2])), Cut(1, float(middle[1]))
    strongest = max(inclusions, key=lambda i: abs(i.weight_pa))
    distance = {
        axis: sum((_centre(i)[axis] - _centre(strongest)[axis]) ** 2 for i in inclusions)
        for axis in (1, 0)
    }
    axis = min(distance, key=lambda a: distance[a])
    at = np.clip(_centre(strongest), f.outline.lower_m, f.outline.upper_m)
    return Cut(2, float(at[2])), Cut(axis, float(at[axis]))


def sample(f: Finding, cut: Cut, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values (rows, columns) of a field on a cut, NaN outside the body."""
    lower, upper = f.outline.lower_m, f.outline.upper_m
    right, up = cut.axes
    cell = max(upper - lower) / CELLS
    counts = [max(round((upper[a] - lower[a]) / cell), 2) for a in (right, up)]
    u, v = (
        lower[a] + (np.arange(n) + 0.5) / n * (upper[a] - lower[a])
        for a, n in zip((right, up), counts, strict=True)
    )
    points = np.empty((counts[1] * counts[0], 3))
    points[:, right], points[:, up] = (g.ravel() for g in np.meshgrid(u, v))
    points[:, cut.normal] = cut.at_m
    values = np.where(f.outline.inside(points), law(points), np.nan)
    return values.reshape(counts[1], counts[0])


def _centre(inclusion: Inclusion) -> np.ndarray:
    return np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])


def cut_size(f: Finding, cut: Cut) -> tuple[float, float]:
    """Width and height of a cut through the body's box, m."""
    extent = f.outline.upper_m - f.outline.lower_m
    return float(extent[cut.axes[0]]), float(extent[cut.axes[1]])


def _where(f: Finding, cut: Cut) -> str:
    at = 1e3 * (cut.at_m + f.origin_m[cut.normal])
    if cut.normal == 2:
        depth = 1e3 * (f.outline.upper_m[2] - cut.at_m)
        return f"from above, cut {depth:.0f} mm deep"
    return f"from the side, cut at {'xyz'[cut.normal]} = {at:.0f} mm"


def show_cut(
    axes: Axes, f: Finding, cut: Cut, values: np.ndarray, colors: str, span: tuple[float, float]
) -> AxesImage:
    """Paint the values on a cut, with the scan's coordinates in mm.

    Moduli that differ by more than tenfold are on a logarithmic scale: beside a hard lump all else
    would be of one colour.
    """
    right, up = cut.axes
    wide = colors == MODULUS_COLORS and span[1] > _WIDE * span[0] > 0
    norm = LogNorm(*span) if wide else Normalize(*span)
    low = 1e3 * (f.outline.lower_m + f.origin_m)
    high = 1e3 * (f.outline.upper_m + f.origin_m)
    axes.set_xlabel(f"{'xyz'[right]}, mm")
    axes.set_ylabel(f"{'xyz'[up]}, mm")
    return axes.imshow(
        values, origin="lower", cmap=colors, norm=norm,
        extent=(low[right], high[right], low[up], high[up]), interpolation="bilinear",
    )  # fmt: skip


def _free_place(f: Finding, found: FreeMap) -> np.ndarray:
    """Place of a free map's first spot, or of its largest difference from its layer in sight."""
    field = f.fit.field
    assert field is not None
    for spot in field.spots:
        if not spot.wide:
            return np.array([spot.x_m, spot.y_m, spot.z_m])
    layers = found.log_pa.reshape(found.grid.counts)
    differs = np.abs(layers - np.median(layers, axis=(0, 1))).ravel() * field.share
    return found.grid.points_m[int(np.argmax(differs))]


def hatch_blind(axes: Axes, f: Finding, fit: FitResult, cut: Cut) -> None:
    """Fade and hatch the places that the scan does not see."""
    share = _share(f, fit, cut)
    if share is None:
        return
    low, high = 1e3 * (f.outline.lower_m + f.origin_m), 1e3 * (f.outline.upper_m + f.origin_m)
    (right, up), (rows, columns) = cut.axes, share.shape
    x = low[right] + (np.arange(columns) + 0.5) / columns * (high[right] - low[right])
    y = low[up] + (np.arange(rows) + 0.5) / rows * (high[up] - low[up])
    if np.nanmin(share) < BLIND:
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
        axes.plot(points[:, right], points[:, up], "v", color="#222222", ms=3.5, clip_on=False)
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
        centre = 1e3 * (_centre(inclusion) + f.origin_m)
        radius = 1e3 * inclusion.radius_m
        x, y = centre[right] + radius * np.cos(angle), centre[up] + radius * np.sin(angle)
        axes.plot(x, y, line, color="black", lw=2.2)
        axes.plot(x, y, line, color="white", lw=1.1)
