"""Presses chosen among those of a solved body: some of them, in another order, or again.

A planned scan mostly presses the same places with the same tips; its body is then known.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fem import Contacts
from identify.body.discretization_error import TipPressure
from identify.body.mechanics import BodyMechanics
from identify.body.response import BodyResponse
from identify.body.state import BodyState
from identify.map.gaussian_map import GaussianMap


@dataclass(frozen=True)
class ChosenMechanics(BodyMechanics):
    """The mechanics of n presses among the j of another one, which solves for all of them.

    Attributes
    ----------
    known : response of the whole body at the estimate
    chosen : (n,) int, places of the presses among the j
    """

    known: BodyResponse = field(kw_only=True)
    chosen: np.ndarray = field(kw_only=True)

    @classmethod
    def among(cls, known: BodyResponse, chosen: np.ndarray) -> ChosenMechanics:
        """Choose presses of a solved body."""
        if isinstance(known, ChosenResponse):
            known, chosen = known.whole, known.chosen[chosen]
        whole = known.mechanics
        tip = whole.correction.tip
        growth = None if tip.growth is None else tip.growth[chosen]
        correction = replace(
            whole.correction,
            ratio=_some(whole.correction.ratio, chosen),
            model_error=_some(whole.correction.model_error, chosen),
            tip=TipPressure(_some(tip.gain, chosen), growth),
            trend=None,
            support=None,
        )
        return cls(
            whole.coarse, None, whole.at_poisson_ratio, correction,
            settings=whole.settings, known=known, chosen=chosen,
        )  # fmt: skip

    @property
    def contacts(self) -> Contacts:
        """The chosen contacts."""
        return self.coarse.contacts.some(self.chosen)

    @property
    def local_points(self) -> np.ndarray:
        """Points of the local modulus under each tip, (n, 3) m."""
        return self.known.mechanics.local_points[self.chosen]

    def evaluate(
        self, stiffness: GaussianMap, state: BodyState, slack: float = 0.0
    ) -> BodyResponse:
        """Solve for a map and a state, see `BodyMechanics.evaluate`."""
        whole = self.known
        if not whole.serves(stiffness, state, slack):
            whole = whole.mechanics.evaluate(stiffness, state, slack)
        return ChosenResponse(
            **{name: _some(getattr(whole, name), self.chosen) for name in _OF_PRESSES},
            **{name: getattr(whole, name) for name in _WHOLE},
            whole=whole,
            chosen=self.chosen,
        )

    def corrected(
        self, stiffness: GaussianMap, state: BodyState, slack: float = 0.0
    ) -> BodyMechanics:
        """Return these mechanics: the whole body is corrected as it is."""
        return self


_OF_PRESSES = ("compliance", "local_modulus", "local_by_map", "_scale")
_WHOLE = ("_mechanics", "_map", "_state", "_response", "_slack")


@dataclass(frozen=True)
class ChosenResponse(BodyResponse):
    """The response of chosen presses (n,) of a whole body's (j,)."""

    whole: BodyResponse = field(kw_only=True)
    chosen: np.ndarray = field(kw_only=True)

    @property
    def by_map(self) -> np.ndarray:
        """Derivative of the compliance by the map's parameters, (n, k)."""
        return self.whole.by_map[self.chosen]

    @property
    def growth(self) -> np.ndarray | None:
        """Growth (n,) of a ball's contact, see `BodyResponse.growth`."""
        whole = self.whole.growth
        return None if whole is None else whole[self.chosen]

    @property
    def growth_by_map(self) -> np.ndarray:
        """Derivative of `growth` by the map's parameters, (n, k)."""
        return self.whole.growth_by_map[self.chosen]

    def growth_change(self, state: BodyState) -> np.ndarray:
        """First-order change (n,) of `growth` to a state nearby."""
        return self.whole.growth_change(state)[self.chosen]

    def by_field(self) -> np.ndarray:
        """Return the derivative (n, g) of ln C by a free map."""
        return self.whole.by_field()[self.chosen]

    def change(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """First-order change of compliance (n,) and local modulus (n,) to a state nearby."""
        compliance, local = self.whole.change(state)
        return compliance[self.chosen], local[self.chosen]

    def exact_change(self, state: BodyState, slack: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Change of compliance (n,) and local modulus (n,) to any state."""
        compliance, local = self.whole.exact_change(state, slack)
        return compliance[self.chosen], local[self.chosen]


def _some(value: np.ndarray | float, chosen: np.ndarray) -> np.ndarray:
    """Return the values of chosen presses, of (j, ...) or of one for all."""
    array = np.asarray(value)
    return array[chosen] if array.ndim else np.full(len(chosen), float(value))
