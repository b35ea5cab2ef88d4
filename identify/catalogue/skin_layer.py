"""A thin top layer of another stiffness."""

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length

_THICKNESSES_M = (0.0005, 0.001, 0.002)


class SkinLayer(Advice, Effect):
    """A layer much thinner than the tip is wide; stiffness and thickness almost trade."""

    name = "skin_layer"
    title = "Skin layer"
    summary = (
        "A thin layer on top is stiffer, or softer, than the body below. "
        "Its stiffness and its thickness can hardly be separated: about their product counts."
    )
    formula = "E -> E (1 + stiffening) within thickness of the top surface"
    latex = r"E \to E \, (1 + \text{stiffening}) \quad \text{within thickness of the top surface}"
    source = "D. M. Burmister, J. Appl. Phys. 16 (1945) 89-94 (layered elastic half-space)"
    gives_away = "small tips find the body stiffer than wide ones do, everywhere by like amounts"
    cure = "Press with two tips of clearly different radius, 3 and 10 mm for example."
    parameters = (
        EffectParameter(
            "stiffening", "1", "modulus over that below, less one", 0.0, -0.9, 200.0, 1.0
        ),
        EffectParameter("thickness_m", "m", "of the layer", None, 1e-4, 5e-3, 1e-3, log=True),
    )
    examples = (
        WorkedExample(
            "A skin of 1 mm five times as stiff as the body below.",
            {"stiffening": 4.0, "thickness_m": 0.001},
            {},
            {"skin_factor": 5.0, "skin_thickness_m": 0.001},
        ),
    )

    def body(self, state: BodyState, *, stiffening: float, thickness_m: float) -> BodyState:
        """Cover the body."""
        return state.changed(skin_factor=1 + stiffening, skin_thickness_m=thickness_m)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Three thicknesses: finer would be no different."""
        return [{"thickness_m": thickness} for thickness in _THICKNESSES_M]

    def levels(self, state: BodyState) -> tuple[float, ...]:
        """Return that of a skin five times as stiff, which carries load along the surface."""
        return (4.0,)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how stiff the skin is for the thickness that was taken."""
        factor = 1 + values["stiffening"]
        return (
            f"The top behaves as if covered by a skin {factor:.2g} times as stiff as the body "
            f"below, if it is {length(values['thickness_m'])} thick; a thinner and "
            "stiffer one would look the same."
        )
