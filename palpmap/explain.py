"""`palpmap explain`: find the missing effects of a study, unattended, until what is left is noise."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from identify.effects.effect import Effect
from identify.effects.user_effect import load_effect
from identify.explain import Explanation, Rung, climb
from palpmap.console import Output, to_type
from palpmap.explain_record import explain_record
from palpmap.explain_summary import explain_summary, rung_line
from palpmap.problem import Problem, pose
from palpmap.run_folder import RunFolder, write_record
from palpmap.study import Study, load_study
from palpmap.study_versions import version_of


def run_explain(
    *,
    study: Path,
    out: Path | None,
    seed: int,
    effects: Sequence[Path] = (),
    output: Output,
) -> bool:
    """Explain a study's scan and leave a run folder with result.json, report and recording.

    Parameters
    ----------
    study : study file
    out : run folder, None for a new one
    seed : of the simulated nulls
    effects : files of the user's own effects; they are executed
    output : where progress and result go

    Returns
    -------
    bool
        Whether the scan is explained, or nothing is missing.
    """
    known = load_study(study)
    own = own_effects(known, effects)
    inputs = [study, known.scan, *effects]
    with RunFolder("explain", out, seed=seed, inputs=inputs) as run:
        explained, problem = explain_study(known, own, seed, output)
        record = write_explanation(run.path, problem, explained, study)
        output.result(
            {**record, "run": str(run.path)},
            *explain_summary(record, explained, problem),
            f"Report: {run / 'report.html'}",
            f"Recording: {to_type('review', run.path)}",
        )
    return explained.verdict in ("nothing_missing", "explained")


def own_effects(study: Study, files: Sequence[Path]) -> list[Effect]:
    """Return the user's effects that a command or a study names; their files are executed."""
    named = [entry.file for entry in study.effects if entry.file is not None]
    return [load_effect(path) for path in dict.fromkeys(p.resolve() for p in [*files, *named])]


def explain_study(
    study: Study, own: Sequence[Effect], seed: int, output: Output
) -> tuple[Explanation, Problem]:
    """Run the loop on a study with progress shown; return what it found and what it worked on."""
    with output.progress() as progress:
        task = progress.add_task("reading", total=None)

        def say(text: str) -> None:
            progress.update(task, description=text)

        def on_rung(rung: Rung) -> None:
            if not output.quiet and not output.json:
                progress.console.print(rung_line(rung), highlight=False)

        problem = pose(study, own, say, lambda step: progress.advance(task))
        explained = climb(
            problem.model,
            problem.start,
            problem.scan,
            problem.catalogue,
            seed=seed,
            progress=say,
            on_rung=on_rung,
        )
        progress.update(task, description="done", total=1, completed=1)
    return explained, problem


def write_explanation(
    run: Path, problem: Problem, explained: Explanation, source: Path
) -> dict[str, Any]:
    """Write result.json, the explained study, report and recording into a run folder."""
    from palpmap.explain_files import write_explain_files

    record = explain_record(explained, problem)
    write_record(run / "result.json", record)
    version_of(problem.study, explained.final.fit, run / "study.toml")
    write_explain_files(run, problem, explained, record)
    return record
