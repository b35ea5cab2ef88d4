"""What a hidden effect is: where it acts on the bench, and how large it may be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from sim.body.true_body import HiddenBody
from sim.planted.bench import Bench

Category = Literal["structured", "compliance", "outsider"]
"""How hard an effect is to name: `structured` ones leave a pattern in time, force or place of their
own, those of `compliance` look like another body, and outsiders are in no catalogue."""

Values = Mapping[str, float]


class HiddenEffect:
    """Base of all hidden effects: override the hook of the place where it acts.

    Class attributes
    ----------------
    name : as the identifier's catalogue calls it; of an outsider, a name of its own
    category : see `Category`
    law : one line, what is done
    amplitude : name of the value that is searched for the wanted size; the effect is absent at 0
    typical : an ordinary amplitude, where the search begins
    limit : largest amplitude that still makes sense
    two_sided : whether the amplitude may be negative too
    kin : of an outsider, the effects of the catalogue that come as near as it can
    """

    name: ClassVar[str]
    category: ClassVar[Category]
    law: ClassVar[str]
    amplitude: ClassVar[str]
    typical: ClassVar[float]
    limit: ClassVar[float] = np.inf
    two_sided: ClassVar[bool] = False
    kin: ClassVar[tuple[str, ...]] = ()

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw all values but the amplitude."""
        del bench, rng
        return {}

    def body(self, body: HiddenBody, values: Values) -> HiddenBody:
        """Return the changed body."""
        del values
        return body

    def contact(self, bench: Bench, travel_m: np.ndarray, values: Values) -> np.ndarray:
        """Elastic travel (j, t) m from that of the flat tip on the linear body."""
        del bench, values
        return travel_m

    def response(self, bench: Bench, travel_m: np.ndarray, values: Values) -> np.ndarray:
        """Travel (j, t) m with what the history of the elastic travel adds."""
        del bench, values
        return travel_m

    def sensor(
        self, bench: Bench, force_n: np.ndarray, travel_m: np.ndarray, values: Values
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and travel as they are reported, both (j, t)."""
        del bench, values
        return force_n, travel_m
