"""Geometry at large depth: how a body's changing shape bends the straight line."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, percent

# Up to this radius over the body's height, and depth over the radius, geometry does not harden.
# Beyond it does: a layer of three radii by 1 % at 0.4 a; and the force on a tip that is pressed in
# by many radii grows as the depth squared.
_THICK, _SHALLOW = 0.22, 1.5
_NEWTON_STEPS = 20  # the cubic's root from 4 a inwards, to rounding


class FiniteStrain(Effect):
    """d = u (1 - s x (1 + x)), x = u / a: the form that neo-Hookean finite elements have.

    Rigid flat tip, a tenth of the height, Poisson's ratio 0.49: the travel is 0.7, 1.4, 3.1 % more
    than the linear one at x = 0.1, 0.2, 0.4 if the tip sticks (s = -0.056 gives 0.6, 1.3, 3.1 %),
    0.8, 1.8, 4.3 % if it slides; half of it at a fifth of the height; at a third it is 1 % less. A
    ball follows Hertz's law. What grows stiffer in a thick body is the material: see
    `strain_stiffening`.
    """

    name = "finite_strain"
    title = "Large strain (geometry)"
    order = 20
    summary = (
        "The tip goes so deep that the body's changing shape matters, and force is no longer "
        "proportional to travel. Thick bodies soften by it; thin ones and deep presses may harden."
    )
    formula = (
        "d = u (1 - s x (1 + x)), x = u / a, u = C F;  s > 0: u = d (1 + s y (1 + y)), y = d/a"
    )
    latex = (
        r"\begin{array}{l} u = C F \\ d = u \left(1 - s\,x\,(1 + x)\right), \; x = u / a \quad "
        r"(s \le 0) \\ u = d \left(1 + s\,y\,(1 + y)\right), \; y = d / a \quad (s > 0) "
        r"\end{array}"
    )
    source = (
        "neo-Hookean finite elements, rigid flat tip (`fem.finite_strain`); balls: C.-E. Wu et al. "
        "Tribol. Int. 97 (2016) 71; deep: M. Shojaeifard, M. Bacca, Soft Matter (2025) D5SM00502G"
    )
    gives_away = "travel grows faster than the force, most so where the tip goes deepest"
    cure = "Press less deep, to a tenth of the tip's radius where noise allows; use a larger tip."
    parameters = (
        EffectParameter(
            "s", "1", "first term in d/a, hardening (+) or softening (-)", 0.0, -0.5, 2.0, 0.05
        ),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "a = 5 mm, s = -0.1, u = 2 mm: x = 0.4, d = 2 (1 + 0.1 x 0.4 x 1.4) = 2.112 mm.",
            {"s": -0.1},
            {"force_n": 0.3, "travel_m": 2e-3, "contact_radius_m": 5e-3},
            {"travel_m": 2.112e-3},
        ),
        WorkedExample(
            "a = 5 mm, s = 0.5: at d = 2.5 mm, u = 2.5 (1 + 0.5 x 0.5 x 1.5) = 3.4375 mm.",
            {"s": 0.5},
            {"force_n": 0.3, "travel_m": 3.4375e-3, "contact_radius_m": 5e-3},
            {"travel_m": 2.5e-3},
        ),
    )

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        s: float,
    ) -> np.ndarray:
        """Bend the travel by its depth over the contact radius; outwards, noise only, likewise."""
        a = pressing.radius_m
        x = travel_m / a
        if s <= 0:
            return travel_m * np.where(x > 0, 1 - s * x * (1 + x), 1 / (1 + s * np.minimum(x, 0)))
        inward = np.maximum(x, 0.0)
        y = inward
        for _ in range(_NEWTON_STEPS):  # f is convex, so that it falls to the root from above
            y = y - (y + s * y**2 * (1 + y) - inward) / (1 + s * y * (2 + 3 * y))
        return a * np.where(x > 0, y, x * (1 - s * x))

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Let a body harden only where it is thin beside the tip, or pressed deep."""
        height = state.box_m[1][2] - state.box_m[0][2]
        thin = readings.radius_m.max() > _THICK * height
        # An ordinary press: on a hard spot a large force is no great depth
        pressure = float(np.median(readings.peak_force_n / readings.radius_m**2))
        soft = state.background_pa or np.inf  # a rigid punch on a half-space of the background
        deep = (1 - state.poisson_ratio**2) * pressure > 2 * _SHALLOW * soft
        return self.parameters if thin or deep else (replace(self.parameters[0], upper=0.0),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much the compliance changes with depth."""
        tip = float(np.median(readings.radius_m))
        change = abs(values["s"]) * 0.2 * 1.2
        more = "less" if values["s"] > 0 else "more"
        known = "" if values["s"] > 0 else " (a thick neo-Hookean one by up to 2 %)"
        return (
            "Force and travel are not proportional: the body yields "
            f"{percent(change)} {more} at a depth of {length(0.2 * tip)} than at the first touch"
            f"{known}, and the misfit is largest at the softest places."
        )
