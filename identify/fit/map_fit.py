"""Fit a stiffness map to a scan: displacement given force, with noise in both columns.

The model of a row is d = C_j(theta) F with the compliance C_j of the row's press, whatever its
phase, unless the contact of a ball grows; both noises enter as in
`identify.measurement.errors_in_variables`. Without a given start, several are tried and the least
chi-square wins.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem import PalpationModel, SolverError
from identify.body.compliance import compliance
from identify.body.discretization_error import FineModel
from identify.body.mechanics import BodyMechanics
from identify.effects.readings import Readings
from identify.fit.joint_fit import fit_from, found_again
from identify.fit.result import FitResult
from identify.fit.search import Progress, Search
from identify.fit.settings import PRECISE, FitSettings
from identify.map.gaussian_map import GaussianMap
from identify.map.initial_guess import REFERENCE_PA, apparent_modulus, scaled, start_maps
from identify.map.parameters import ParameterSpace, parameter_space
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise, scan_noise
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.optimizers import Optimizer
from identify.optimize.result import InadmissibleError
from models import InputError, Scan


def fit_scan(
    scan: Scan,
    model: PalpationModel,
    *,
    inclusions: int = 1,
    noise: Noise | None = None,
    fine_model: FineModel | None = None,
    search_model: PalpationModel | None = None,
    start: GaussianMap | None = None,
    free: Sequence[str] | None = None,
    straight: bool = True,
    optimizer: Optimizer = minimize_gauss_newton,
    callback: Progress | None = None,
    settings: FitSettings = PRECISE,
) -> FitResult:
    """Find the map that explains a scan.

    Parameters
    ----------
    scan
        The measured table; rows of approach and retract are left out.
    model
        Finite element model whose contacts are the scan's presses, in the order of
        `scan.press_ids`.
    inclusions
        Number of Gaussian inclusions; ignored where `start` is given.
    noise
        Standard deviations of both columns; None estimates them from the scan's ramps.
    fine_model
        The same presses on a finer mesh, or extrapolated from two, for the defect correction.
        Without it the intervals hold the noise only, not the mesh's error.
    search_model
        The same presses on a quicker and rougher model (without the near field of the presses,
        say), by which starts are ranked; corrected to `model` for the homogeneous body.
    start
        The one map to start from, in place of those that the scan suggests.
    free
        Names of the parameters to be found, None for all; the others stay at `start`.
    straight
        The readings are straight lines, also under a ball; else its contact grows, and a `start`
        is needed.
    optimizer
        One of `identify.optimize.optimizers.OPTIMIZERS`; intervals take Gauss-Newton.
    callback
        Called with each accepted iteration of the start that is kept.
    settings
        Accuracy, rounds of correction, kind of intervals.

    Raises
    ------
    InputError
        Where scan, model and options do not fit together.
    """
    rows = scan.used()
    _refuse_other_presses(len(rows.press_ids), model, fine_model, search_model)
    if free is not None and start is None:
        raise InputError("fixed parameters need values: give the map to start from")
    box = model.mesh.box_m
    reference = GaussianMap(REFERENCE_PA)
    mechanics = BodyMechanics.of(model, fine_model)
    if not straight:
        mechanics = mechanics.following_growth()
    whole = MeasurementModel(
        Readings.of(rows),
        rows.displacement_m,
        noise or scan_noise(rows),
        mechanics,
        parameter_space(start or reference, box, free, model.probed_m),
        straight=straight,
    )
    if fine_model is None:
        settings = replace(settings, rounds=0)
    search = Search(settings, optimizer, callback)
    if start is not None:
        u = whole.start(start)
        return fit_from(search, _corrected(search, whole, u), u)
    homogeneous, quick = compliance(model, reference), mechanics
    if search_model is not None:
        ratio = homogeneous / compliance(search_model, reference)
        quick = BodyMechanics.of(search_model, ratio=ratio)
    apparent = apparent_modulus(
        whole.table.slope, rows.contact_points, rows.contact_directions, homogeneous
    )
    maps = start_maps(
        apparent, model.probed_m, inclusions, settings.start_depths, settings.start_radii
    )
    ranked = _ranked(replace(whole, mechanics=quick), maps)
    search.spent += len(maps)
    return found_again(fit_from(search, *_from_best(search, whole, ranked)), callback)


def _corrected(search: Search, model: MeasurementModel, u: np.ndarray) -> MeasurementModel:
    """Return the model carried to the finer one at the start u (k,), where that is possible.

    The coarse model's own minimum may be a hard grain that its mesh does not resolve, from which no
    correction made there leads back.
    """
    if model.mechanics.fine is None:
        return model
    try:
        return search.corrected(model, u)
    except (InadmissibleError, SolverError):
        return model


def _refuse_other_presses(
    presses: int,
    model: PalpationModel,
    fine_model: FineModel | None,
    search_model: PalpationModel | None,
) -> None:
    """Raise `InputError` unless all models have the presses of the scan."""
    named = {"model": model, "fine_model": fine_model, "search_model": search_model}
    for name, given in named.items():
        if given is not None and len(given.contacts) != presses:
            raise InputError(
                f"the {name} has {len(given.contacts)} contacts, the scan {presses} presses: "
                "build the model from the scan's contact points"
            )


def _ranked(model: MeasurementModel, maps: Sequence[GaussianMap]) -> list[GaussianMap]:
    """Return the maps that a model admits, each with its best common factor, the best one first."""
    tried = []
    for stiffness in maps:
        try:
            found = model.mechanics.evaluate(stiffness, model.mechanics.state()).compliance
        except InadmissibleError:
            continue
        # The best common factor of all moduli is known without another solve.
        factor = model.table.common_factor(found, model.noise)
        if factor > 0:
            residual, _ = model.table.residuals(found / factor, model.noise)
            tried.append((float(np.sum(residual**2)), scaled(stiffness, factor)))
    if not tried:
        raise InputError(
            "no map explains the scan even roughly: check the signs and units of force_n and "
            "displacement_m"
        )
    return [stiffness for _, stiffness in sorted(tried, key=lambda pair: pair[0])]


def _from_best(
    search: Search, model: MeasurementModel, ranked: Sequence[GaussianMap]
) -> tuple[MeasurementModel, np.ndarray]:
    """Follow the best few starts a little; return the model and the coordinates of the best end.

    The search continues the history of that one. The model is carried to the finer one at the best
    start: the error of a rough mesh would draw the search to a hard grain.
    """
    s, coarse = search.settings, model.mechanics.coarse

    def space(stiffness: GaussianMap) -> ParameterSpace:
        return parameter_space(stiffness, coarse.mesh.box_m, probed=coarse.probed_m)

    kept = list(ranked[: s.kept_starts])
    # A body with hard and soft spots: a start with a wrong sign never comes back from it
    kept += [stiffness for stiffness in ranked[s.kept_starts :] if _is_mixed(stiffness)][:1]
    model = replace(model, space=space(kept[0]))
    model = _corrected(search, model, model.start(kept[0]))
    followed = []
    for stiffness in kept:
        most = s.start_evaluations * max(2 * len(stiffness.inclusions) - 1, 1)
        short = Search(replace(s.following, max_evaluations=most), search.optimizer)
        trial = replace(model, space=space(stiffness))
        end, _ = short.minimum(trial, trial.start(stiffness))
        followed.append((short, trial, end))
    best, trial, end = min(followed, key=lambda one: one[2].fun)
    search.continue_from(best)
    search.spent += sum(short.spent for short, _, _ in followed)
    return trial, end.x


def _is_mixed(stiffness: GaussianMap) -> bool:
    """Whether a map has hard and soft inclusions."""
    return len({inclusion.weight_pa > 0 for inclusion in stiffness.inclusions}) > 1
