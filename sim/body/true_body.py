"""The bench's body as a hashable value: everything that its compliances depend on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.body.law import LawCurve
from sim.body.true_map import TruthMap

PAPER_SIZE_M = (0.096, 0.096, 0.048)


@dataclass(frozen=True)
class HiddenBody:
    """A block, its stiffness and its support.

    Attributes
    ----------
    size_m : edges, from the body frame's origin; z up from the base
    poisson_ratio : of the whole body
    truth : Gaussian map of the modulus
    gradient : the modulus is multiplied by exp(gradient (z/h - 1/2))
    side_gradient, side_angle_rad : and by exp(side_gradient s), s from -1/2 to 1/2 of the longer
        side in the horizontal direction at this angle to x
    skin_thickness_m, skin_factor : the modulus is multiplied by the factor in a top layer, which
        gets cells of its own
    fibre_share, fibre_angle_rad : fibres in the x-y plane at this angle to x, which add the
        energy (share E / 2) (a . strain . a)^2
    solved : laws of the presses on a body of another shape, which `size_m` encloses; no other build
        of such a body is solved
    shift_m : where the body's corner lies in the frame of presses and truth, x and y
    base_normal_m_per_pa, base_tangential_m_per_pa : how much the base gives way under 1 Pa
    """

    size_m: tuple[float, float, float] = PAPER_SIZE_M
    poisson_ratio: float = 0.49
    truth: TruthMap = field(default_factory=TruthMap)
    gradient: float = 0.0
    side_gradient: float = 0.0
    side_angle_rad: float = 0.0
    skin_thickness_m: float = 0.0
    skin_factor: float = 1.0
    fibre_share: float = 0.0
    fibre_angle_rad: float = 0.0
    base_normal_m_per_pa: float = 0.0
    base_tangential_m_per_pa: float = 0.0
    shift_m: tuple[float, float] = (0.0, 0.0)
    solved: tuple[LawCurve, ...] | None = field(default=None, compare=False)

    def modulus(self, points_m: np.ndarray) -> np.ndarray:
        """Young's modulus at points (p, 3) m from the body's corner, (p,) Pa."""
        height = self.size_m[2]
        modulus = self.truth(points_m + np.array([*self.shift_m, 0.0]))
        modulus *= np.exp(self.gradient * (points_m[:, 2] / height - 0.5))
        if self.side_gradient:
            towards = [np.cos(self.side_angle_rad), np.sin(self.side_angle_rad)]
            off = (points_m[:, :2] - np.array(self.size_m[:2]) / 2) @ towards
            modulus *= np.exp(self.side_gradient * off / max(self.size_m[:2]))
        if self.skin_thickness_m:
            inside = points_m[:, 2] > height - self.skin_thickness_m
            modulus = np.where(inside, self.skin_factor * modulus, modulus)
        return modulus
