"""State of the body beyond its map, as body effects change it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fem.palpation import fibre_weights
from identify.map.gaussian_map import GAUSSIAN, GaussianMap, Inclusion, Shape

Field = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class BodyState:
    """A linear elastic body on its support. Effects return changed copies (`changed`).

    Attributes
    ----------
    box_m : (2, 3) bounding box of the undeformed body, m; z is up, the base at its bottom
    poisson_ratio : of the whole body
    bumps : inclusions beside those of the map
    inclusion_shape : of all inclusions of the map
    factors : each takes points (p, 3) in m and returns (p,) factors on the modulus
    fibre_share, fibre_angle_rad : fibres lie in the x-y plane at this angle to x; they add the
        energy (share E / 2) (a . strain . a)^2
    base_normal_m_per_pa, base_tangential_m_per_pa : the base gives way by so much per traction
    skin_thickness_m, skin_factor : a top layer of modulus factor * E
    mesh_error_share : share of the model's own discretisation error in C
    rigid_tip_share : share of the reduction of C by the pressure of a rigid, upright flat tip
    shift_m : shift of the body from its stated place, along x and y
    background_pa : background modulus as the scale of an effect's size, if known
    """

    box_m: tuple[tuple[float, float, float], tuple[float, float, float]]
    poisson_ratio: float
    bumps: tuple[Inclusion, ...] = ()
    inclusion_shape: Shape = GAUSSIAN
    factors: tuple[Field, ...] = ()
    fibre_share: float = 0.0
    fibre_angle_rad: float = 0.0
    base_normal_m_per_pa: float = 0.0
    base_tangential_m_per_pa: float = 0.0
    skin_thickness_m: float = 0.0
    skin_factor: float = 1.0
    mesh_error_share: float = 0.0
    rigid_tip_share: float = 0.0
    shift_m: tuple[float, float] = (0.0, 0.0)
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
            total = total + bump.weight_pa * GAUSSIAN.added(bump, points_m)[0]
        return total

    @property
    def modulus_changes(self) -> tuple[tuple[Inclusion, ...], Shape, tuple[Field, ...]]:
        """All that changes the modulus of a given map."""
        return self.bumps, self.inclusion_shape, self.factors

    @property
    def without_modulus_changes(self) -> BodyState:
        """The state without all that changes the modulus of a given map."""
        return self.changed(bumps=(), inclusion_shape=GAUSSIAN, factors=())

    @property
    def base_m_per_pa(self) -> tuple[float, float]:
        """Compliance of the base, across and along."""
        return self.base_normal_m_per_pa, self.base_tangential_m_per_pa

    @property
    def height_m(self) -> float:
        """Height of the body."""
        return self.box_m[1][2] - self.box_m[0][2]


@dataclass(frozen=True)
class ChangedMap:
    """A map as a state has changed it."""

    stiffness: GaussianMap
    state: BodyState

    @property
    def inclusions(self) -> tuple[Inclusion, ...]:
        """The map's inclusions and those beside them."""
        return (*self.stiffness.inclusions, *self.state.bumps)

    def modulus(self, points: np.ndarray) -> np.ndarray:
        """Young's modulus at points (p, 3), (p,) Pa; it may be <= 0."""
        plain = self.stiffness.modulus(points, self.state.inclusion_shape)
        return (plain + self.state.added_pa(points)) * self.state.factor(points)

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Return its derivative by the map's k parameters at points (p, 3), (p, k)."""
        gradient = self.stiffness.gradient(points, self.state.inclusion_shape)
        return gradient * self.state.factor(points)[:, None]


def fibres_of(state: BodyState) -> np.ndarray:
    """Share of the fibres times the weights (6,) of their strain products."""
    return state.fibre_share * fibre_weights(state.fibre_angle_rad)


def has_skin(state: BodyState) -> bool:
    """Whether a skin differs from the body below it."""
    return state.skin_thickness_m > 0 and state.skin_factor != 1
