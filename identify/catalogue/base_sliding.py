"""A base that lets the body slide sideways."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length

_FREE = 100.0  # heights over modulus: the base holds nothing back
_OUT_OF_SIGHT_M = 0.3  # slid under the pressure of the tip: many times any body's own shear


class BaseSliding(Advice, Effect):
    """Springs below the whole base, along it."""

    name = "base_sliding"
    title = "Sliding base"
    summary = (
        "The body is not bonded to its support but can slide on it, against some resistance. "
        "A body of nearly constant volume then spreads under the tip instead of being held."
    )
    formula = "u_t = tangential t_t on the base instead of u_t = 0"
    latex = (
        r"\mathbf{u}_t = \text{tangential} \cdot \mathbf{t}_t \quad \text{on the base, in "
        r"place of } \mathbf{u}_t = 0"
    )
    source = (
        "E. Winkler, Die Lehre von der Elasticitaet und Festigkeit, 1867; joints of no thickness: "
        "R. E. Goodman et al., J. Soil Mech. Found. Div. ASCE 94 (1968) 637-659"
    )
    gives_away = "thin bodies and wide tips sink more than a bonded base allows"
    cure = "Glue the body down, or let it slide freely (oil) and state that in the study."
    parameters = (
        EffectParameter(
            "tangential_m_per_pa",
            "m/Pa",
            "travel per shear traction",
            0.0,
            0.0,
            1e-3,
            2e-7,
            natural="upper",
        ),
    )
    examples = (
        WorkedExample(
            "A film of gel 1 mm thick with a shear modulus of 10 kPa: 0.001 / 10000 = 1e-7 m/Pa.",
            {"tangential_m_per_pa": 1e-7},
            {},
            {"base_tangential_m_per_pa": 1e-7},
        ),
    )

    def body(self, state: BodyState, *, tangential_m_per_pa: float) -> BodyState:
        """Put the springs below the body, beside any that are there."""
        total = state.base_tangential_m_per_pa + tangential_m_per_pa
        return state.changed(base_tangential_m_per_pa=total)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the travel where the body slides as if there were no friction."""
        if state.background_pa is None:
            return self.parameters
        (only,) = self.parameters
        return (replace(only, upper=_FREE * state.height_m / state.background_pa),)

    def levels(self, state: BodyState) -> tuple[float, ...]:
        """Return those of some sliding and of nearly free sliding, from height over modulus."""
        if state.background_pa is None:
            return ()
        free = state.height_m / state.background_pa
        return (0.3 * free, 10 * free)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how easily the body slides."""
        softness = values["tangential_m_per_pa"]
        pressure = np.max(readings.force_n / (np.pi * readings.radius_m**2))
        if softness * pressure > _OUT_OF_SIGHT_M:
            return "Presses sink as if the body slid freely on its base, without friction."
        return (
            "Presses sink as if the body could slide on its base by "
            f"{length(1e3 * softness)} for each kPa of shear, as on a gel of 10 kPa shear modulus "
            f"that is {length(1e4 * softness)} thick."
        )
