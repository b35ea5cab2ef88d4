"""`palpmap diagnose`: every effect of the catalogue scored from the present fit."""

from collections.abc import Sequence
from pathlib import Path

from identify.catalogue import CATALOGUE, load_effect
from palpmap import api
from palpmap.console import Output, plain
from palpmap.experiment import read_study
from palpmap.progress import DIAGNOSE
from palpmap.result.next_step import after_diagnosis
from palpmap.run_folder import RunFolder


def run_diagnose(
    *, study: Path, out: Path | None, seed: int, effects: Sequence[Path], output: Output
) -> bool:
    """Score the catalogue on a study's scan; write diagnosis.json into a run folder.

    Returns
    -------
    bool
        Whether nothing is missing: the residual is noise and no effect is supported.
    """
    experiment = read_study(study)
    own = [load_effect(path) for path in effects]
    with RunFolder("diagnose", out, seed=seed, inputs=[*experiment.inputs, *effects]) as run:
        with output.task(DIAGNOSE) as task:
            found = api.diagnose(experiment, (*CATALOGUE, *own), seed=seed, progress=task.say)
        found.record.write(run / "diagnosis.json")
        is_noise = found.is_noise and not found.significant
        statement, *evidence = found.renderables()
        output.result(
            {**found.to_dict(), "run": str(run.path)},
            statement,
            *plain(after_diagnosis(is_noise, study)),
            *evidence,
            *plain([f"Diagnosis: {run / 'diagnosis.json'}"]),
        )
    return is_noise
