"""Another Poisson's ratio than the study states."""

from dataclasses import replace

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings

_LARGEST = 0.4999  # that the finite elements take


class PoissonRatio(Effect):
    """A change of the ratio of the whole body."""

    name = "poisson_ratio"
    title = "Poisson's ratio"
    summary = (
        "The body is more compressible, or less, than the study states. "
        "A bonded base holds back an incompressible body more, and free edges less."
    )
    formula = "nu -> nu + change"
    latex = r"\nu \to \nu + \text{change}"
    source = "W. C. Hayes et al., J. Biomech. 5 (1972) 541-551 (indented layers)"
    gives_away = "presses near the edges misfit otherwise than those in the middle"
    cure = "Measure it apart, or press with two tips of clearly different radius."
    parameters = (
        EffectParameter(
            "change", "1", "of Poisson's ratio", 0.0, -0.49, 0.49, 0.05, natural="upper"
        ),
    )
    examples = (
        WorkedExample(
            "0.49 less 0.04.",
            {"change": -0.04},
            {"poisson_ratio": 0.49},
            {"poisson_ratio": 0.45},
        ),
    )

    def body(self, state: BodyState, *, change: float) -> BodyState:
        """Change the ratio."""
        return state.changed(poisson_ratio=state.poisson_ratio + change)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Stay within the range of the finite elements."""
        nu = state.poisson_ratio
        return (replace(self.parameters[0], lower=-nu, upper=max(_LARGEST - nu, 0.0)),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say by how much the ratio differs."""
        less = "less" if values["change"] <= 0 else "more"
        return (
            "Presses near the edges and in the middle agree only if Poisson's ratio is "
            f"{abs(values['change']):.2g} {less} than the study states."
        )
