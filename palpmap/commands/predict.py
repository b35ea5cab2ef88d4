"""`palpmap predict`: a scan that the fit has not seen, predicted with bands."""

from pathlib import Path

from palpmap import api
from palpmap.console import Output
from palpmap.experiment import read_study
from palpmap.run_folder import RunFolder


def run_predict(*, run: Path, study: Path, out: Path | None, output: Output) -> bool:
    """Predict a study's scan by the fit of a run, and leave a run folder with the report.

    Returns
    -------
    bool
        Whether the errors are within the bands (the exit code is 1 if not).
    """
    from rich.markup import escape

    known, other = api.read_run(run), read_study(study)
    with output.task() as task:
        found = api.predict(known.fit, other, progress=task.say)
    inputs = [run / "fit.json", run / "study.toml", *other.inputs]
    with RunFolder("predict", out, inputs=inputs) as folder:
        found.write_files(folder.path)
        output.result(
            {**found.to_dict(), "run": str(folder.path)},
            *found.renderables(),
            f"Report: {escape(str(folder / 'report.html'))}",
        )
    return found.holds
