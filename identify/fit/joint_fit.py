"""Fit a map and its effects, none or several, towards the finer model of the body.

The residual is the finer model's by defect correction: the coarse model's compliances are carried
to the finer one's at the estimate (`MeasurementModel.corrected`) and fitted again, until the
estimate no longer moves. Where that would raise the finer model's own chi-square, the map may only
move less far from where the correction was made. A fit starts from an earlier one's estimate, so
that few evaluations do.
"""

import math
from dataclasses import replace

import numpy as np

from fem import SolverError
from identify.fit.free_map_fit import refit_free_map
from identify.fit.gather import fit_result
from identify.fit.result import FitResult
from identify.fit.search import Progress, Search
from identify.fit.settings import SEARCH, TRIAL, FitSettings
from identify.map.free_map import FreeMap
from identify.map.gaussian_map import GaussianMap
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError, OptimizeResult

_HARD, _PLAIN_WEIGHT = 8.0, 4.0  # over the background
_VOID, _PLAIN_SOFT = -0.9, -0.5  # the same of soft ones
_PLAIN_RADIUS, _PLAIN_DEPTH = 1.3, 2.0  # over the tip's radius
_SAME = 0.05  # scaled coordinate: so near its end a search is at the same minimum


def fit_jointly(
    model: MeasurementModel,
    stiffness: GaussianMap,
    *,
    rounds: int | None = None,
    max_evaluations: int | None = None,
    enough: float | None = None,
    target: float | None = None,
    callback: Progress | None = None,
    settings: FitSettings = SEARCH,
) -> FitResult:
    """Fit all free parameters of map and effects.

    A free map is no parameter: it is fitted anew, or without rounds stays beside the effects, of
    which the uncertain map then takes its part (`identify.measurement.map_uncertainty`).

    Parameters
    ----------
    model : its effects start from their own values
    stiffness : map to start from
    rounds, max_evaluations, enough, target : in place of those of the settings
    callback : called with each accepted step

    Raises
    ------
    InadmissibleError
        The start is impossible.
    """
    given = {
        "rounds": rounds,
        "max_evaluations": max_evaluations,
        "enough": enough,
        "target": target,
    }
    settings = replace(settings, **{k: v for k, v in given.items() if v is not None})
    if isinstance(stiffness, FreeMap) and settings.rounds:
        return refit_free_map(model, stiffness, callback)
    return fit_from(Search(settings, progress=callback), model, model.start(stiffness))


def try_fit(model: MeasurementModel, stiffness: GaussianMap, **options) -> FitResult | None:
    """`fit_jointly`, or None where the start is impossible."""
    try:
        return fit_jointly(model, stiffness, **options)
    except InadmissibleError:
        return None


def found_again(fit: FitResult, callback: Progress | None = None) -> FitResult:
    """Refit from plain inclusions where one ended very hard or void, and return the better fit.

    A hard grain or a void far below the surface is a false minimum for an inclusion of ordinary
    size at ordinary depth.
    """
    if not isinstance(fit.map, GaussianMap):
        return fit
    tip_m, plain, void = float(np.median(fit.model.readings.radius_m)), {}, False
    for number, inclusion in enumerate(fit.map.inclusions, 1):
        share = inclusion.weight_pa / fit.map.background_pa
        if share > _HARD or share < _VOID:
            void = void or share < _VOID
            weight = _PLAIN_WEIGHT if share > 0 else _PLAIN_SOFT
            place = _nearer(fit, np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m]), tip_m)
            ordinary = (weight * fit.map.background_pa, *place, _PLAIN_RADIUS * tip_m)
            names = fit.map.names[5 * number - 4 : 5 * number + 1]
            plain |= {n: v for n, v in zip(names, ordinary, strict=True) if n in fit.model.names}
    if not plain:
        return fit
    search = Search(TRIAL, progress=callback)
    search.history = list(fit.history)
    try:
        u = fit.model.start(fit.map.changed(plain))
        # A void is a minimum of the correction that was made there, and of no other
        if not void and _is_same_place(fit, search.minimum(fit.model, u)[0].x):
            return fit
        model = fit.model if fit.model.mechanics.fine is None else search.corrected(fit.model, u)
        other = fit_from(search, model, u)
        if other.chi2 > fit.chi2 - SEARCH.raised * max(fit.chi2_per_dof, 1.0):
            return fit  # another minimum, or the same one
        search = Search(SEARCH, progress=callback)
        search.history = list(other.history)
        other = fit_from(search, other.model, other.u)
    except (InadmissibleError, SolverError):
        return fit
    return fit if other.chi2 > fit.chi2 else other


def _is_same_place(fit: FitResult, u: np.ndarray) -> bool:
    """Whether scaled coordinates u (k,) are within a standard error of a fit."""
    std = np.sqrt(np.diag(fit.covariance_scaled))
    return bool(np.all(np.abs(u - fit.u) <= np.maximum(std, _SAME)))


