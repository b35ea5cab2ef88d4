"""Parameters of map and effects, and the scaled coordinates in which the free ones are sought.

An optimiser works on u (k,), not on the parameters themselves, so that all have the same scale
(as the paper demands) and the positive ones stay positive:

- background, radius, and a weight that starts positive: u = ln(value). A weight in log scale keeps
  its sign, so that a hard inclusion stays hard and E > 0 everywhere.
- a weight that starts at or below zero (a soft inclusion): u = weight / background at the start.
  Its bound keeps E > 0 but where inclusions overlap, or the background falls far below its start;
  a map that breaks it is an inadmissible trial (`InadmissibleError`).
- position: u = coordinate / size of the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from identify.map.free_map import FreeMap
from identify.map.gaussian_map import GaussianMap
from models import InputError, kinds_checked

_AT_BOUND = 1e-9  # distance from a bound, in scaled coordinates, that counts as none
_HARDEST, _SOFTEST = 100.0, -0.95  # weight of an inclusion over the background


@kinds_checked
@dataclass(frozen=True)
class Parameter:
    """One parameter of a map or of an effect; scaled: u = ln(value) if `log`, else value / typical.

    Attributes
    ----------
    name : ends with its unit where it has one (`tau_s`, `offset_m`)
    unit : of the value; "1" for a pure number
    meaning : one line
    null : value of an amplitude at which its effect is absent. None for a parameter of the map, and
        for a shape parameter, such as a time constant, that has no meaning while the amplitudes are
        null: it is searched on a grid
    lower, upper : bounds
    typical : size that an experimenter would call ordinary; the scale of the search
    log : sought as ln(value); of effects, shape parameters only
    natural : bounds that are physics, not limits of the search (no friction, no change of volume):
        an estimate there is a finding, one on another bound a doubt

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.EffectParameter(
    ...     "offset_m", "m", "offset of the displacement", null=0.0, lower=-5e-3, upper=5e-3,
    ...     typical=1e-4,
    ... ).unit
    'm'
    """

    name: str
    unit: str
    meaning: str
    null: float | None
    lower: float
    upper: float
    typical: float
    log: bool = False
    natural: Literal["", "lower", "upper", "both"] = ""

    def to_scaled(self, value: float) -> float:
        """Return u of a value; a value outside the bounds is put on the nearer one."""
        value = min(max(value, self.lower), self.upper)
        return float(np.log(value)) if self.log else value / self.typical

    def to_value(self, u: float) -> float:
        """Return the value of u."""
        return float(np.exp(u)) if self.log else u * self.typical

    def slope(self, u: float) -> float:
        """Return d value / d u."""
        return self.to_value(u) if self.log else self.typical


@dataclass(frozen=True)
class ParameterSpace:
    """The k unknowns in scaled coordinates: free parameters of a map, then those of effects.

    Attributes
    ----------
    start : values of the map's fixed parameters, signs of the weights and their scale; a free map,
        which has no parameters, as it is
    parameters : all of the map
    free : indices of the map's free ones
    beyond : those of effects, under the names of the unknowns
    """

    start: GaussianMap
    parameters: tuple[Parameter, ...]
    free: tuple[int, ...]
    beyond: tuple[Parameter, ...] = ()

    @cached_property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The k parameters that are sought."""
        return (*(self.parameters[i] for i in self.free), *self.beyond)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k unknowns."""
        return tuple(p.name for p in self.unknowns)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (k,) in scaled coordinates, not to be written to."""
        lower = np.array([p.to_scaled(p.lower) for p in self.unknowns])
        upper = np.array([p.to_scaled(p.upper) for p in self.unknowns])
        for bound in (lower, upper):
            bound.setflags(write=False)
        return lower, upper

    def to_scaled(self, stiffness: GaussianMap) -> np.ndarray:
        """Return the scaled coordinates of a map's free parameters."""
        values = stiffness.values
        return np.array([self.parameters[i].to_scaled(values[i]) for i in self.free])

    def to_map(self, u: np.ndarray) -> GaussianMap:
        """Return the map at scaled coordinates u (k,)."""
        if isinstance(self.start, FreeMap):
            return self.start
        values = self.start.values
        for i, coordinate in zip(self.free, u[: len(self.free)], strict=True):
            values[i] = self.parameters[i].to_value(float(coordinate))
        return GaussianMap.from_values(values)

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return d value / d u (k,) of the unknowns."""
        return np.array([p.slope(float(c)) for p, c in zip(self.unknowns, u, strict=True)])

    def longest_step(self, u: np.ndarray) -> np.ndarray:
        """Return the largest sensible step (k,) of a fit from scaled coordinates u (k,).

        One for logarithms and for the map; an amplitude may be many typical sizes large.
        """
        longest = np.ones(len(u))
        for i, p in enumerate(self.beyond, start=len(self.free)):
            longest[i] = 1.0 if p.log else max(abs(u[i]), 1.0)
        return longest

    def at_natural_end(self, u: np.ndarray) -> np.ndarray:
        """Whether each unknown (k,) sits on a bound that is physics."""
        lower, upper = self.bounds
        low, high = (
            np.array([p.natural in (side, "both") for p in self.unknowns], bool)
            for side in ("lower", "upper")
        )
        return ((u <= lower + _AT_BOUND) & low) | ((u >= upper - _AT_BOUND) & high)

    def at_bound(self, u: np.ndarray) -> tuple[str, ...]:
        """Names of the unknowns that sit on a bound of the search; a natural one is none."""
        lower, upper = self.bounds
        hit = (u <= lower + _AT_BOUND) | (u >= upper - _AT_BOUND)
        hit &= ~self.at_natural_end(u)
        return tuple(name for name, is_hit in zip(self.names, hit, strict=True) if is_hit)


def body_parameters(
    start: GaussianMap, box: np.ndarray, probed: np.ndarray | None = None
) -> tuple[Parameter, ...]:
    """Describe the parameters of a map in a body with bounding box (2, 3) in m.

    Bounds: a centre lies inside the box; a radius between 1/15 of the smallest size of the part
    that presses show, a box like the body's (less is resolved neither by presses nor by cells), and
    the body's largest; the background within a
    factor of 1000 of its start, positive weights up to 100 backgrounds (more is as good as rigid),
    negative ones down to 0.95 of the start's background (less is as good as a hole).
    """
    low, high = np.asarray(box, float)
    size = high - low
    longest = float(size.max())
    shortest = float(np.ptp(box if probed is None else probed, axis=0).min())
    background = start.background_pa
    if not background > 0:
        raise InputError(f"background_pa must be positive, found {background}")
    described = [_of_map("background_pa", background / 1e3, background * 1e3, background, log=True)]
    for i, inclusion in enumerate(start.inclusions, start=1):
        weight = inclusion.weight_pa
        name = f"inclusion_{i}"
        hard = weight > 0
        upper = max(_HARDEST * background, 2 * weight)
        lower, upper = (weight / 1e3, upper) if hard else (min(_SOFTEST * background, weight), 0.0)
        described.append(_of_map(f"{name}.weight_pa", lower, upper, background, log=hard))
        for axis, letter in enumerate("xyz"):
            described.append(_of_map(f"{name}.{letter}_m", low[axis], high[axis], longest))
        described.append(_of_map(f"{name}.radius_m", shortest / 15, longest, longest, log=True))
    return tuple(described)


def any_inclusion(parameter: Parameter) -> tuple[float, float]:
    """Return the range of an inclusion's parameter; of its weight, for hard and soft ones alike."""
    p = parameter
    if not p.name.endswith(".weight_pa"):
        return p.lower, p.upper
    return min(p.lower, _SOFTEST * p.typical), max(p.upper, _HARDEST * p.typical)


def _of_map(name: str, lower: float, upper: float, typical: float, log: bool = False) -> Parameter:
    """Describe a parameter of the map."""
    return Parameter(
        name, "Pa" if name.endswith("_pa") else "m", "", None, lower, upper, typical, log
    )


def parameter_space(
    start: GaussianMap,
    box: np.ndarray,
    free: Sequence[str] | None = None,
    probed: np.ndarray | None = None,
) -> ParameterSpace:
    """Free the named parameters of a map (all of them for None) in a body with box (2, 3) m.

    See `body_parameters` for the part of it that presses show.
    """
    names = start.names
    wanted = names if free is None else tuple(free)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise InputError(
            f"the map has no parameter '{unknown[0]}' to be freed; it has: {', '.join(names)}"
        )
    indices = tuple(i for i, name in enumerate(names) if name in wanted)
    return ParameterSpace(start, body_parameters(start, box, probed), indices)
