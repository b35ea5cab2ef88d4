"""An effect as a part of a model, and the values of all parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identify.effects.base import Effect
from identify.map.parameters import Parameter


@dataclass(frozen=True)
class EffectInModel:
    """An effect with its parameters, bounded for this scan, and its start values."""

    effect: Effect
    parameters: tuple[Parameter, ...]
    start: Mapping[str, float]

    def to_scaled(self) -> np.ndarray:
        """Scaled start (q,)."""
        return np.array([p.to_scaled(self.start[p.name]) for p in self.parameters])

    def to_values(self, u: np.ndarray) -> dict[str, float]:
        """Values by name at scaled coordinates (q,)."""
        return {p.name: p.to_value(float(c)) for p, c in zip(self.parameters, u, strict=True)}


def effect_values(parts: Sequence[EffectInModel], u: np.ndarray) -> dict[str, dict[str, float]]:
    """Parameters of effects at their scaled coordinates (q,), by effect and name."""
    values, first = {}, 0
    for part in parts:
        last = first + len(part.parameters)
        values[part.effect.name] = part.to_values(u[first:last])
        first = last
    return values
