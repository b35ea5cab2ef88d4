"""`palpmap fit`: the stiffness map that explains a study's scan."""

from pathlib import Path
from typing import Literal

from identify.fit import FitIteration
from identify.optimize import OPTIMIZERS
from palpmap import api
from palpmap.console import Output, to_type
from palpmap.experiment import read_study
from palpmap.report.fit_console import summary
from palpmap.run_files.fit_run import FitRun
from palpmap.run_folder import RunFolder
from palpmap.study.kept_inputs import refuse_own_folder


def run_fit(
    *,
    study: Path,
    inclusions: int | Literal["auto"] | None,
    optimizer: str,
    out: Path | None,
    seed: int,
    output: Output,
) -> bool:
    """Fit a study's scan, compare, and leave a run folder with recording and report.

    Parameters
    ----------
    study : study file
    inclusions : number of inclusions, "auto", or None for what the study says
    optimizer : name in `identify.optimize.optimizers.OPTIMIZERS`
    out : run folder, None for a new one
    seed : recorded; the fit itself draws no random numbers
    output : where progress and result go

    Returns
    -------
    bool
        Whether the fit converged.
    """
    from rich.markup import escape

    experiment = read_study(study)
    if inclusions is not None:
        refuse_own_folder(study, out)
        experiment = experiment.with_inclusions(inclusions)
    settings = {"inclusions": experiment.study.map.inclusions, "optimizer": optimizer}
    with output.task() as task:
        experiment.opened(task.say, thin=False)  # what cannot be fitted leaves no run folder
        with (
            RunFolder("fit", out, seed=seed, settings=settings, inputs=experiment.inputs) as run,
            FitRun(run.path, experiment, seed) as fit_run,
        ):

            def on_iteration(step: FitIteration) -> None:
                fit_run.record(step)
                task.advance()

            fit = api.fit(
                experiment,
                optimizer=OPTIMIZERS[optimizer],
                progress=task.say,
                on_iteration=on_iteration,
            )
            task.say("comparing and drawing")
            finding = fit_run.finish(fit.finding)
    output.result(
        {**fit.to_dict(), "run": str(run.path)},
        *summary(finding),
        f"Fit: {escape(fit.message)}",
        f"Report: {escape(str(run / 'report.html'))}",
        f"Recording: {escape(to_type('review', run.path))}",
    )
    return fit.success
