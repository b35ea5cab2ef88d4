"""A flat tip that keeps the surface under it flat and level."""

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class RigidTip(Advice, Effect):
    """The pressure under a flat tip is the body's own, not the even half-space's."""

    name = "rigid_tip"
    title = "Rigid tip held upright"
    summary = (
        "The arm holds the flat tip so stiffly that it cannot follow where the surface would tilt "
        "or bulge. Beside hard places and near edges it sinks less than under the assumed pressure."
    )
    formula = "C -> C - share sum_k A_k^2/A_kk, A_k the work of pressures without resultant"
    latex = (
        r"C \to C - \text{share} \sum_{k=1}^{3} \frac{A_k^2}{A_{kk}}, \quad A_k \text{ the "
        r"work of a pressure without resultant}"
    )
    source = "derivation: least complementary energy over three more pressures (`fem.palpation`)"
    gives_away = "wide tips misfit near edges and on the flanks of hard places, small ones do not"
    cure = "Press with a narrower tip, farther from edges, or through a joint that lets it tilt."
    parameters = (
        EffectParameter("share", "1", "1: rigid and upright, 0: free", 0.0, 0.0, 1.5, 1.0),
    )
    examples = (WorkedExample("Held upright.", {"share": 1.0}, {}, {"rigid_tip_share": 1.0}),)

    def body(self, state: BodyState, *, share: float) -> BodyState:
        """Hold the tip."""
        return state.changed(rigid_tip_share=state.rigid_tip_share + share)

    def redundant(self, profile: str, nonlinear: bool) -> str | None:
        """Only a flat tip can be held upright."""
        return None if profile == "flat" else "the study declares a ball, which has nothing to tilt"

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how rigidly the tip is held."""
        return (
            "Where the surface under the tip would tilt or bulge the body is stiffer, by "
            f"{percent(values['share'])} of what a rigid tip that stays upright makes of it."
        )
