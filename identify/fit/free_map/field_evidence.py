"""Length and spread of a free map's prior, and the map's own error, by evidence.

The evidence of the readings, linear around an estimate, is maximised: spread and error by its exact
gradient for each length, the length by a search of one number. A part of the presses suffices for
three numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

from identify.fit.free_map.field_data import FieldData, PressSums
from identify.fit.free_map.settings import FREE_MAP, FreeMapSettings
from identify.map import Grid, LabelledGrid, MaternField

STEEP, GRADUAL = 0.5, 1.5  # smoothness of a prior: of one that is not stated, and the other


@dataclass(frozen=True)
class Hyper:
    """Length, spread and smoothness of the prior, relative error of the map; the `given` ones."""

    length_m: float
    spread: float
    error: float
    given: tuple[str, ...] = ()
    smoothness: float = STEEP

    def prior(self, grid: Grid, settings: FreeMapSettings = FREE_MAP) -> MaternField:
        """Return the prior of a field; labelled regions have their layers among them."""
        height_m = grid.spacing_m[2] * (grid.counts[2] - 1)
        layers, untold = settings.layer_spread, settings.untold_layer_spread
        if self.smoothness == GRADUAL:
            layers, untold = settings.gradual_layer_spread, 0.0
        if isinstance(grid, LabelledGrid):
            layers = untold = 0.0
        return MaternField(
            grid, self.length_m, self.spread, settings.level_spread,
            layers, settings.layer_length * height_m, self.smoothness, untold,
        )  # fmt: skip

    def towards(self, other: Hyper, longest: float) -> Hyper:
        """Return other numbers, or those at the longest change of a logarithm on the way there."""
        least, most = np.exp(-longest), np.exp(longest)

        def limited(own: float, found: float) -> float:
            return float(np.clip(found, least * own, most * own)) if own > 0 else found

        return Hyper(
            limited(self.length_m, other.length_m),
            limited(self.spread, other.spread),
            other.error,
            other.given,
            self.smoothness,
        )


def best_hyper(
    sums: PressSums,
    by_field: np.ndarray,
    field: np.ndarray,
    prior: MaternField,
    start: Hyper,
    lengths_m: tuple[float, float],
    settings: FreeMapSettings = FREE_MAP,
    shift: np.ndarray | None = None,
    doubt: np.ndarray | None = None,
) -> Hyper:
    """Return the numbers of most evidence, wide priors counted; those `given` stay.

    Parameters
    ----------
    sums, by_field, field, shift, doubt : as `FieldData.of` takes them
    prior : its grid, level and layers are used
    lengths_m : least and largest length; evidence finds none above `FreeMapSettings.smoothest`
    """
    told = np.flatnonzero(sums.normal[:, 0, 0] > 0)
    some = told
    if len(told) > settings.evidence_presses:
        chosen = np.random.default_rng(0).permutation(told)[: settings.evidence_presses]
        some = np.sort(chosen)
    data = FieldData.of(
        sums.some(some), by_field[some], field,
        0.0 if shift is None else shift[some], 0.0 if doubt is None else doubt[some],
    )  # fmt: skip
    least, longest = lengths_m
    bounds = np.log([least, max(settings.smoothest * longest, least)])
    usual_length = np.log(settings.usual_length) + bounds.mean()
    best: dict[float, tuple[float, Hyper]] = {}
    latest = start

    def misfit(log_length: float) -> float:
        nonlocal latest
        unit = replace(prior, length_m=float(np.exp(log_length)), spread=1.0, level_spread=0.0,
                       layer_spread=0.0)  # fmt: skip
        value, latest = _best_sizes(data, unit, prior, latest, settings)
        value += 0.5 * ((log_length - usual_length) / settings.unsure[0]) ** 2
        best[log_length] = (value, latest)
        return value

    if "length_m" in start.given:
        misfit(float(np.log(start.length_m)))
    else:
        minimize_scalar(
            misfit,
            bounds=bounds,
            method="bounded",
            options={"xatol": settings.length_tol, "maxiter": settings.lengths},
        )
    return min(best.values(), key=lambda pair: pair[0])[1]


def _best_sizes(
    data: FieldData,
    unit: MaternField,
    prior: MaternField,
    start: Hyper,
    settings: FreeMapSettings,
) -> tuple[float, Hyper]:
    """Return minus the log evidence and the best spread and error for a prior's length.

    `unit` is the field of spread 1 with that length; level and layers are the prior's.
    """
    root = data.root
    of_field = root.T @ (unit.product(data.by_field) @ data.by_field.T) @ root
    common = root.T @ (prior.common(data.by_field) @ data.by_field.T) @ root
    of_error = root.T @ root
    known = np.eye(len(root)) + common + (root.T * data.error_variance(0.0)) @ root
    usual = np.log([settings.usual_spread, settings.usual_error])
    unsure = np.array(settings.unsure[1:])
    least = np.array([settings.least_spread, settings.least_error])
    most = np.array([settings.largest_spread, settings.largest_error])
    first = np.log(np.clip([start.spread, max(start.error, settings.first_error)], least, most))
    bounds = list(zip(np.log(least), np.log(most), strict=True))
    if "spread" in start.given:
        first[0] = np.log(start.spread)
        bounds[0] = (first[0], first[0])

    def misfit(x: np.ndarray) -> tuple[float, np.ndarray]:
        parts = (np.exp(2 * x[0]) * of_field, np.exp(2 * x[1]) * of_error)
        whole = known + parts[0] + parts[1]
        factor = cho_factor(whole, lower=True)
        weight = cho_solve(factor, data.target)
        inverse = cho_solve(factor, np.eye(len(root)))
        log_det = 2 * float(np.log(np.diag(factor[0])).sum())
        slopes = [float(np.sum(inverse * p) - weight @ p @ weight) for p in parts]
        away = (x - usual) / unsure
        value = 0.5 * (float(data.target @ weight) + log_det + float(away @ away))
        return value, np.array(slopes) + away / unsure

    found = minimize(
        misfit, first, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": settings.size_steps, "ftol": 1e-6},
    )  # fmt: skip
    spread, error = np.exp(found.x).tolist()
    error = 0.0 if error <= settings.least_error * 1.01 else error
    return float(found.fun), Hyper(unit.length_m, spread, error, start.given, unit.smoothness)
