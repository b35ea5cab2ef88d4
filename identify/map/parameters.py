"""Which parameters of a map are free, and the scaled coordinates in which they are sought.

An optimiser works on u (k,), not on the parameters themselves, so that all have the same scale
(as the paper demands) and the positive ones stay positive:

- background, radius, and a weight that starts positive: u = ln(value). A weight in log scale keeps
  its sign, so that a hard inclusion stays hard and E > 0 everywhere.
- a weight that starts at or below zero (a soft inclusion): u = weight / background at the start.
  Its bound keeps E > 0 but where inclusions overlap, or the background falls far below its start;
  a map that breaks it is an inadmissible trial (see `forward`).
- position: u = coordinate / size of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.map.gaussian_map import GaussianMap
from models.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """One parameter of the map: u = ln(value) if `log`, else value / scale; bounds in its unit."""

    name: str
    unit: str
    lower: float
    upper: float
    scale: float
    log: bool

    def to_scaled(self, value: float) -> float:
        """Return u of a value; a value outside the bounds is put on the nearer one."""
        value = min(max(value, self.lower), self.upper)
        return float(np.log(value)) if self.log else value / self.scale

    def to_value(self, u: float) -> float:
        """Return the value of u."""
        return float(np.exp(u)) if self.log else u * self.scale


@dataclass(frozen=True)
class ParameterSpace:
    """The free parameters of a map in scaled coordinates; the others keep the start's values.

    `start` gives the fixed values, the signs of the weights and their scale; `parameters` describes
    all of them; `free` (k,) holds the indices of the free ones.
    """

    start: GaussianMap
    parameters: tuple[Parameter, ...]
    free: tuple[int, ...]

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names of the k free parameters."""
        return tuple(self.parameters[i].name for i in self.free)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (k,) in scaled coordinates."""
        chosen = [self.parameters[i] for i in self.free]
        return (
            np.array([p.to_scaled(p.lower) for p in chosen]),
            np.array([p.to_scaled(p.upper) for p in chosen]),
        )

    def to_scaled(self, stiffness: GaussianMap) -> np.ndarray:
        """Return the scaled coordinates u (k,) of a map's free parameters."""
        values = stiffness.values
        return np.array([self.parameters[i].to_scaled(values[i]) for i in self.free])

    def to_map(self, u: np.ndarray) -> GaussianMap:
        """Return the map at scaled coordinates u (k,)."""
        values = self.start.values
        for i, coordinate in zip(self.free, u, strict=True):
            values[i] = self.parameters[i].to_value(float(coordinate))
        return GaussianMap.from_values(values)

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return d value / d u (k,) of the free parameters."""
        return np.array(
            [
                self.parameters[i].to_value(float(c)) if self.parameters[i].log
                else self.parameters[i].scale
                for i, c in zip(self.free, u, strict=True)
            ]
        )  # fmt: skip

    def at_bound(self, u: np.ndarray) -> tuple[str, ...]:
        """Names of the free parameters that sit on one of their bounds."""
        lower, upper = self.bounds
        hit = (u <= lower + 1e-9) | (u >= upper - 1e-9)
        return tuple(name for name, is_hit in zip(self.free_names, hit, strict=True) if is_hit)


def body_parameters(start: GaussianMap, box: np.ndarray) -> tuple[Parameter, ...]:
    """Describe the parameters of a map in a body with bounding box (2, 3) in m.

    Bounds: a centre lies inside the box; a radius between 1/15 of the body's smallest size
    (less is resolved neither by presses nor by cells) and its largest; the background within a
    factor of 1000 of its start, positive weights up to 100 backgrounds (more is as good as rigid),
    negative ones down to 0.95 of the start's background (less is as good as a hole).
    """
    low, high = np.asarray(box, float)
    size = high - low
    longest, shortest = float(size.max()), float(size.min())
    background = start.background_pa
    if not background > 0:
        raise InputError(f"background_pa must be positive, found {background}")
    described = [
        Parameter("background_pa", "Pa", background / 1e3, background * 1e3, background, log=True)
    ]
    for i, inclusion in enumerate(start.inclusions, start=1):
        weight = inclusion.weight_pa
        name = f"inclusion_{i}"
        hard = weight > 0
        upper = max(100 * background, 2 * weight)
        lower, upper = (weight / 1e3, upper) if hard else (min(-0.95 * background, weight), 0.0)
        described.append(Parameter(f"{name}.weight_pa", "Pa", lower, upper, background, log=hard))
        for axis, letter in enumerate("xyz"):
            described.append(
                Parameter(f"{name}.{letter}_m", "m", low[axis], high[axis], longest, log=False)
            )
        described.append(
            Parameter(f"{name}.radius_m", "m", shortest / 15, longest, longest, log=True)
        )
    return tuple(described)


def parameter_space(
    start: GaussianMap, box: np.ndarray, free: Sequence[str] | None = None
) -> ParameterSpace:
    """Free the named parameters of a map (all of them for None) in a body with box (2, 3) m."""
    names = start.names
    wanted = names if free is None else tuple(free)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise InputError(
            f"the map has no parameter '{unknown[0]}' to be freed; it has: {', '.join(names)}"
        )
    indices = tuple(i for i, name in enumerate(names) if name in wanted)
    return ParameterSpace(start, body_parameters(start, box), indices)
