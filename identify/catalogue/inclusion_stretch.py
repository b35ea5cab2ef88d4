"""Inclusions that are longer than wide."""

from dataclasses import replace
from math import atan2, degrees, exp, hypot

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings


class InclusionStretch(Effect):
    """All inclusions of the map stretched in one horizontal direction, their area kept."""

    name = "inclusion_stretch"
    title = "Long inclusions"
    summary = (
        "The hard or soft spots are longer in one horizontal direction than across it. "
        "With several inclusions, all are taken to be stretched alike."
    )
    formula = "|o|^2 -> o' exp(-[[a, b], [b, -a]]) o in the x-y plane, o from the centre"
    latex = (
        r"\begin{array}{l} |\mathbf{o}|^2 \to \mathbf{o}^{\mathsf T} \exp\left(-\begin{pmatrix} "
        r"a & b \\ b & -a \end{pmatrix}\right) \mathbf{o} \\ \mathbf{o} = (x - x_c, \, y - y_c) "
        r"\\ a = \text{along}_x, \; b = \text{along}_{\text{diagonal}} \end{array}"
    )
    source = "derivation: an ellipse of the same area, exp(|(a, b)|) times as long as wide"
    gives_away = "presses at two opposite ends of an inclusion misfit otherwise than at its sides"
    cure = "None is needed: the shape belongs to the body. Keep the effect in the study."
    parameters = (
        EffectParameter("along_x", "1", "a: ln(length/width) along x", 0.0, -2.0, 2.0, 0.3),
        EffectParameter("along_diagonal", "1", "b: the same along x = y", 0.0, -2.0, 2.0, 0.3),
    )
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "ln 2 along x, radius 10 mm: 78 % of the weight 10 mm away in x, 37 % in y.",
            {"along_x": 0.693147, "along_diagonal": 0.0},
            {"point_m": ((0.010, 0.0, 0.0), (0.0, 0.010, 0.0))},
            {"inclusion": (0.7788, 0.3679)},
        ),
    )

    def body(self, state: BodyState, *, along_x: float, along_diagonal: float) -> BodyState:
        """Stretch the inclusions."""
        shape = state.inclusion_shape
        a, b = shape.stretch
        stretch = (a + along_x, b + along_diagonal)
        return state.changed(inclusion_shape=replace(shape, stretch=stretch))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how long they are, and in which direction."""
        a, b = values["along_x"], values["along_diagonal"]
        return (
            f"The map's inclusions are {exp(hypot(a, b)):.2f} times as long as wide, in a "
            f"direction {degrees(atan2(b, a) / 2) % 180:.0f} degrees from x."
        )
