"""The virtual body's true stiffness: Gaussian inclusions on a background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.errors import InputError


@dataclass(frozen=True)
class Inclusion:
    """A hard (or soft) spot.

    Attributes
    ----------
    weight_pa : added modulus in its centre, Pa
    centre_m : (x, y, z) m, body frame
    radius_m : standard deviation of the Gaussian, m
    """

    weight_pa: float = 30000.0
    centre_m: tuple[float, float, float] = (0.040, 0.058, 0.034)
    radius_m: float = 0.010


@dataclass(frozen=True)
class TruthMap:
    """E(p) = background + sum_i weight_i exp(-|p - centre_i|^2 / (2 radius_i^2)), Pa.

    Examples
    --------
    >>> truth = TruthMap(6000.0, (Inclusion(12000.0, (0.05, 0.05, 0.03), 0.01),))
    >>> truth(np.array([[0.05, 0.05, 0.03]])).tolist()
    [18000.0]
    """

    background_pa: float = 6000.0
    inclusions: tuple[Inclusion, ...] = (Inclusion(),)

    def __post_init__(self) -> None:
        if not self.background_pa > 0:
            raise InputError(
                f"The background modulus is {self.background_pa:g} Pa; it has to be positive."
            )
        for i, inclusion in enumerate(self.inclusions, start=1):
            if not inclusion.radius_m > 0:
                raise InputError(
                    f"Inclusion {i} has a radius of {inclusion.radius_m:g} m; it has to be "
                    "positive."
                )
            if not self.background_pa + inclusion.weight_pa > 0:
                raise InputError(
                    f"Inclusion {i} with {inclusion.weight_pa:g} Pa takes more than the "
                    "background of "
                    f"{self.background_pa:g} Pa away; the modulus has to stay positive."
                )

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """Young's modulus at points (p, 3) m, (p,) Pa."""
        modulus = np.full(len(points_m), float(self.background_pa))
        for inclusion in self.inclusions:
            squared = ((points_m - np.asarray(inclusion.centre_m)) ** 2).sum(axis=1)
            modulus += inclusion.weight_pa * np.exp(-squared / (2 * inclusion.radius_m**2))
        return modulus
