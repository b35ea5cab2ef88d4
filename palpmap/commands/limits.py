"""`palpmap limits`: the smallest effects that a scan shows, and scans that would show more."""

from collections.abc import Sequence
from pathlib import Path

from identify.catalogue import CATALOGUE, load_effect
from palpmap import api
from palpmap.console import Output, plain
from palpmap.experiment import read_study
from palpmap.progress import LIMITS
from palpmap.run_folder import RunFolder


def run_limits(
    *, study: Path, out: Path | None, effects: Sequence[Path], plan: bool, output: Output
) -> bool:
    """Print the detection limits of a study's scan; write limits.json into a run folder.

    Parameters
    ----------
    plan : also compute the limits of changed scans
    """
    experiment = read_study(study)
    own = [load_effect(path) for path in effects]
    with RunFolder("limits", out, inputs=[*experiment.inputs, *effects]) as run:
        with output.task(LIMITS) as task:
            found = api.limits(experiment, (*CATALOGUE, *own), plan=plan, progress=task.say)
        found.leave(run.path)
        output.result(
            {**found.to_dict(), "run": str(run.path)},
            *found.renderables(),
            *plain([f"Detection limits: {run / 'limits.json'}"]),
        )
    return True
