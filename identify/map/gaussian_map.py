"""The distribution map of Young's modulus: a background and a sum of Gaussian inclusions.

    E(p) = w0 + sum_i w_i exp(-|p - q_i|^2 / (2 r_i^2))

Source: eq. 13 of "Method to Generate Distribution Maps of the Material Parameters of the Human
Body Using Robotic and Dynamic Simulation Systems" (eqs. 4-7 for its parts).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from math import cosh, gamma, hypot, sinh

import numpy as np

from models import InputError, kinds_checked, points_of


@kinds_checked
@dataclass(frozen=True)
class Inclusion:
    """One underlying tissue of eq. 13.

    `weight_pa` is the modulus that it adds at its centre (Pa; negative for a soft one),
    `x_m`, `y_m`, `z_m` the centre in the body frame (m), `radius_m` the Gaussian's standard
    deviation (m).

    Examples
    --------
    >>> import palpmap as pm
    >>> hard = pm.Inclusion(20e3, x_m=0.05, y_m=0.05, z_m=0.03, radius_m=0.01)
    >>> pm.GaussianMap(5e3, (hard,)).inclusions[0].weight_pa
    20000.0
    """

    weight_pa: float
    x_m: float
    y_m: float
    z_m: float
    radius_m: float


_FIELDS = tuple(f.name for f in fields(Inclusion))


@dataclass(frozen=True)
class Shape:
    """How inclusions depart from eq. 6: E = w exp(-(q/s^2)^(n/2) / 2), q = o'M o / r^2.

    Attributes
    ----------
    edge : 1 - 2/n, below 1; 0 is the Gaussian, 1 a ball of even stiffness. s keeps the integral
    stretch : (a, b); M = exp(-[[a, b], [b, -a]]) in the horizontal plane, so that an inclusion is
        longer than wide by exp(|(a, b)|), in the direction of half the angle of (a, b) to x
    """

    edge: float = 0.0
    stretch: tuple[float, float] = (0.0, 0.0)

    def added(
        self, inclusion: Inclusion, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the profile f (p,) at points (p, 3), -2 df/dq (p,), M o (p, 3) and q (p,)."""
        offset = np.asarray(points, float) - (inclusion.x_m, inclusion.y_m, inclusion.z_m)
        turned = offset
        amount = hypot(*self.stretch)
        if amount:
            a, b = np.array(self.stretch) * (sinh(amount) / amount)
            metric = cosh(amount) * np.eye(2) - [[a, b], [b, -a]]
            turned = np.column_stack([offset[:, :2] @ metric, offset[:, 2]])
        q = np.sum(turned * offset, axis=1) / inclusion.radius_m**2
        if not self.edge:
            profile = np.exp(-q / 2)
            return profile, profile, turned, q
        m = 1 / (1 - self.edge)  # n/2
        square = (gamma(1.5 / m) / m / (gamma(1.5) * 2 ** (1.5 - 1.5 / m))) ** (2 / 3)
        with np.errstate(over="ignore"):  # far out, where it vanishes
            power = (np.maximum(q, 1e-12) * square) ** m
            profile = np.exp(-power / 2)
        slope = np.where(profile > 0, profile * m * power / np.maximum(q, 1e-12), 0.0)
        return profile, slope, turned, q


GAUSSIAN = Shape()


@kinds_checked
@dataclass(frozen=True)
class GaussianMap:
    """Young's modulus as a function of place, eq. 13; k = 1 + 5 * number of inclusions parameters.

    >>> import numpy as np
    >>> stiffness = GaussianMap(6000.0, (Inclusion(12000.0, 0.048, 0.048, 0.036, 0.012),))
    >>> stiffness.modulus(np.array([[0.048, 0.048, 0.036]]))
    array([18000.])
    >>> stiffness.names[:3]
    ('background_pa', 'inclusion_1.weight_pa', 'inclusion_1.x_m')
    """

    background_pa: float
    inclusions: tuple[Inclusion, ...] = ()

    def __post_init__(self) -> None:
        for i, inclusion in enumerate(self.inclusions, start=1):
            if not inclusion.radius_m > 0:
                raise InputError(
                    f"inclusion_{i}.radius_m must be positive, found {inclusion.radius_m}"
                )

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return "pm.GaussianMap(6000.0)"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k parameters, in the order of `values`."""
        return map_names(len(self.inclusions))

    @property
    def values(self) -> np.ndarray:
        """The k parameters: Pa and m."""
        return np.array([self.background_pa, *(v for i in self.inclusions for v in astuple(i))])

    @classmethod
    def from_values(cls, values: np.ndarray) -> GaussianMap:
        """Build the map from its k = 1 + 5 n parameters, in the order of `names`."""
        values = np.asarray(values, dtype=float)
        if values.ndim != 1 or (values.size - 1) % len(_FIELDS):
            raise InputError(
                f"a map takes 1 + {len(_FIELDS)} n parameters, found an array of {values.shape}"
            )
        rows = values[1:].reshape(-1, len(_FIELDS))
        return cls(float(values[0]), tuple(Inclusion(*map(float, row)) for row in rows))

    def changed(self, changes: Mapping[str, float]) -> GaussianMap:
        """Return the map with some parameters, given by name, set anew."""
        values = dict(zip(self.names, self.values, strict=True))
        for name, value in changes.items():
            if name not in values:
                raise InputError(
                    f"the map has no parameter '{name}'; it has: {', '.join(self.names)}"
                )
            values[name] = float(value)
        return GaussianMap.from_values(np.array(list(values.values())))

    def modulus(self, points: np.ndarray, shape: Shape = GAUSSIAN) -> np.ndarray:
        """Young's modulus (p,) in Pa at points (p, 3) in m. It may be <= 0 where a weight is."""
        points = points_of(points)
        modulus = np.full(len(points), self.background_pa, dtype=float)
        for inclusion in self.inclusions:
            modulus += inclusion.weight_pa * shape.added(inclusion, points)[0]
        return modulus

    def gradient(self, points: np.ndarray, shape: Shape = GAUSSIAN) -> np.ndarray:
        """Return dE/dtheta (p, k) at points (p, 3), in Pa per unit of the parameter."""
        points = points_of(points)
        columns = [np.ones(len(points))]
        for inclusion in self.inclusions:
            profile, slope, offset, q = shape.added(inclusion, points)
            w, r = inclusion.weight_pa, inclusion.radius_m
            columns.append(profile)
            columns.extend((w * slope / r**2) * offset[:, axis] for axis in range(3))
            columns.append(w * slope * q / r)
        return np.column_stack(columns)


def map_names(inclusions: int) -> tuple[str, ...]:
    """Return the parameter names of a map with so many inclusions."""
    return (
        "background_pa",
        *(f"inclusion_{i}.{field}" for i in range(1, inclusions + 1) for field in _FIELDS),
    )
