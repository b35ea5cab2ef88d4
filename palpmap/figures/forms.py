"""The forms of the effects found, each with its 95 % band."""

from matplotlib.figure import Figure

from palpmap.figures.style import BLUE, GREY, new_figure, panel_grid
from palpmap.result.records import FormCurveRecord
from palpmap.units import scale


def draw_forms(curves: tuple[FormCurveRecord, ...]) -> Figure:
    """Draw what each effect adds along the session or within a press."""
    figure = new_figure(10.4, 3.7)
    for axes, curve in zip(
        figure.subplots(1, len(curves), squeeze=False).flat, curves, strict=True
    ):
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
    return figure
