"""`palpmap add` and `palpmap history`: effects added to a study, one version after the other."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.fit.joint_fit import fit_jointly
from identify.residual.statement import length
from identify.select.candidates import fit_with
from identify.select.diagnosis import diagnose
from identify.select.step import Step
from models.errors import InputError
from models.scan_file import read_scan
from palpmap.commands.diagnose import judged
from palpmap.console import Output, to_type
from palpmap.result.explain_record import parameters_of, step_record
from palpmap.result.explain_words import interval, readable
from palpmap.result.history import VersionRecord, read_history, write_history
from palpmap.result.presses_words import counted, left_out_sentences
from palpmap.result.records import ParameterRecord
from palpmap.study.open_study import Problem, catalogue_with, own_effects, pose
from palpmap.study.study import Study, load_study
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
    known = load_study(study)
    own = own_effects(known, effects)
    effect = _effect_to_add(name, study, known, own)
    with output.progress() as progress:
        task = progress.add_task("reading", total=None)

        def say(text: str) -> None:
            progress.update(task, description=text)

        problem = pose(known, own, say)
        before = judged(problem, seed, say)
        score = before.diagnosis[name]
        if score.untestable is not None:
            raise InputError(f"the effect '{name}' cannot be added to {study}: {score.untestable}")
        say(f"fitting map and {name}")
        trial = fit_with(before.fit, effect, score)
        if trial is None:
            raise InputError(f"the effect '{name}' leads to an impossible body with this scan")
        fit = fit_jointly(trial.model, trial.map)
        diagnosis = diagnose(fit, problem.catalogue, seed=seed)
        after = _after(fit, diagnosis, problem)
        progress.update(task, description="done", total=1, completed=1)
    target = next_version(study)
    files = {e.name: path for e, path in zip(own, effects, strict=False)}
    version_of(known, fit, target, files)
    earns = fit.bic < before.fit.bic
    _record(study, target, name, before, after, problem)
    found = parameters_of(after, problem, after.fit.parameters)
    record = {
        "study": str(target),
        "before": step_record(before).to_dict(),
        "after": step_record(after).to_dict(),
        "parameters": {name: p.to_dict() for name, p in found.items()},
        "earns_its_place": earns,
        **counted(problem),
    }
    sentence = effect.evidence(fit.at.values[name], problem.model.readings)
    output.result(
        record,
        *_change_table(before, after, problem, found),
        sentence,
        *([] if earns else [f"{name} does not earn its place: chi-square hardly falls."]),
        *left_out_sentences(record),
        f"Next version: {target}",
        f"Next: {to_type('diagnose', target)}",
    )
    return earns


def _effect_to_add(name: str, study: Path, known: Study, own: Sequence[Effect]) -> Effect:
    """Return the effect, or say why it cannot be added before a minute is spent on fitting."""
    if name.endswith(".py"):
        raise InputError(f"{name}: expected an effect; a file of your own goes with --effect")
    effect = catalogue_with(own)[name]
    if any(entry.name == name for entry in known.effects):
        raise InputError(f"{study}: the study has the effect '{name}' already; add another one")
    readings = Readings.of(read_scan(known.scan, known.study.units_checked))
    reason = effect.untestable(readings)
    if reason is not None:
        raise InputError(f"the effect '{name}' cannot be added to {study}: {reason}")
    return effect


def run_history(*, study: Path, undo: bool, output: Output) -> bool:
    """Show the versions of a study and their errors; `undo` takes the last one back.

    The file of a version that is taken back is kept, renamed to `....undone`.
    """
    load_study(study)
    versions = read_history(study)
    if undo:
        if len(versions) < 2:
            raise InputError(
                f"{study}: there is no version to step back from; `palpmap add` makes one"
            )
        versions, last = versions[:-1], versions[-1]
        file = history_file(study).with_name(last.study)
        if file.is_file():
            file.replace(_unused(file.with_name(file.name + ".undone")))
        write_history(study, versions)
    output.result({"versions": [v.to_dict() for v in versions]}, _history_table(versions))
    return True


def _after(fit: Any, diagnosis: Any, problem: Problem) -> Step:
    from identify.fit.cross_validation import cross_validate
    from identify.residual.compare import compare_residual
    from identify.select.step import whitened_fit

    comparison = compare_residual(whitened_fit(fit, problem.scan))
    return Step(fit, comparison, cross_validate(fit), diagnosis)


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


def _change_table(
    before: Step, after: Step, problem: Problem, new: Mapping[str, ParameterRecord]
) -> tuple["RenderableType", ...]:
    from rich import box
    from rich.table import Table

    error = Table(box=box.SIMPLE, title="the error", title_justify="left")
    for column in ("", "before", "after"):
        error.add_column(column, justify="right" if column else "left")
    pairs = [
        ("rms", before.fit.rms_m, after.fit.rms_m),
        ("cross-validation", before.cross_validation.rms_m, after.cross_validation.rms_m),
        ("noise alone", before.comparison.expected_rms_m, after.comparison.expected_rms_m),
    ]
    for label, was, now in pairs:
        error.add_row(label, length(was, signed=False), length(now, signed=False))
    error.add_row("chi2/dof", f"{before.fit.chi2_per_dof:.3g}", f"{after.fit.chi2_per_dof:.3g}")
    found = Table(box=box.SIMPLE, title="what changed in the map", title_justify="left")
    for column in ("parameter", "before", "after", "95 % interval"):
        found.add_column(column, justify="left" if column == "parameter" else "right")
    old = parameters_of(before, problem)
    for name, p in new.items():
        scale, unit = readable(p.unit)
        earlier = f"{scale * old[name].value:.4g}{unit}" if name in old else "absent"
        now = f"{scale * p.value:.4g}{unit}"
        found.add_row(name, earlier, now, interval(p.to_dict()))
    return error, found


def _history_table(versions: Sequence[VersionRecord]) -> "RenderableType":
    from rich import box
    from rich.table import Table

    if not versions:
        return "No effects were added yet; `palpmap add STUDY EFFECT` adds one."
    table = Table(box=box.SIMPLE, title="the ladder", title_justify="left")
    for column in ("version", "added", "rms", "cross-validation", "chi2/dof"):
        table.add_column(column, justify="left" if column in ("version", "added") else "right")
    for number, v in enumerate(versions):
        added = v.added or ", ".join(v.effects) or "map alone"
        if number and v.origin != versions[number - 1].study:
            added += f" (to {v.origin})"
        table.add_row(
            v.study, added, length(v.rms_m, signed=False),
            length(v.held_out_rms_m, signed=False), f"{v.chi2_per_dof:.3g}",
        )  # fmt: skip
    return table
