"""Softening of the body where it was pressed before."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, percent


class PreconditioningNearby(Effect):
    """Travel grows with the number of earlier presses nearby, towards a limit."""

    name = "preconditioning_nearby"
    family = "preconditioning"
    title = "Preconditioning of each place"
    order = 21
    summary = (
        "Fresh tissue yields a little more with each press at the same place or near it, until it "
        "has settled. A place far from all earlier presses is still as stiff as at first."
    )
    formula = (
        "d = u (1 + p (1 - exp(-n / n0))),  n = sum over earlier presses of "
        "exp(-distance^2 / (2 reach^2))"
    )
    latex = (
        r"d = u \left(1 + p \left(1 - e^{-n/n_0}\right)\right), \quad n = \sum_{\text{earlier}} "
        r"e^{-\text{distance}^2 / (2 \, \text{reach}^2)}"
    )
    source = (
        "Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues, Springer 1993, ch. 7 "
        "(preconditioning); the exponential is the simplest law that settles"
    )
    gives_away = "a press is softer, the more presses were made near it before"
    cure = "Press each place a dozen times before its reading counts, or visit fresh places only."
    parameters = (
        EffectParameter("p", "1", "softening in the end, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("n0", "presses", "presses nearby to settle", None, 0.1, 1e4, 2.0, log=True),
        EffectParameter("reach_m", "m", "distance over which a press softens the body", None, 1e-4,
                        10.0, 0.01, log=True),
    )  # fmt: skip
    needs = ("several presses",)
    contains = ("preconditioning",)
    examples = (
        WorkedExample(
            "Three presses, the last 10 mm from both others, with a reach of 10 mm: n is 0, 1 and "
            "2 exp(-1/2) = 1.2131. With n0 = 1, 0, 63.2 and 70.3 % of the 20 % have happened.",
            {"p": 0.2, "n0": 1.0, "reach_m": 0.01},
            {
                "press": (0.0, 1.0, 2.0),
                "point_m": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.01, 0.0, 0.0)),
                "travel_m": 1e-3,
            },
            {"travel_m": (1e-3, 1.126424e-3, 1.140545e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        p: float,
        n0: float,
        reach_m: float,
    ) -> np.ndarray:
        """Scale each press's travel by the presses made near it before."""
        settled = -np.expm1(-_before_nearby(readings, reach_m) / n0)
        return travel_m * (1 + p * settled[readings.press])

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Reaches from the nearest neighbour's distance to the whole scan."""
        return [
            {"n0": float(n0), "reach_m": float(reach)}
            for reach in np.geomspace(*_reaches(readings), 6)
            for n0 in np.geomspace(0.5, max(readings.presses_made, 2), 7)
        ]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the reach by the distances between the presses."""
        p, n0, reach = self.parameters
        near, far = _reaches(readings)
        most = 2.0 * max(readings.presses_made, 2)
        return (
            p,
            replace(n0, upper=most, typical=min(n0.typical, most / 4)),
            replace(reach, lower=near / 2, upper=4 * far, typical=float(np.sqrt(near * far))),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much softer the most pressed place is, and how far a press reaches."""
        most = float(_before_nearby(readings, values["reach_m"]).max())
        softer = values["p"] * -np.expm1(-most / values["n0"])
        return (
            f"A press is softer the more were made near it before, within about "
            f"{length(values['reach_m'])}: by up to {percent(softer)}."
        )


def _before_nearby(readings: Readings, reach_m: float) -> np.ndarray:
    """Earlier presses of each press, weighted by their distance, (j,)."""
    apart = readings.between_m
    earlier = readings.order[:, None] > readings.order[None, :]
    return np.sum(np.exp(-((apart / reach_m) ** 2) / 2), axis=1, where=earlier)


def _reaches(readings: Readings) -> tuple[float, float]:
    """Half the nearest and the farthest distance of two presses at different places, m."""
    apart = readings.between_m
    apart = apart[apart > 1e-6]
    if apart.size == 0:
        return 1e-3, 1e-2
    return float(apart.min()) / 2, float(apart.max())
