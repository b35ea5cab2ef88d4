"""A loop between loading and unloading by dry friction of parts that follow one after the other."""

import numpy as np

from identify.catalogue.play import play_offset
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent

_WIDTHS = (0.02, 0.06, 0.15, 0.4)
_LARGEST = 0.5  # of a share: shares of more than the whole travel would turn the tip about


class SeveralPlays(Effect):
    """Prandtl's and Ishlinskii's distribution of plays, at fixed widths."""

    name = "several_plays"
    family = "hysteresis"
    title = "Hysteresis by a distribution of plays (Prandtl, Ishlinskii)"
    order = 33
    summary = (
        "Parts of the body follow the tip after ways of different length. The loop opens at once "
        "when the tip turns, widens along the way, and ignores the speed."
    )
    formula = "d = u + sum of share_i (p_i - u),  p_i the play of width_i = 2, 6, 15, 40 %"
    latex = (
        r"d = u + \sum_i \text{share}_i \, (p_i - u), \quad p_i \text{ the play of width } "
        r"2, 6, 15, 40 \, \%"
    )
    source = (
        "M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, Springer 1996, ch. 2 "
        "(Prandtl-Ishlinskii operators)"
    )
    gives_away = "loading and unloading part at once at the turn, and further along the way"
    cure = "Take the loading branch only, or press each place to and fro until the loop repeats."
    parameters = tuple(
        EffectParameter(f"share_{100 * width:.0f}", "1",
                        f"part of the travel with a play of {100 * width:.0f} %", 0.0, 0.0,
                        _LARGEST, 0.05)
        for width in _WIDTHS
    )  # fmt: skip
    needs = ("unloading",)
    examples = (
        WorkedExample(
            "Up to 2 mm and back to 1 mm: plays of 0.04, 0.12, 0.3 and 0.8 mm lag by that on the "
            "way in, 1 mm included; on the way back they lead by 0.04, 0.12, 0.3 and 0.2 mm.",
            {"share_2": 0.1, "share_6": 0.1, "share_15": 0.2, "share_40": 0.1},
            {
                "phase": ("load", "load", "unload"),
                "force_n": (0.15, 0.3, 0.15),
                "travel_m": (1e-3, 2e-3, 1e-3),
            },
            {"travel_m": (0.844e-3, 1.844e-3, 1.096e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        share_2: float,
        share_6: float,
        share_15: float,
        share_40: float,
    ) -> np.ndarray:
        """Add the plays, each with its share."""
        shares = share_2, share_6, share_15, share_40
        return travel_m + sum(
            share * play_offset(readings, travel_m, width)
            for width, share in zip(_WIDTHS, shares, strict=True)
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how wide the loop is at half of the force."""
        half = sum(
            values[f"share_{100 * width:.0f}"] * (width + min(width, 0.5 - width))
            for width in _WIDTHS
        )
        return (
            f"Half way back a press is {percent(half)} of its largest travel deeper than half way "
            "in, and the two part at once where the tip turns."
        )
