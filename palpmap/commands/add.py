"""`palpmap add` and `palpmap history`: effects added to a study, one version after the other."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from identify.catalogue import CATALOGUE, load_effect
from identify.effects import Effect, Readings
from identify.select import Step
from models import Catalogue, InputError
from palpmap import api
from palpmap.console import Output, to_type
from palpmap.experiment import Experiment, read_study
from palpmap.progress import DIAGNOSE
from palpmap.report.draw import console
from palpmap.result.explain_record import parameters_of, step_record
from palpmap.result.history import VersionRecord, read_history, write_history
from palpmap.result.presses_words import counted, left_out_sentences
from palpmap.result.records import CountRecord
from palpmap.result.tables import ladder_table, parameter_table
from palpmap.study.frame import evidence
from palpmap.study.open_study import Problem
from palpmap.study.study import load_study
from palpmap.study.versions import history_file, next_version, version_of

if TYPE_CHECKING:
    from rich.console import RenderableType


def run_add(*, study: Path, name: str, seed: int, effects: Sequence[Path], output: Output) -> bool:
    """Add an effect to a study, refit all, show the error before and after.

    Writes the next version of the study beside it; nothing is overwritten.

    Returns
    -------
    bool
        Whether the effect earns its place: chi-square falls by more than its parameters cost.

    Raises
    ------
    InputError
        No effect has this name, the study has it already, or the scan cannot show it.
    """
    experiment = read_study(study)
    own = [load_effect(path) for path in effects]
    catalogue = Catalogue((*CATALOGUE, *own, *experiment.own_effects))
    _refuse(name, study, experiment, catalogue)
    with output.task(DIAGNOSE) as task:
        before = api.diagnose(experiment, catalogue, seed=seed, progress=task.say)
        after = before.with_effect(name)
    fit, target = after.step.fit, next_version(study)
    files = {e.name: path for e, path in zip(own, effects, strict=True)}
    earns = fit.bic < before.step.fit.bic
    problem = before.problem
    version_of(experiment.study, fit, target, files)
    try:
        _record(study, target, name, before.step, after.step, problem)
    except OSError:  # a version that the history does not know would be in the way
        target.unlink(missing_ok=True)
        raise
    found = parameters_of(after.step, problem, fit.parameters)
    steps = [step_record(before.step), step_record(after.step)]
    old = parameters_of(before.step, problem)
    record = {
        "study": str(target),
        "before": steps[0].to_dict(),
        "after": steps[1].to_dict(),
        "parameters": {name: p.to_dict() for name, p in found.items()},
        "earns_its_place": earns,
        **counted(problem),
    }
    output.result(
        record,
        console(ladder_table(steps, ("before", "after"), "error")),
        console(parameter_table(found, before=old, title="change of the parameters")),
        evidence(
            catalogue[name],
            fit.at.values[name],
            problem.model.readings,
            problem.experiment.origin_m,
        ),
        *([] if earns else [f"{name} does not earn its place: chi-square hardly falls."]),
        *left_out_sentences(CountRecord(**counted(problem))),
        f"Next version: {target}",
        f"Next: {to_type('diagnose', target)}",
    )
    return earns


def _refuse(name: str, study: Path, experiment: Experiment, catalogue: Catalogue[Effect]) -> None:
    """Refuse an effect that cannot be added, before a minute is spent on fitting."""
    if name.endswith(".py"):
        raise InputError(f"{name}: expected an effect; a file of your own goes with --effect")
    effect = catalogue[name]
    if any(entry.name == name for entry in experiment.study.effects):
        raise InputError(f"{study}: the study has the effect '{name}' already; add another one")
    reason = effect.untestable(Readings.of(experiment.scan))
    if reason is not None:
        raise InputError(f"the effect '{name}' cannot be added to {study}: {reason}")


def run_history(*, study: Path, undo: bool, output: Output) -> bool:
    """Show the versions of a study and their errors; `undo` takes the last one back.

    The file of a version that is taken back is kept, renamed to `....undone`.
    """
    load_study(study)
    versions, said, kept = read_history(study), [], None
    if undo:
        if len(versions) < 2:
            raise InputError(
                f"{study}: there is no version to step back from; `palpmap add` makes one"
            )
        versions, last = versions[:-1], versions[-1]
        file = history_file(study).with_name(last.study)
        if file.is_file():
            kept = file.replace(_unused(file.with_name(file.name + ".undone")))
        write_history(study, versions)
        said = [f"Taken back: {last.study}" + (f", kept as {kept.name}" if kept else "") + "."]
    output.result({"versions": [v.to_dict() for v in versions]}, *said, _history_table(versions))
    return True


def _record(
    study: Path, target: Path, name: str, before: Step, after: Step, problem: Problem
) -> None:
    versions = read_history(study) or (_version(before, problem, study.name),)
    new = _version(after, problem, target.name, added=name, origin=study.name)
    write_history(study, (*versions, new))


def _version(
    step: Step, problem: Problem, study: str, added: str | None = None, origin: str | None = None
) -> VersionRecord:
    known = {**dict(step_record(step)), "parameters": parameters_of(step, problem)}
    return VersionRecord(study=study, added=added, origin=origin, **known)


def _unused(path: Path) -> Path:
    number = 1
    while path.exists():
        number += 1
        path = path.with_name(f"{path.name.rstrip('0123456789')}{number}")
    return path


def _history_table(versions: Sequence[VersionRecord]) -> "RenderableType":
    if not versions:
        return "No effects were added yet; `palpmap add STUDY EFFECT` adds one."
    labels = []
    for number, v in enumerate(versions):
        added = v.added or ", ".join(v.effects) or "map alone"
        if number and v.origin != versions[number - 1].study:
            added += f" (to {v.origin})"
        labels.append(f"{v.study}: {added}")
    return console(ladder_table(versions, labels, "error of each version"))
