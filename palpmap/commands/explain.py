"""`palpmap explain`: the effects missing in a study, found unattended."""

from collections.abc import Sequence
from pathlib import Path

from identify.catalogue import CATALOGUE, load_effect
from identify.select import Step
from models import scan_findings
from palpmap import api
from palpmap.commands.check import SAID, naming
from palpmap.console import Output, plain, to_type
from palpmap.experiment import read_study
from palpmap.progress import EXPLAIN
from palpmap.report.explain_console import explain_summary, step_line
from palpmap.result.next_step import next_steps
from palpmap.run_folder import RunFolder
from palpmap.study.kept_inputs import keep_inputs, refuse_own_folder


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
    experiment = read_study(study)
    refuse_own_folder(study, out)
    own = [load_effect(path) for path in effects]
    inputs = [*experiment.inputs, *effects]
    with RunFolder("explain", out, seed=seed, inputs=inputs) as run:
        kept = keep_inputs(experiment.study, experiment.scan, run.path)
        doubts = scan_findings(experiment.scan)
        with naming(doubts), output.task(EXPLAIN) as task:
            if not output.quiet:
                for doubt in doubts[:SAID]:
                    task.print(doubt.sentence, markup=False, highlight=False, soft_wrap=True)

            def on_step(step: Step) -> None:
                if not output.quiet and not output.json:
                    task.print(step_line(step), highlight=False)

            why = api.explain(
                experiment,
                (*CATALOGUE, *own),
                seed=seed,
                progress=task.say,
                on_iteration=task.advance,
                on_step=on_step,
            )
        kept = keep_inputs(why.experiment.study, experiment.scan, run.path)  # with the sides found
        files = {effect.name: path for effect, path in zip(own, effects, strict=True)}
        following = next_steps(why.record, why, why.problem, run.path, study)
        why.leave(run.path, kept, files)
        output.result(
            {**why.to_dict(), "run": str(run.path)},
            *explain_summary(why.record, why, why.problem, following),
            *plain([f"Report: {run / 'report.html'}", f"Recording: {to_type('review', run.path)}"]),
        )
    return why.verdict in ("nothing_missing", "explained")
