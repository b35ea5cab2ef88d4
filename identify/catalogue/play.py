"""A loop between loading and unloading by dry friction inside the body."""

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent

_WIDTHS = tuple(float(w) for w in np.geomspace(0.02, 0.45, 12))


class Play(Effect):
    """Prandtl's play: a part of the travel follows only after some way."""

    name = "play"
    family = "hysteresis"
    title = "Hysteresis by play (Prandtl)"
    order = 31
    summary = (
        "A part of the body follows the tip only after some way, on the way in as on the way back. "
        "The loop opens at once when the tip turns, has parallel sides, and ignores the speed."
    )
    formula = (
        "d = (1 - share) u + share p,  p_i = max(u_i - r, min(u_i + r, p_(i-1))),  "
        "r = width times the largest u of the press"
    )
    latex = (
        r"d = (1 - \text{share}) u + \text{share} \cdot p, \quad p_i = \max(u_i - r, \min(u_i + r, "
        r"p_{i-1})), \quad r = \text{width} \cdot u_{\max}"
    )
    source = (
        "L. Prandtl, Z. angew. Math. Mech. 8 (1928) 85-106; M. Brokate, J. Sprekels, Hysteresis "
        "and Phase Transitions, Springer 1996, ch. 2 (play operator)"
    )
    gives_away = "loading and unloading part by a constant way, at all forces but the ends"
    cure = "Take the loading branch only, or press each place to and fro until the loop repeats."
    parameters = (
        EffectParameter("share", "1", "part of the travel with play", 0.0, 0.0, 1.0, 0.1),
        EffectParameter("width", "1", "play over the largest travel", None, 0.005, 0.9, 0.1,
                        log=True),
    )  # fmt: skip
    needs = ("unloading",)
    examples = (
        WorkedExample(
            "Up to 2 mm and back to 1 mm with r = 0.2 mm: p is 0.8, 1.8 and 1.2 mm; half of it "
            "and half of the travel.",
            {"share": 0.5, "width": 0.1},
            {
                "phase": ("load", "load", "unload"),
                "force_n": (0.15, 0.3, 0.15),
                "travel_m": (1e-3, 2e-3, 1e-3),
            },
            {"travel_m": (0.9e-3, 1.9e-3, 1.1e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        share: float,
        width: float,
    ) -> np.ndarray:
        """Mix the travel with its play."""
        return travel_m + share * play_offset(readings, travel_m, width)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Widths from one that hardly shows to nearly half of the travel."""
        return [{"width": width} for width in _WIDTHS]

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how wide the loop is."""
        return (
            "On the way back a press is deeper than on the way in by "
            f"{percent(2 * values['share'] * values['width'])} of its largest travel, alike at all "
            "forces but the ends."
        )


def play_offset(readings: Readings, travel_m: np.ndarray, width: float) -> np.ndarray:
    """Play of a travel less the travel, (m,); `width` is the share of each press's largest travel.

    In closed form for a press that goes in, holds and comes out. The recursion over the readings
    keeps the largest of their noise at each turn, and so fits worse than other laws though true.
    """
    largest = np.abs(readings.peak_of(travel_m))
    r = width * largest
    going_in = -np.clip(travel_m, 0.0, r)
    coming_out = np.minimum(largest - r - travel_m, r)
    held = np.where(readings.phase == "hold", -r, going_in)
    return np.where(readings.phase == "unload", coming_out, held)
