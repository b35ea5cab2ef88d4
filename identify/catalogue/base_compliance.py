"""A base that gives way under pressure."""

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length


class BaseCompliance(Advice, Effect):
    """Springs below the whole base, normal to it."""

    name = "base_compliance"
    title = "Yielding base"
    summary = (
        "The body lies on foam, gel or a soft table that gives way under it. "
        "Every press sinks by a little more, least where the load spreads widest."
    )
    formula = "u_n = normal t_n on the base instead of u_n = 0"
    latex = r"u_n = \text{normal} \cdot t_n \quad \text{on the base, in place of } u_n = 0"
    source = (
        "E. Winkler, Die Lehre von der Elasticitaet und Festigkeit, 1867; joints of no thickness: "
        "R. E. Goodman et al., J. Soil Mech. Found. Div. ASCE 94 (1968) 637-659"
    )
    gives_away = (
        "hard places sink more than the map allows, and so do presses near the body's edges"
    )
    cure = "Put the body on a hard plate, or press with two tips of different radius."
    parameters = (
        EffectParameter(
            "normal_m_per_pa",
            "m/Pa",
            "travel per pressure",
            0.0,
            0.0,
            1e-3,
            2e-7,
        ),
    )
    examples = (
        WorkedExample(
            "Foam 2 mm thick of 20 kPa: 0.002 / 20000 = 1e-7 m/Pa.",
            {"normal_m_per_pa": 1e-7},
            {},
            {"base_normal_m_per_pa": 1e-7},
        ),
    )

    def body(self, state: BodyState, *, normal_m_per_pa: float) -> BodyState:
        """Put the springs below the body, beside any that are there."""
        total = state.base_normal_m_per_pa + normal_m_per_pa
        return state.changed(base_normal_m_per_pa=total)

    def levels(self, state: BodyState) -> tuple[float, ...]:
        """Return that of a base as soft as the body held sideways, and one ten times softer."""
        if state.background_pa is None:
            return ()
        nu = min(state.poisson_ratio, 0.495)
        held_pa = state.background_pa * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
        return (state.height_m / held_pa, 10 * state.height_m / held_pa)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how soft the base is."""
        softness = values["normal_m_per_pa"]
        return (
            "Presses sink as if the base gave way by "
            f"{length(1e3 * softness)} for each kPa of pressure, as would foam of 20 kPa that "
            f"is {length(2e4 * softness)} thick."
        )
