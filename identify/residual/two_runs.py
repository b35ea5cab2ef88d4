"""Two fits of one body: the difference of their maps and effects in standard errors.

Both maps are sampled over the box that the bodies share. The standard error of ln E is that of the
posterior of a free map, or follows from the covariance of the parameters; where a fit leaves more
than its noise, it grows by the root of chi-square per degree of freedom. The largest difference is
judged as the largest of as many independent ones as the fits have unknowns, of a free map the
effective number of them.

The maps are taken with the effects that change them (an inclusion's edge, a gradient). Effects that
change the body's stiffness and no map (a skin, fibres) are a difference of the bodies of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from identify.effects.base import Effect
from identify.fit.free_map.field import LEVEL as FIELD_MEAN
from identify.fit.result import FitResult
from identify.map import FreeMap, Grid
from identify.residual.fitted_model import beside_map, changed_map

LEVEL = 0.01  # of the test
_PLACES = 4000  # samples of the shared box, about
_STEP = 1e-3  # standard errors, of a derivative by an effect's parameter
_FAR = 3.0  # standard errors between parameters that differ


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
    in_maps : names of the effects that change the maps, which are compared with them
    beside_maps : names of the effects that change the stiffness beside the maps and differ
    """

    grid: Grid
    log_ratio: np.ndarray
    sd: np.ndarray
    independent: int
    changes: tuple[ParameterChange, ...]
    in_maps: tuple[str, ...] = ()
    beside_maps: tuple[str, ...] = ()

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
    def bodies_differ(self) -> bool:
        """True if the maps differ, or an effect that changes the stiffness beside them."""
        return self.maps_differ or bool(self.beside_maps)

    @property
    def changed(self) -> tuple[ParameterChange, ...]:
        """Effects' parameters that differ by three standard errors, or are in one fit alone."""
        return tuple(
            c for c in self.changes if c.standard_errors is None or abs(c.standard_errors) > _FAR
        )


def run_difference(
    one: FitResult,
    other: FitResult,
    box_m: np.ndarray,
    other_box_m: np.ndarray,
    catalogue: Sequence[Effect],
) -> RunDifference:
    """Compare two fits of one body, both in its frame.

    Parameters
    ----------
    box_m, other_box_m : (2, 3) of the bodies
    catalogue : where the fits' effects are looked up

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
    points, fits = grid.points_m, ((one, box_m), (other, other_box_m))
    moduli = [_modulus(fit, points, box, catalogue) for fit, box in fits]
    variance = sum(log_modulus_sd(fit, points, box, catalogue) ** 2 for fit, box in fits)
    in_maps = [changed_map(fit, box, catalogue)[1] for fit, box in fits]
    beside = [beside_map(fit, box, catalogue) for fit, box in fits]
    return RunDifference(
        grid,
        np.log(moduli[1] / moduli[0]),
        np.sqrt(np.maximum(variance, 1e-12)),
        max(_told(one), _told(other)),
        _changes(one, other),
        in_maps=tuple(dict.fromkeys(in_maps[0] + in_maps[1])),
        beside_maps=tuple(
            name for name in dict.fromkeys(beside[0] + beside[1])
            if _differs(name, one, other, catalogue)
        ),
    )  # fmt: skip


def _modulus(
    fit: FitResult,
    points_m: np.ndarray,
    box_m: np.ndarray,
    catalogue: Sequence[Effect],
    values: dict[str, float] | None = None,
) -> np.ndarray:
    """Modulus (p,) of a fit's map as its effects change it, Pa, greater than 0."""
    found = changed_map(fit, box_m, catalogue, values)[0]
    return np.maximum(found.modulus(points_m), 1e-6 * fit.map.background_pa)


def log_modulus_sd(
    fit: FitResult, points_m: np.ndarray, box_m: np.ndarray, catalogue: Sequence[Effect]
) -> np.ndarray:
    """Return the standard error (p,) of ln E at points (p, 3), a misfit counted (Birge's ratio).

    Beside a free map the effects that change it count as independent of it.
    """
    changed, effects = changed_map(fit, box_m, catalogue)
    modulus, columns = _modulus(fit, points_m, box_m, catalogue), {}
    own = changed.gradient(points_m) / modulus[:, None]
    columns |= dict(zip(fit.map.names, own.T, strict=False))
    known = {name: p.value for name, p in fit.parameters.items()}
    for effect in catalogue:
        for p in effect.parameters if effect.name in effects else ():
            name = f"{effect.name}.{p.name}"
            step = _STEP * fit.std.get(name, 0.0)
            step = -step if known[name] + step > p.upper else step
            if step:
                moved = {**known, name: known[name] + step}
                there = _modulus(fit, points_m, box_m, catalogue, moved)
                columns[name] = np.log(there / modulus) / step
    names = [name for name in fit.covariance_names if name in columns]
    at = [fit.covariance_names.index(name) for name in names]
    variance = np.zeros(len(points_m))
    if names:
        by = np.column_stack([columns[name] for name in names])
        variance = np.einsum("pk,kl,pl->p", by, fit.covariance[np.ix_(at, at)], by)
    if isinstance(fit.map, FreeMap):
        assert fit.field is not None
        variance = variance + fit.map.grid.interpolated(fit.field.log_sd, points_m) ** 2
    return np.sqrt(np.maximum(variance, 0.0) * max(fit.chi2_per_dof, 1.0))


def _differs(name: str, one: FitResult, other: FitResult, catalogue: Sequence[Effect]) -> bool:
    """Return True if an effect's amplitudes differ; of one in one fit alone, from none."""
    (effect,) = (e for e in catalogue if e.name == name)
    for p in effect.amplitudes:
        change, variance = 0.0, 0.0
        for fit, sign in ((one, -1), (other, 1)):
            entry = fit.parameters.get(f"{name}.{p.name}")
            change += sign * float((p.null or 0.0) if entry is None else entry.value)
            variance += 0.0 if entry is None else entry.std**2 * max(fit.chi2_per_dof, 1.0)
        if abs(change) > _FAR * np.sqrt(variance):
            return True
    return False


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
