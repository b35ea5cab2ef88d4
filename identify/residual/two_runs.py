"""Two fits of one body: the difference of their maps and effects in standard errors.

Both maps are sampled over the box that the bodies share. The standard error of ln E is that of the
posterior of a free map, or follows from the covariance of the parameters; where a fit leaves more
than its noise, it grows by the root of chi-square per degree of freedom. The largest difference is
judged as the largest of as many independent ones as the fits have unknowns, of a free map the
effective number of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from identify.fit.free_map.field import LEVEL as FIELD_MEAN
from identify.fit.result import FitResult
from identify.map import FreeMap, Grid

LEVEL = 0.01  # of the test
_PLACES = 4000  # samples of the shared box, about


@dataclass(frozen=True)
class ParameterChange:
    """A parameter in both fits, or in one alone (the other value is None)."""

    name: str
    unit: str
    one: float | None
    other: float | None
    standard_errors: float | None


@dataclass(frozen=True, eq=False)
class RunDifference:
    """Difference of the other fit from the one.

    Attributes
    ----------
    grid : p places of the shared box, body frame
    log_ratio : (p,) ln E of the other map less that of the one
    sd : (p,) its standard error
    independent : number of differences among which the largest is judged
    changes : of the effects' parameters, and of the maps' where both have the same
    """

    grid: Grid
    log_ratio: np.ndarray
    sd: np.ndarray
    independent: int
    changes: tuple[ParameterChange, ...]

    @property
    def standard_errors(self) -> np.ndarray:
        """Difference of the maps in standard errors, (p,)."""
        return self.log_ratio / self.sd

    @property
    def largest(self) -> int:
        """Number of the place where the maps differ most, in standard errors."""
        return int(np.argmax(np.abs(self.standard_errors)))

    @property
    def p_value(self) -> float:
        """Probability of a difference that large, were the maps the same."""
        single = 2 * ndtr(-abs(self.standard_errors[self.largest]))
        return float(-np.expm1(self.independent * np.log1p(-min(single, 1 - 1e-12))))

    @property
    def maps_differ(self) -> bool:
        """Whether the maps differ, at the level `LEVEL`."""
        return self.p_value < LEVEL

    @property
    def changed(self) -> tuple[ParameterChange, ...]:
        """Effects' parameters that differ by three standard errors, or are in one fit alone."""
        return tuple(
            c for c in self.changes if c.standard_errors is None or abs(c.standard_errors) > 3
        )


def run_difference(
    one: FitResult, other: FitResult, box_m: np.ndarray, other_box_m: np.ndarray
) -> RunDifference:
    """Compare two fits of one body, both in its frame.

    Parameters
    ----------
    box_m, other_box_m : (2, 3) of the bodies

    Raises
    ------
    ValueError
        The boxes share no place.
    """
    low = np.maximum(box_m[0], other_box_m[0])
    high = np.minimum(box_m[1], other_box_m[1])
    if not (high > low).all():
        raise ValueError(
            "the two runs' bodies share no place: their frames differ; expected two runs on one "
            "body, in one frame"
        )
    grid = Grid.over(np.array([low, high]), float(np.cbrt(np.prod(high - low) / _PLACES)))
    points = grid.points_m
    moduli = [np.maximum(f.map.modulus(points), 1e-6 * f.map.background_pa) for f in (one, other)]
    variance = sum(log_modulus_sd(f, points) ** 2 for f in (one, other))
    return RunDifference(
        grid,
        np.log(moduli[1] / moduli[0]),
        np.sqrt(np.maximum(variance, 1e-12)),
        max(_told(one), _told(other)),
        _changes(one, other),
    )


def log_modulus_sd(fit: FitResult, points_m: np.ndarray) -> np.ndarray:
    """Return the standard error (p,) of ln E at points (p, 3), a misfit counted (Birge's ratio)."""
    if isinstance(fit.map, FreeMap):
        assert fit.field is not None
        sd = fit.map.grid.interpolated(fit.field.log_sd, points_m)
    else:
        names = [name for name in fit.covariance_names if name in fit.map.names]
        at = [fit.covariance_names.index(name) for name in names]
        columns = fit.map.gradient(points_m)[:, [fit.map.names.index(name) for name in names]]
        columns = columns / fit.map.modulus(points_m)[:, None]
        covariance = fit.covariance[np.ix_(at, at)]
        sd = np.sqrt(np.maximum(np.einsum("pk,kl,pl->p", columns, covariance, columns), 0.0))
    return sd * np.sqrt(max(fit.chi2_per_dof, 1.0))


def _told(fit: FitResult) -> int:
    """Return the number of the fit's unknowns, at least one; a free map's stand in its field."""
    field = 0 if fit.field is None else round(fit.field.effective)
    return max(fit.unknowns + field, 1)


def _changes(one: FitResult, other: FitResult) -> tuple[ParameterChange, ...]:
    names = dict.fromkeys([*one.parameters, *other.parameters])
    found = []
    for name in names:
        pair = [fit.parameters.get(name) for fit in (one, other)]
        a, b = pair
        if (a is None or b is None) and (
            name == FIELD_MEAN or name in (*one.map.names, *other.map.names)
        ):
            continue  # maps of different kinds are compared place by place
        error = None
        if a is not None and b is not None:
            birge = [np.sqrt(max(fit.chi2_per_dof, 1.0)) for fit in (one, other)]
            sd = float(np.hypot(a.std * birge[0], b.std * birge[1]))
            error = None if sd == 0 else (b.value - a.value) / sd
            if sd == 0 and a.value == b.value:
                continue
        known = a or b
        assert known is not None
        found.append(ParameterChange(name, known.unit, a and a.value, b and b.value, error))
    return tuple(found)
