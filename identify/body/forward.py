"""From scaled parameters of the map to the compliance of every press, with its derivative."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from fem import PalpationModel
from identify.map.parameters import ParameterSpace
from identify.optimize.result import InadmissibleError


class ModulusField(Protocol):
    """Young's modulus as a function of place."""

    def modulus(self, points: np.ndarray, /) -> np.ndarray:
        """Young's modulus (p,) in Pa at points (p, 3) in m."""
        ...


@dataclass(frozen=True)
class Forward:
    """Compliance of the j presses of a finite element model over a space of k free parameters.

    `ratio` (j,) multiplies the model's compliance: the defect correction towards a finer model.
    """

    model: PalpationModel
    space: ParameterSpace
    ratio: np.ndarray | float = 1.0
    _known: dict[bytes, tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def rescaled(self, ratio: np.ndarray) -> Forward:
        """Return the same model and space under another ratio; what was solved stays known."""
        forward = replace(self, ratio=ratio)
        forward._known.update(self._known)
        return forward

    def evaluate(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return compliance (j,) m/N and its derivative (j, k) by the scaled coordinates u.

        Raises `InadmissibleError` where the modulus is not positive everywhere.
        """
        bare, gradient = self.bare(u)
        return self.ratio * bare, np.reshape(self.ratio, (-1, 1)) * gradient

    def bare(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the same of the model itself, without `ratio`; each u is solved only once."""
        u = np.asarray(u, float)
        if u.tobytes() not in self._known:
            stiffness = self.space.to_map(u)
            points = self.model.points_m
            response = self.model.evaluate(positive_modulus(stiffness, points))
            free = stiffness.gradient(points)[:, self.space.free] * self.space.slope(u)
            self._known[u.tobytes()] = response.compliance, response.gradient(free)
        return self._known[u.tobytes()]


def compliance(model: PalpationModel, stiffness: ModulusField) -> np.ndarray:
    """Compliance (j,) of the model's presses for a map, m/N."""
    return model.evaluate(positive_modulus(stiffness, model.points_m)).compliance


def positive_modulus(stiffness: ModulusField, points: np.ndarray) -> np.ndarray:
    """Modulus (p,) of a map at points (p, 3); raises `InadmissibleError` where it is <= 0."""
    modulus = stiffness.modulus(points)
    worst = int(np.argmin(modulus))
    if not modulus[worst] > 0:
        x, y, z = 1e3 * points[worst]
        raise InadmissibleError(
            f"the map has a modulus of {modulus[worst]:.3g} Pa at ({x:.1f}, {y:.1f}, {z:.1f}) mm: "
            "it must be positive everywhere"
        )
    return modulus
