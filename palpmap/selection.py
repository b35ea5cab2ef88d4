"""Search for missing effects, for the Python door: diagnose, explain, limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

from identify import PlacedExperiment, Progress, silent
from identify.catalogue import CATALOGUE
from identify.design import BetterScans, assess, better_scans, detection_limits, other_map
from identify.effects import Effect
from identify.fit import FitIteration
from identify.select import Step, kind_of_map, start_fit, step_of
from identify.select import explain as explain_scan
from models import Catalogue, Seed, kinds_checked
from palpmap.experiment import Experiment
from palpmap.selection_results import Diagnosis, Explanation, Limits
from palpmap.sides import with_sides
from palpmap.study.open_study import Problem


def start(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    progress: Progress = silent,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> Problem:
    """Fit the model that diagnosis, explanation and limits start from.

    Parameters
    ----------
    effects : candidates, beside the study's own
    """
    opened = experiment.opened(progress)
    if opened.map.either:
        inclusions = experiment.of_kind("inclusions")
        kind = kind_of_map(opened, inclusions.opened(progress), on_iteration)
        progress(kind.says)
        experiment = experiment.of_kind("free") if kind.free else inclusions
        opened = experiment.opened(progress)
    known = (*effects, *(effect for effect, _ in opened.effects), *experiment.own_effects)
    catalogue = Catalogue({effect.name: effect for effect in known}.values())
    return Problem(**vars(start_fit(opened, catalogue, on_iteration)), study=experiment.study)


@kinds_checked
def diagnose(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    seed: Seed = 0,
    progress: Progress = silent,
) -> Diagnosis:
    """Score every effect that the model may lack, without refitting.

    Parameters
    ----------
    effects : candidates; `(*CATALOGUE, MyEffect())` adds one of your own
    seed : of the simulated null distributions
    progress : called with the present task, in words

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> pm.diagnose(study, [pm.CATALOGUE["contact_offset"]]).significant
    ('contact_offset',)
    """
    experiment = with_sides(experiment, progress)
    problem = start(experiment, effects, progress)
    fit = problem.joint
    step = step_of(fit, problem.scan, problem.catalogue, seed, progress)
    return Diagnosis(experiment, step, problem, seed)


@kinds_checked
def explain(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    seed: Seed = 0,
    progress: Progress = silent,
    on_iteration: Callable[[FitIteration], None] | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> Explanation:
    """Find the effects that a scan lacks: score, refit, add, until the residual is noise.

    Parameters
    ----------
    effects : candidates; `(*CATALOGUE, MyEffect())` adds one of your own
    seed : of the simulated null distributions
    progress : called with the present task, in words
    on_iteration : called with each step of the map's fit
    on_step : called with each new model

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> why = pm.explain(study, [pm.CATALOGUE["contact_offset"]])
    >>> why.verdict, why.added
    ('explained', ('contact_offset',))
    """
    experiment = with_sides(experiment, progress)
    problem = start(experiment, effects, progress, on_iteration)
    found, without, answered = explain_scan(problem, seed, on_step)
    if answered is not problem:  # without presses that stand apart, or an error of the map
        problem = replace(problem, **{f.name: getattr(answered, f.name) for f in fields(answered)})

    def free() -> PlacedExperiment:
        # Of the presses that the inclusions were fitted to: a free map would take more of them
        same = experiment.of_kind("free").of_presses(problem.scan.press_ids)
        return same.opened(progress, noise=problem.experiment.noise)

    other = other_map(found, problem, free)
    most = experiment.study.probe.most_force_n
    assessment = assess(found, problem.catalogue, without, progress, other, most)
    found.final.fit.at.body.forget_other_models()  # hundreds of MB that no picture needs
    return Explanation.of(found, experiment, problem, assessment, seed)


@kinds_checked
def limits(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    plan: bool = False,
    progress: Progress = silent,
) -> Limits:
    """Compute the smallest size at which this scan shows each effect, and its likenesses.

    Parameters
    ----------
    effects : that may be missing
    plan : also seek changed scans that would show smaller effects
    progress : called with the present task, in words

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> (offset,) = pm.limits(study, [pm.CATALOGUE["contact_offset"]])
    >>> 0 < offset.smallest_share < 0.1
    True
    """
    experiment = with_sides(experiment, progress)
    problem = start(experiment, effects, progress)
    fit = problem.joint
    progress("computing what this scan can see")
    found = tuple(detection_limits(fit, problem.catalogue))
    most = experiment.study.probe.most_force_n
    better = BetterScans()
    if plan:
        better = better_scans(fit, problem.catalogue, found, progress, most)
    return Limits(experiment, problem, fit, found, better)
