"""`palpmap diagnose`: every effect of the catalogue scored from the present fit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.fit.joint_fit import fit_jointly
from identify.residual.statement import length
from identify.select.diagnosis import Diagnosis
from identify.select.step import Step, step_of
from palpmap.console import Output
from palpmap.result.explain_record import candidate_record, parameters_of, step_record
from palpmap.result.presses_words import counted, left_out_sentences
from palpmap.result.records import DiagnosisRecord
from palpmap.run_folder import RunFolder
from palpmap.study.open_study import Problem, own_effects, pose
from palpmap.study.study import load_study

if TYPE_CHECKING:
    from rich.console import RenderableType

WORDS = {
    "supported": "supported",
    "not_seen": "not seen",
    "indistinguishable": "alike",
}


def run_diagnose(
    *, study: Path, out: Path | None, seed: int, effects: Sequence[Path], output: Output
) -> bool:
    """Score the catalogue on a study's scan; write diagnosis.json into a run folder.

    Returns
    -------
    bool
        Whether nothing is missing: the residual is noise and no effect is supported.
    """
    known = load_study(study)
    own = own_effects(known, effects)
    with RunFolder("diagnose", out, seed=seed, inputs=[study, known.scan, *effects]) as run:
        with output.progress() as progress:
            task = progress.add_task("reading", total=None)

            def say(text: str) -> None:
                progress.update(task, description=text)

            problem = pose(known, own, say)
            rung = judged(problem, seed, say)
            progress.update(task, description="done", total=1, completed=1)
        found = diagnosis_record(rung, problem)
        found.write(run / "diagnosis.json")
        record = found.to_dict()
        output.result(
            {**record, "run": str(run.path)},
            *diagnosis_table(record, rung),
            *left_out_sentences(record),
        )
    return rung.comparison.is_noise and not rung.diagnosis.significant


def judged(problem: Problem, seed: int, say: Any) -> Step:
    """Fit a problem's model and judge what is left."""
    fit = fit_jointly(problem.model, problem.start)
    return step_of(fit, problem.scan, problem.catalogue, seed, say)


def diagnosis_record(rung: Step, problem: Problem) -> DiagnosisRecord:
    """Return fit, residual and candidates as the record of diagnosis.json."""
    return DiagnosisRecord(
        **{
            **dict(step_record(rung)),
            **counted(problem),
            "parameters": parameters_of(rung, problem),
            "candidates": tuple(
                candidate_record(rung.diagnosis.effect_verdict(score.name), problem)
                for score in rung.diagnosis.scores
            ),
        }
    )


def diagnosis_table(record: dict[str, Any], rung: Step) -> tuple["RenderableType", ...]:
    """Return the candidates, best first, as rich renderables that fit a screen."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    style = "green" if rung.comparison.is_noise else "yellow"
    table = Table(box=box.SIMPLE, title="effects, by their score", title_justify="left")
    for name in ("effect", "", "share", "p", "alike"):
        table.add_column(name, justify="right" if name in ("share", "p") else "left")
    for c in record["candidates"]:
        if c["untestable"]:
            continue
        verdict = WORDS[c["verdict"]]
        colour = {"supported": "green", "alike": "yellow"}.get(verdict, "dim")
        # The share of what is left says nothing where noise may have made it
        share = f"{100 * c['explained_fraction']:.0f} %" if verdict != "not seen" else ""
        alike = ", ".join(c["confused_with"][:3])
        table.add_row(c["name"], Text(verdict, style=colour), share, f"{c['p_value']:.1g}", alike)
    lines: list[RenderableType] = [Text(rung.comparison.statement, style=style), table]
    lines.extend(untestable_lines(record["candidates"]))
    best = best_evidence(record, rung.diagnosis)
    if best:
        lines.append(Text(best))
    else:
        size = length(rung.fit.rms_m, signed=False)
        lines.append(Text(f"No effect of the catalogue is seen (rms {size})."))
    return tuple(lines)


def untestable_lines(
    candidates: Sequence[Mapping[str, Any]], start: str = "Cannot be tested"
) -> tuple[str, ...]:
    """Return a sentence for each reason why effects cannot be tested on a scan.

    Examples
    --------
    >>> untestable_lines([{"name": "breathing", "untestable": "the scan has no time stamps"}])
    ('Cannot be tested, as the scan has no time stamps: breathing.',)
    """
    names: dict[str, list[str]] = {}
    for candidate in candidates:
        if candidate["untestable"]:
            names.setdefault(candidate["untestable"], []).append(candidate["name"])
    return tuple(f"{start}, as {why}: {', '.join(n)}." for why, n in names.items())


def best_evidence(record: dict[str, Any], diagnosis: Diagnosis) -> str:
    """Return the evidence of the best-scored effect, with what looks like it; empty for none."""
    best = diagnosis.scores[0] if diagnosis.scores else None
    if best is None or best.name not in diagnosis.significant:
        return ""
    candidate = next(c for c in record["candidates"] if c["name"] == best.name)
    alike = [n for n in candidate["confused_with"] if n in diagnosis.significant]
    candidates = f" ({', '.join(alike)} would look much the same: `palpmap explain` decides)"
    return f"Best: {best.name}. {candidate['evidence']}{candidates if alike else ''}"
