"""The forms of the effects found, each with its 95 % band."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpmap.figures.style import (
    BLUE,
    DIFFERENCE_COLORS,
    GREY,
    LARGEST_DOT,
    new_figure,
    panel_grid,
    widest_axes,
)
from palpmap.result.records import FormCurveRecord
from palpmap.units import scale

_WIDEST = 15.6  # of all panels, in


def draw_forms(curves: tuple[FormCurveRecord, ...], origin_m: np.ndarray) -> Figure:
    """Draw what each effect adds along the session, within a press or over the surface.

    Over the surface in two panels: the estimate, and half the width of its band; places in the
    scan's frame, by its origin (3,) m.
    """
    count = sum(2 if curve.places_m else 1 for curve in curves)
    figure = new_figure(max(10.4, min(5.2 * count, _WIDEST)), 3.7)
    panels = iter(figure.subplots(1, count, squeeze=False).flat)
    for curve in curves:
        if curve.places_m:
            _draw_over_surface(figure, (next(panels), next(panels)), curve, origin_m)
        else:
            _draw_along(next(panels), curve)
    return figure


def _draw_along(axes: Axes, curve: FormCurveRecord) -> None:
    panel_grid(axes)
    factor, unit = (100.0, "%") if curve.unit == "1" else scale(curve.unit)
    low, mid, high = ([factor * y for y in ys] for ys in (curve.lower95, curve.value,
                                                         curve.upper95))  # fmt: skip
    axes.axhline(0, color=GREY, lw=0.8)
    axes.fill_between(curve.at, low, high, color=BLUE, alpha=0.2, lw=0)
    axes.plot(curve.at, mid, color=BLUE, lw=1.8)
    axes.set_xlabel(f"{curve.along}, {curve.at_unit}" if curve.at_unit else curve.along)
    what = curve.of.replace(", ", ",\n", 1)
    axes.set_ylabel(f"{what}, {unit}")
    axes.set_title(curve.effect)


def _draw_over_surface(
    figure: Figure, panels: tuple[Axes, Axes], curve: FormCurveRecord, origin_m: np.ndarray
) -> None:
    places = 1e3 * (np.array(curve.places_m) + origin_m)
    right, up = widest_axes(places)
    factor, unit = (1e6, "µm") if curve.unit == "m" else scale(curve.unit)
    value, low, high = (factor * np.array(y) for y in (curve.value, curve.lower95, curve.upper95))
    reach = max(float(np.abs(value).max()), 1e-12)
    half = (high - low) / 2
    size = min((165 / np.sqrt(len(places))) ** 2 * 0.55, LARGEST_DOT)
    for axes, shown, colors, limits, label in (
        (panels[0], value, DIFFERENCE_COLORS, (-reach, reach), f"{curve.of}, {unit}"),
        (panels[1], half, "Greys", (0.0, max(float(half.max()), 1e-12)), f"95 % band: ±, {unit}"),
    ):
        image = axes.scatter(places[:, right], places[:, up], c=shown, s=size, cmap=colors,
                             vmin=limits[0], vmax=limits[1], edgecolors=GREY,
                             linewidths=0.4)  # fmt: skip
        axes.set_aspect("equal")
        axes.margins(0.12)
        axes.set_xlabel(f"{'xyz'[right]}, mm")
        axes.set_ylabel(f"{'xyz'[up]}, mm")
        axes.set_title(curve.effect)
        figure.colorbar(image, ax=axes, label=label, shrink=0.85)
