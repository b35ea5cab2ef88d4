"""Compliance of every press for a map of Young's modulus that is positive everywhere."""

from typing import Protocol

import numpy as np

from fem import PalpationModel
from identify.optimize.result import InadmissibleError


class ModulusField(Protocol):
    """Young's modulus as a function of place."""

    def modulus(self, points: np.ndarray, /) -> np.ndarray:
        """Young's modulus (p,) in Pa at points (p, 3) in m."""
        ...


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


def refuse_impossible(compliance: np.ndarray) -> None:
    """Raise `InadmissibleError` unless all compliances (j,) are positive numbers."""
    finite = np.isfinite(compliance)
    if not (finite.all() and compliance.min() > 0):
        press = int(np.argmin(np.where(finite, compliance, -np.inf)))
        raise InadmissibleError(
            f"the body's model gives press {press} a compliance of {compliance[press]:.3g} "
            "m/N, which cannot be: its map is finer than the mesh; start from another map "
            "([map.initial])"
        )
