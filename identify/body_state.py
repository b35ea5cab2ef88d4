"""The body that a body effect changes: what the mechanics need to know to give compliances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

Field = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Bump:
    """A Gaussian addition to the modulus: `weight_pa` exp(-|p - centre|^2 / (2 radius^2))."""

    weight_pa: float
    centre_m: tuple[float, float, float]
    radius_m: float

    def added_pa(self, points_m: np.ndarray) -> np.ndarray:
        """Addition to the modulus at points (p, 3), (p,) Pa."""
        square = np.sum((points_m - np.array(self.centre_m)) ** 2, axis=1)
        return self.weight_pa * np.exp(-square / (2.0 * self.radius_m**2))


@dataclass(frozen=True)
class BodyState:
    """A linear elastic body on its support. Effects return changed copies (`changed`).

    Attributes
    ----------
    box_m : (2, 3) bounding box of the undeformed body, m; z is up, the base at its bottom
    poisson_ratio : of the whole body
    bumps : inclusions beside those of the map
    factors : each takes points (p, 3) in m and returns (p,) factors on the modulus
    fibre_share, fibre_angle_rad : fibres lie in the x-y plane at this angle to x; they add the
        energy (share E / 2) (a . strain . a)^2
    base_normal_m_per_pa, base_tangential_m_per_pa : the base gives way by so much per traction
    skin_thickness_m, skin_factor : a top layer of modulus factor * E
    mesh_error_share : share of the model's own discretisation error that is added to C
    rigid_tip_share : share of what the pressure of a rigid, upright flat tip takes off C
    background_pa : modulus that sizes of additions are measured against, where it is known
    """

    box_m: tuple[tuple[float, float, float], tuple[float, float, float]]
    poisson_ratio: float
    bumps: tuple[Bump, ...] = ()
    factors: tuple[Field, ...] = ()
    fibre_share: float = 0.0
    fibre_angle_rad: float = 0.0
    base_normal_m_per_pa: float = 0.0
    base_tangential_m_per_pa: float = 0.0
    skin_thickness_m: float = 0.0
    skin_factor: float = 1.0
    mesh_error_share: float = 0.0
    rigid_tip_share: float = 0.0
    background_pa: float | None = None

    def changed(self, **changes: Any) -> BodyState:
        """Return a copy with some attributes replaced."""
        return replace(self, **changes)

    def factor(self, points_m: np.ndarray) -> np.ndarray:
        """Product of the factors on the modulus at points (p, 3), (p,)."""
        product = np.ones(len(points_m))
        for factor in self.factors:
            product = product * factor(points_m)
        return product

    def added_pa(self, points_m: np.ndarray) -> np.ndarray:
        """Sum of the bumps at points (p, 3), (p,) Pa; the factors act on it as on the map."""
        total = np.zeros(len(points_m))
        for bump in self.bumps:
            total = total + bump.added_pa(points_m)
        return total

    @property
    def height_m(self) -> float:
        """Height of the body."""
        return self.box_m[1][2] - self.box_m[0][2]
