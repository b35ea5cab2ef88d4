"""The Python door: fit, compare, diagnose, explain, limits, scan, and runs read back.

    import palpmap as pm

    experiment = pm.read_study("study.toml")
    fit = pm.fit(experiment, inclusions=1)
    comparison = pm.compare(fit)
    why = pm.explain(experiment)
    why.write("runs/why")

The commands call the same functions. Progress goes to the given callable; nothing is printed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from identify import Progress, silent
from identify.effects import Readings
from identify.fit import FitIteration, fit_map, read_fit
from identify.map import GaussianMap
from identify.measurement import scan_noise
from identify.optimize import OPTIMIZERS, Optimizer, minimize_gauss_newton
from identify.residual import predict as predict_scan
from identify.residual import run_difference
from identify.select import kind_of_map, refuse_effect, with_effects
from models import (
    Catalogue,
    InputError,
    PressProgram,
    Scan,
    Seed,
    kinds_checked,
    read_program,
    touching,
)
from palpmap.experiment import Experiment, read_study
from palpmap.prediction_results import MapChange, Prediction
from palpmap.result.outline import study_outline
from palpmap.result.records import ExplainRecord
from palpmap.results import Comparison, FitResult, Run
from palpmap.run_folder import refuse_interrupted
from palpmap.selection import diagnose, explain, limits, start
from palpmap.selection_results import Diagnosis, Explanation, Limits
from palpmap.sides import with_sides
from palpmap.study import virtual_lab
from palpmap.study.body import Body
from palpmap.study.faults import naming_study
from palpmap.study.open_study import catalogue_with
from palpmap.study.other_scan import other_key, placed_on_body_of
from palpmap.study.press_plan import plan_presses, reachable
from palpmap.study.truth_file import Truth, refuse_outside

if TYPE_CHECKING:
    from sim.motion import ScanSettings
    from sim.scan import PressResult


@kinds_checked
def fit(
    experiment: Experiment,
    inclusions: int | Literal["auto"] | None = None,
    *,
    optimizer: Optimizer = minimize_gauss_newton,
    progress: Progress = silent,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> FitResult:
    """Find the map that explains a scan, with the effects that the study names.

    Parameters
    ----------
    experiment : scan, body, tip and noise
    inclusions : number of hard or soft inclusions; None takes the study's
    optimizer : one of `identify.optimize.optimizers.OPTIMIZERS`
    progress : called with the present task, in words
    on_iteration : called with each accepted step

    Raises
    ------
    InputError
        Scan and study do not fit together: what, where, and what to do.

    Examples
    --------
    >>> import palpmap as pm
    >>> found = pm.fit(pm.read_study("tests/data/twelve_presses/study.toml"))
    >>> found.success, found.parameters["background_pa"].unit
    (True, 'Pa')
    """
    if not callable(optimizer):
        raise InputError(
            f"optimizer: found {optimizer!r}, expected a function: one of "
            f"identify.optimize.OPTIMIZERS ({', '.join(map(repr, OPTIMIZERS))})"
        )
    experiment = with_sides(experiment.with_inclusions(inclusions), progress)
    opened = experiment.opened(progress, thin=False)
    progress("fitting the map")
    for effect, initial in opened.effects:
        refuse_effect(effect, Readings.of(opened.scan), initial)
    kind = None
    with naming_study(experiment.source):
        if opened.map.either:
            alone = experiment.of_kind("inclusions")
            others = alone.opened(progress, thin=False)
            kind = kind_of_map(opened, others, on_iteration)
            if not kind.free:
                experiment, opened = alone, others
        if kind is not None and kind.free:
            found = kind.fit
        elif opened.effects and opened.map.field is None:
            found = with_effects(opened, on_iteration)
        else:
            found = fit_map(opened, optimizer, on_iteration)
    if kind is not None:
        progress(kind.says)
        found = replace(found, message=f"{found.message}; {kind.says}")
    return FitResult.of(found, experiment, opened.body.note)


@kinds_checked
def compare(fit: FitResult) -> Comparison:
    """Test the residual of a fit for structure along place, force, time and order.

    Examples
    --------
    >>> import palpmap as pm
    >>> comparison = pm.compare(pm.read_run("tests/data/twelve_presses").fit)
    >>> comparison.is_noise, comparison.record.varies_with
    (False, 'force')
    """
    return Comparison(fit, fit.finding.comparison)


@kinds_checked
def predict(fit: FitResult, experiment: Experiment, *, progress: Progress = silent) -> Prediction:
    """Predict a scan that the fit has not seen, with bands, and compare it with the measurement.

    The fitted body and effects are pressed as the other scan was: deeper, at other places, with
    another tip. The other study must state the same body, in its own scan's frame.

    Parameters
    ----------
    fit : made by `fit`, or read back by `read_run`
    experiment : scan and study to be predicted
    progress : called with the present task, in words

    Raises
    ------
    InputError
        The studies state different bodies, or a press does not lie on the body.

    Examples
    --------
    >>> import palpmap as pm
    >>> fit = pm.read_run("tests/data/twelve_presses").fit
    >>> found = pm.predict(fit, fit.experiment)
    >>> found.verdict, found.holds  # the fit has seen these very presses
    ('too wide', True)
    """
    own = fit.experiment
    scan, notes = placed_on_body_of(own.study, experiment.study, experiment.scan)
    known = scan_noise(scan.used(), **experiment.study.noise.model_dump())
    opened = own.opened(progress, thin=len(fit.force_n) != len(touching(own.scan).used()))
    progress("predicting the other scan")
    found = predict_scan(opened, fit, catalogue_with(own.own_effects), scan, known)
    if seen := int(np.sum(np.isin(scan.used().force_n, fit.force_n))):
        notes = (
            *notes,
            f"{seen} of {len(found.scan)} readings were in the fit's own scan: such a prediction "
            "tests the fit less than new presses do.",
        )
    return Prediction.of(found, fit, experiment, notes)


@kinds_checked
def compare_runs(one: FitResult, other: FitResult) -> MapChange:
    """Compare the maps and effects of two fits of one body, in standard errors.

    Raises
    ------
    InputError
        The studies state different bodies (a modulus depends on the height and on Poisson's ratio
        that it was found with), or the bodies share no place.

    Examples
    --------
    >>> import palpmap as pm
    >>> fit = pm.read_run("tests/data/twelve_presses").fit
    >>> pm.compare_runs(fit, fit).to_dict()["ratio"]
    1.0
    """
    studies = [fit.experiment.study for fit in (one, other)]
    if (found := other_key(*studies)) is not None:
        key, here, there = found
        raise InputError(
            f"the two runs' studies state different bodies: {key} is {here} in the one and {there} "
            "in the other; a modulus depends on it, so that a difference of the maps would be none "
            "of the body: correct one of the studies and fit it again"
        )
    low, high = (np.array([box.lower_m, box.upper_m]) for box in map(study_outline, studies))
    catalogue = Catalogue(
        {e.name: e for f in (other, one) for e in catalogue_with(f.experiment.own_effects)}.values()
    )
    try:
        found = run_difference(one, other, low, high, catalogue)
    except ValueError as error:
        raise InputError(str(error)) from error
    notes = ()
    if seen := int(np.sum(np.isin(other.force_n, one.force_n))):
        notes = (
            f"{seen} of {len(other.force_n)} readings of the other run were fitted in the one, "
            "too: both maps share their errors, and the standard errors hold for scans apart.",
        )
    return MapChange(one, other, found, notes)


@kinds_checked
def scan(
    body: Body | None = None,
    program: PressProgram | str | Path | None = None,
    *,
    map: GaussianMap | None = None,
    arm: ScanSettings | None = None,
    plant: Sequence[tuple[str, float]] = (),
    presses: int | None = None,
    tips: str | None = None,
    seed: Seed = 0,
    on_press: Callable[[PressResult], None] | None = None,
) -> Scan:
    """Press on a virtual body with the simulated arm.

    Parameters
    ----------
    body : any that a study can state; None is the built-in phantom's block
    program : presses with a flat tip, in the order in which they are made and in the frame of the
        scan, or a file of them; None is the default grid
    map : true map, in the body's frame; None scales the phantom's into a block, and is drawn by
        the seed for other bodies
    arm : times, speeds, noise and sampling of the robot
    plant : names of effects to plant in the robot's loop, with their sizes, rms(with -
        without)/rms(without); of faults, with the share of presses; of files of hooks (.py)
    presses : number of presses that cover the upper surface evenly, in place of a program; made
        with less force where they would go too deep
    tips : that take turns, as "3,10" or "flat:3,ball:8", radii in mm; not with a program
    seed : of noise and pauses, in place of the arm's own
    on_press : called after each press with all its samples and its quality

    Returns
    -------
    Scan
        Readings in the frame of the program, of the presses that were made; a warning tells how
        many were not, and why the first.

    Raises
    ------
    InputError
        No press can be made (or some cannot, with `on_fault="stop"`), the laboratory has no such
        body, or there is no such effect.

    Examples
    --------
    >>> import palpmap as pm
    >>> made = pm.scan(
    ...     pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45),
    ...     pm.grid_program((0.08, 0.08, 0.04), per_side=2, force_n=0.2),
    ...     map=pm.GaussianMap(8000.0),
    ...     arm=pm.ScanSettings(force_noise_n=0.002),
    ... )
    >>> made.press_ids.tolist(), round(float(made.force_n.max()), 1)
    ([0, 1, 2, 3], 0.2)
    """
    from sim.motion import ScanSettings, read_tips
    from sim.scan import refuse_plants

    refuse_plants(plant)
    study = virtual_lab.default_study()
    study = study if body is None else study.model_copy(update={"body": body})
    if program is not None and (presses is not None or tips is not None):
        raise InputError("a program has its own places and radii: leave out presses and tips")
    carried = read_tips(tips) if tips else ()
    if program is not None and not isinstance(program, PressProgram):
        program = read_program(program, seed)
    plan = plan_presses(study, program=program, presses=presses, tips=carried, seed=seed)
    truth = None
    if map is not None:
        refuse_outside(map.inclusions, study, "map.inclusions", scans=False)
        truth = virtual_lab.truth_of(map, np.zeros(3))
    settings = replace(arm or ScanSettings(), seed=seed)
    plan, motion = reachable(plan, settings)
    laboratory = virtual_lab.build_laboratory(
        study, plan, settings, plant, truth and Truth(truth), motion
    ).within_depth()
    run, made = laboratory.press(on_press=on_press and (lambda result, _: on_press(result)))
    missing = [outcome.sentence for outcome in run.outcomes if not outcome.delivered]
    if missing:
        warnings.warn(
            f"{len(missing)} of {len(run.outcomes)} presses are not in the scan. {missing[0]}",
            stacklevel=2,
        )
    return made


@kinds_checked
def read_run(folder: str | Path) -> Run:
    """Read a run folder that `fit`, `explain` or a `write()` left.

    Raises
    ------
    InputError
        The folder has no fit, one of another run than its study, or a file in it is broken.

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.read_run("tests/data/twelve_presses").fit.success
    True
    """
    folder = Path(folder)
    for name in ("fit.json", "study.toml"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: found no {name}, expected a run folder with a fit; make one with "
                "`palpmap fit STUDY --out RUN`"
            )
    refuse_interrupted(folder)
    experiment = read_study(folder / "study.toml")
    result = folder / "result.json"
    found = ExplainRecord.read(result) if result.is_file() else None
    return Run(folder, experiment, FitResult.of(read_fit(folder / "fit.json"), experiment), found)


__all__ = [
    "Comparison", "Diagnosis", "Explanation", "FitResult", "Limits", "MapChange", "Prediction",
    "Run", "compare", "compare_runs", "diagnose", "explain", "fit", "limits", "predict", "read_run",
    "scan", "start",
]  # fmt: skip
