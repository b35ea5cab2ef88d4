"""`palpmap explain`: find what a study lacks, unattended, until what is left is noise."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from identify.design.assessment import Assessment, assess
from identify.effects.base import Effect
from identify.select.forward_selection import Explanation
from identify.select.outlying_presses import WithoutSuspects, explain, suspects_left
from identify.select.step import Step
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.console import Output, to_type
from palpmap.report.explain_console import explain_summary, step_line
from palpmap.result.explain_record import explain_record
from palpmap.result.next_scan import next_lines, write_programs
from palpmap.result.records import ExplainRecord
from palpmap.run_folder import RunFolder
from palpmap.study.kept_inputs import keep_inputs, refuse_own_folder
from palpmap.study.open_study import Problem, own_effects, pose
from palpmap.study.study import Study, load_study
from palpmap.study.versions import version_of


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
    refuse_own_folder(study, out)
    own = own_effects(known, effects)
    inputs = [study, known.scan, *effects]
    with RunFolder("explain", out, seed=seed, inputs=inputs) as run:
        scan = read_scan(known.scan, known.study.units_checked)
        kept = keep_inputs(known, scan, run.path)
        explained, problem, assessment, without = explain_study(known, own, seed, output, scan)
        files = {effect.name: path for effect, path in zip(own, effects, strict=False)}
        record = write_explanation(
            run.path, problem, explained, assessment, kept, files, without
        ).to_dict()
        output.result(
            {**record, "run": str(run.path)},
            *explain_summary(record, explained, problem),
            *next_lines(record, run.path),
            f"Report: {run / 'report.html'}",
            f"Recording: {to_type('review', run.path)}",
        )
    return explained.verdict in ("nothing_missing", "explained")


def explain_study(
    study: Study,
    own: Sequence[Effect],
    seed: int,
    output: Output,
    measured: Scan | None = None,
) -> tuple[Explanation, Problem, Assessment, WithoutSuspects | None]:
    """Run the loop on a study with progress shown.

    Returns
    -------
    explanation, problem, assessment, and the result without outlying presses if there are any
    """
    with output.progress() as progress:
        task = progress.add_task("reading", total=None)

        def say(text: str) -> None:
            progress.update(task, description=text)

        def on_step(rung: Step) -> None:
            if not output.quiet and not output.json:
                progress.console.print(step_line(rung), highlight=False)

        problem = pose(study, own, say, lambda step: progress.advance(task), measured=measured)
        explained, without = explain(problem, seed, on_step)
        left = suspects_left(explained, without)
        assessment = assess(explained, problem.catalogue, left, say)
        progress.update(task, description="done", total=1, completed=1)
    return explained, problem, assessment, without


def write_explanation(
    run: Path,
    problem: Problem,
    explained: Explanation,
    assessment: Assessment,
    kept: Study,
    files: Mapping[str, Path] | None = None,
    without: WithoutSuspects | None = None,
) -> ExplainRecord:
    """Write result.json, next scans, the explained study, report and recording into a run folder.

    `kept` is the study that names the run folder's own copies, `files` are those of the user's own
    effects, by name; `without` is what the loop finds without presses that stand out.
    """
    from palpmap.commands.write_explain_run import write_explain_files

    record = explain_record(explained, problem, assessment, without)
    write_programs(assessment, problem.experiment.origin_m, run)
    record.write(run / "result.json")
    version_of(kept, explained.final.fit, run / "study.toml", files)
    write_explain_files(run, problem, explained, record.to_dict())
    return record