def _nearer(fit: FitResult, centre_m: np.ndarray, tip_m: float) -> list[float]:
    """Return a place (3,) m towards the nearest press, at most some tip radii below it."""
    points = fit.model.mechanics.coarse.contacts.points_m
    nearest = points[np.linalg.norm(points - centre_m, axis=1).argmin()]
    below = centre_m - nearest
    depth = max(float(np.linalg.norm(below)), 1e-12)
    return (nearest + below * min(1.0, _PLAIN_DEPTH * tip_m / depth)).tolist()


def fit_from(search: Search, model: MeasurementModel, u: np.ndarray) -> FitResult:
    """Fit from scaled coordinates u (k,), as the settings of the search say."""
    s, radius, accepted, near = search.settings, np.inf, 0, False
    fine_chi2: float | None = None  # the finer model's chi-square at u, where it is known
    stale = False  # the correction was made elsewhere than at u: its minimum says nothing
    rough = False  # the correction is one for a search, not for the record
    result, at = search.minimum(model, u)
    if s.rounds == 0:
        result, _ = search.finished(model, result)
        return _ended(search, model, result.x, result, result.success)
    for number in range(1, s.rounds + s.nearer_rounds * s.guarded + 1):
        if number > s.rounds and search.spent > s.most_spent:
            break  # in a rough valley
        try:
            there = search.corrected(model, result.x)
        except (InadmissibleError, SolverError):  # a map that the finer mesh does not resolve
            map_moved = (result.x - u)[: len(model.space.free)]
            radius = s.nearer * float(np.abs(map_moved).max(initial=0.0))
            result, at = search.minimum(model, u, radius)
            continue
        now = search.evaluate(there, result.x)
        raised = s.raised * max(1.0, at.chi2 / len(model.displacement_m))
        if s.guarded and fine_chi2 is None and now.chi2 > at.chi2 + raised:
            before = search.evaluate(model, u).chi2
            model = search.corrected(model, u)
            fine_chi2 = search.evaluate(model, u).chi2
            stale = abs(fine_chi2 - before) > raised
        if (
            s.guarded
            and fine_chi2 is not None
            and now.chi2 > fine_chi2 + (s.ftol if search.is_final else raised)
        ):
            # The correction does not hold so far from where it was made
            map_moved = (result.x - u)[: len(model.space.free)]
            radius = np.inf if stale else s.nearer * float(np.abs(map_moved).max(initial=0.0))
            stale = False
        else:
            fell = np.inf if fine_chi2 is None else fine_chi2 - now.chi2
            u, model, fine_chi2 = result.x, there, now.chi2
            rough = model.mechanics.correction.carried and not search.is_final
            accepted, radius = accepted + 1, 2 * radius
            if s.guarded and near and accepted >= s.rounds and fell < raised:
                break
        result, at = search.minimum(model, u, radius)
        moved = float(np.linalg.norm(at.jacobian @ (result.x - u)))
        misfit = math.sqrt(max(1.0, at.chi2 / len(model.displacement_m)))
        excess = max(result.fun - search.gross(model), 0.0)
        stop = math.sqrt(2 * s.gross_rtol * excess) if s.stops_count else 0.0
        if accepted and moved < max(s.settled * misfit * min(misfit, s.settled_most), stop):
            result, at = search.finished(model, result, radius)
            if not (s.confirmed and rough):
                return _ended(search, model, result.x, result, result.success)
            fine_chi2 = None  # that of the search
        near = moved < misfit
        if not s.guarded and excess and number >= s.gross_rounds:
            break
    return _unsettled(search, model, result.x if not s.guarded else u, result, radius,
                      rough=rough, near=near and accepted >= s.rounds)  # fmt: skip


def _unsettled(
    search: Search,
    model: MeasurementModel,
    u: np.ndarray,
    result: OptimizeResult,
    radius: float,
    *,
    rough: bool,
    near: bool,
) -> FitResult:
    """Return the fit where its rounds ended.

    Parameters
    ----------
    u : scaled coordinates (k,) where they ended
    result, radius : of the last search
    rough : the correction is one for a search, not for the record
    near : the last move was small, after all rounds
    """
    s = search.settings
    if s.confirmed and (rough or not search.is_final):
        search.finish()
        model = search.corrected(model, u) if rough else model
        # Unseen by the finer model, so not far
        result, _ = search.minimum(model, u, s.nearer * radius if s.guarded else np.inf)
        u = result.x
    success = s.guarded and result.success and near
    return _ended(search, model, u, result, success, None if success else "did not settle")


def _ended(
    search: Search,
    model: MeasurementModel,
    u: np.ndarray,
    result: OptimizeResult,
    success: bool,
    correction: str | None = None,
) -> FitResult:
    """Return the record of a fit that ended at u (k,)."""
    ended = f"; the correction towards the finer model {correction}" if correction else ""
    return fit_result(
        model,
        u,
        search.linearise(model, u),
        search.settings,
        success=success,
        message=result.message + ended,
        nfev=search.spent,
        history=tuple(search.history),
    )
