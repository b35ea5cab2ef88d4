"""Derivatives of a model's predictions by its unknowns, at one point of the chain.

Those by the map pass through the compliance, the modulus under the tip and the growth of the
contact of each press. Those by an effect are difference quotients: of the chain alone for an effect
beyond the body, else of the body's compliances.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from identify.body.response import BodyResponse
from identify.effects.base import changes_body
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.traced_chain import TracedChain

if TYPE_CHECKING:
    from identify.measurement.model import MeasurementModel

_STEP = 1e-4  # of a parameter's scale, for difference quotients


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the predicted displacement, m.

    Attributes
    ----------
    model : its unknowns, and effects
    u : (k,) scaled coordinates
    body : solved there
    chain : beyond that body
    point : where the chain is linearised
    """

    model: MeasurementModel
    u: np.ndarray
    body: BodyResponse
    chain: Chain
    point: OperatingPoint

    @cached_property
    def by_body(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives (m,) by compliance and local modulus of the reading's press."""
        return self.chain.by_body(self.point)

    @cached_property
    def by_growth(self) -> np.ndarray | None:
        """Derivative (m,) by the growth of the reading's press, None where the body has none."""
        return None if self.body.growth is None else self.chain.by_growth(self.point)

    def by_unknowns(self) -> np.ndarray:
        """Return the derivatives (m, k) by the scaled unknowns."""
        columns, first = [self._by_map()], len(self.model.space.free)
        traced = TracedChain(self.chain, self.point) if self.model.effects else None
        for part in self.model.effects:
            for p, _ in enumerate(part.parameters):
                if traced is not None and not changes_body(part.effect):
                    column = self._by_chain(first, p, part, traced)
                else:
                    column = self._by_body(first + p)
                columns.append(column[:, None])
            first += len(part.parameters)
        return np.hstack(columns)

    def _by_map(self) -> np.ndarray:
        """Return the derivatives by the map's free parameters."""
        (by_c, by_e), body, free = self.by_body, self.body, self.model.space.free
        by_map = self._by_press(by_c, body.by_map) + self._by_press(by_e, body.local_by_map)
        if self.by_growth is not None:
            by_map += self._by_press(self.by_growth, body.growth_by_map)
        return by_map[:, list(free)] * self.model.unknowns.slope(self.u)[: len(free)]

    def _by_press(self, by_c: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        if not by_c.any():
            return np.zeros((len(by_c), gradient.shape[1]))
        return by_c[:, None] * gradient[self.model.readings.press]

    def _sides(self, index: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return scaled coordinates (k,) to both sides of one, for a difference quotient."""
        u, (low, high) = self.u, (side[index] for side in self.model.bounds)
        up, down = u.copy(), u.copy()
        up[index] = min(u[index] + _STEP, high)
        down[index] = max(u[index] - _STEP, low)
        return up, down, float(up[index] - down[index])

    def _by_chain(
        self, first: int, number: int, part: EffectInModel, traced: TracedChain
    ) -> np.ndarray:
        """Return the derivative (m,) by a scaled parameter of an effect beyond the body.

        `first` is the place of the effect's parameters in `u`, `number` that of this one in them.
        """
        up, down, width = self._sides(first + number)
        own = slice(first, first + len(part.parameters))
        above, below = (
            traced.with_values(part.effect.name, part.to_values(side[own])) for side in (up, down)
        )
        return (above - below) / width

    def _by_body(self, index: int) -> np.ndarray:
        """Return the derivative (m,) by a scaled parameter of an effect of the body."""
        model, body, (by_c, by_e) = self.model, self.body, self.by_body
        c, e = self.point.compliance, self.point.modulus
        up, down, width = self._sides(index)
        states = [model.state(model.values(side)) for side in (up, down)]
        (c_up, e_up), (c_down, e_down) = (body.change(state) for state in states)
        by_body = [c / body.compliance * (c_up - c_down), e_up - e_down]
        if model.unit_compliance is not None:
            by_body[1] = -e / c * by_body[0]
        press = model.readings.press
        change = by_c * by_body[0][press] + by_e * by_body[1][press]
        if self.by_growth is not None:
            changes = [body.growth_change(state) for state in states]
            change += self.by_growth * (changes[0] - changes[1])[press]
        return change / width
