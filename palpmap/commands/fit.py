"""`palpmap fit`: the stiffness map that explains a study's scan."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from identify.fit import FitIteration, refuse_without_arviz, write_fit
from identify.optimize import OPTIMIZERS
from models import InputError, scan_findings
from models import without_outliers as cleaned
from palpmap import api
from palpmap.commands.check import SAID, naming
from palpmap.console import Output, to_type
from palpmap.experiment import Experiment, read_study
from palpmap.progress import FIT, FIT_AND_SAMPLE
from palpmap.report.fit_console import summary
from palpmap.result.next_step import after_fit
from palpmap.results import FitResult
from palpmap.run_files.fit_run import FitRun
from palpmap.run_folder import RunFolder
from palpmap.sides import with_sides
from palpmap.study.kept_inputs import refuse_own_folder


def _refuse_samples(experiment: Experiment) -> None:
    """Raise `InputError` before a fit of which no samples could be drawn."""
    if experiment.study.map.kind == "free":
        raise InputError(
            'key uncertainty.samples: a map of kind = "free" is given with its standard deviation '
            "at every place, without samples; remove one of the two keys"
        )
    refuse_without_arviz()


def _sampled(
    fit: FitResult, samples: int, seed: int, run: Path, say: Callable[[str], None]
) -> FitResult:
    """Return the fit with samples, or with the reason against them; Ctrl-C leaves the fit."""
    write_fit(fit, run / "fit.json")
    try:
        fit = fit.sample(samples, seed, say)
    except InputError as error:
        return replace(fit, message=f"{fit.message}; {error}")
    assert fit.posterior is not None
    fit.posterior.write(run / "posterior.nc")
    return fit


def _as_asked(
    study: Path,
    out: Path | None,
    inclusions: int | Literal["auto"] | None,
    samples: int | None,
    without_outliers: bool,
) -> tuple[Experiment, tuple[str, ...]]:
    """Return the study's experiment with its options, and a sentence on each omission."""
    experiment, left_out = read_study(study), ()
    if without_outliers or inclusions is not None or samples is not None:
        refuse_own_folder(study, out)
    if without_outliers:
        scan, left_out = cleaned(experiment.scan)
        experiment = Experiment.of(scan, experiment.study, experiment.source)
    if inclusions is not None:
        experiment = experiment.with_inclusions(inclusions)
    if samples is not None:
        experiment = experiment.with_samples(samples)
    if experiment.study.uncertainty.samples:
        _refuse_samples(experiment)
    return experiment, left_out


def run_fit(
    *,
    study: Path,
    inclusions: int | Literal["auto"] | None,
    optimizer: str,
    out: Path | None,
    seed: int,
    output: Output,
    samples: int | None = None,
    without_outliers: bool = False,
) -> bool:
    """Fit a study's scan, compare, and leave a run folder with recording and report.

    Parameters
    ----------
    study : study file
    inclusions : number of inclusions, "auto", or None for what the study says
    optimizer : name in `identify.optimize.optimizers.OPTIMIZERS`
    out : run folder, None for a new one
    seed : of the samples; the fit itself draws no random numbers
    output : where progress and result go
    samples : from the posterior, None for as many as the study asks for
    without_outliers : leave out readings and presses that `models.scan_quality` doubts

    Returns
    -------
    bool
        Whether the fit converged.
    """
    from rich.markup import escape

    experiment, left_out = _as_asked(study, out, inclusions, samples, without_outliers)
    samples = experiment.study.uncertainty.samples
    settings = {
        "inclusions": experiment.study.map.inclusions,
        "optimizer": optimizer,
        **({"samples": samples} if samples else {}),
        "left_out": list(left_out),
    }
    doubts = [doubt for doubt in scan_findings(experiment.scan) if doubt.leaves_out]
    with naming(doubts), output.task(FIT_AND_SAMPLE if samples else FIT) as task:
        for sentence in (*left_out, *(doubt.sentence for doubt in doubts[:SAID])):
            task.print(sentence, soft_wrap=True)
        experiment.opened(task.say, thin=False)  # what cannot be fitted leaves no run folder
        experiment = with_sides(experiment, task.say)  # the folder keeps them
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
            if samples:
                fit = _sampled(fit, samples, seed, run.path, task.say)
            task.say("comparing and drawing")
            finding = fit_run.finish(fit.finding)
    output.result(
        {**fit.to_dict(), "run": str(run.path), "left_out": list(left_out)},
        *summary(finding, after_fit(finding, study)),
        f"Fit: {escape(fit.message)}",
        f"Report: {escape(str(run / 'report.html'))}",
        f"Recording: {escape(to_type('review', run.path))}",
    )
    return fit.success
