"""`palpmap demo`: scan, identify, compare on the virtual laboratory, in one run folder."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from identify.fit import FitIteration
from models import read_scan
from palpmap import api
from palpmap.commands.scan import PAPER_FORCE_N, make_scan, planned_laboratory, scan_settings
from palpmap.console import Output, to_type
from palpmap.experiment import Experiment
from palpmap.progress import DEMO
from palpmap.recording.recorder import Recording
from palpmap.report.fit_console import summary
from palpmap.report.scan_console import scan_table
from palpmap.result.finding import Finding
from palpmap.result.outline import study_outline
from palpmap.result.scan_record import ScanRecord, scan_record
from palpmap.result.truth import matched
from palpmap.results import FitResult
from palpmap.run_files.fit_run import finish_fit, record_step, with_making
from palpmap.run_folder import RunFolder
from palpmap.study.press_plan import DEFAULT_FORCE_N, plan_presses
from palpmap.study.virtual_lab import default_study

#: Largest deviation of a found parameter from the truth: relative, or in m, by the name's ending.
TOLERANCES = {
    "background_pa": ("relative", 0.02),
    "weight_pa": ("relative", 0.15),
    "x_m": ("absolute", 0.0005),
    "y_m": ("absolute", 0.0005),
    "z_m": ("absolute", 0.003),
    "radius_m": ("relative", 0.05),
}


def run_demo(*, out: Path | None, seed: int, paper_force: bool, output: Output) -> bool:
    """Scan the built-in phantom with the robot, find its map, and compare.

    Returns
    -------
    bool
        Whether all presses were made as promised and the map was found within `TOLERANCES`.
    """
    force_n = PAPER_FORCE_N if paper_force else DEFAULT_FORCE_N
    with (
        RunFolder("demo", out, seed=seed, settings={"force_n": force_n}) as run,
        output.task(DEMO) as task,
        Recording(run / "recording.rrd", "virtual phantom", seed=seed) as recording,
    ):
        stage = _Stages(task.say)
        with stage("solving the body"):
            known = default_study()
            plan = plan_presses(known, force_n)
            laboratory, study = planned_laboratory(
                run.path, known, plan, scan_settings(seed, paper_force)
            )
        with stage("scanning"):
            scanned = make_scan(run.path, laboratory, recording, task.advance)
        del laboratory  # its body takes 0.7 GB
        experiment = Experiment.of(read_scan(study.scan), study)
        with stage("building the model"):
            experiment.opened(thin=False)
            outline = study_outline(study)
        with stage("fitting the map"):

            def on_iteration(step: FitIteration) -> None:
                record_step(recording, step, outline)
                task.advance()

            fit = api.fit(experiment, on_iteration=on_iteration)
        with stage("comparing and drawing"):
            finding = with_making(replace(fit.finding, stage_s=dict(stage.seconds)), run.path)
            finish_fit(run.path, finding, recording)
    return _said(run, fit, finding, scan_record(scanned), stage.seconds, output)


class _Stages:
    """Stages of the demo: `with stages("scanning")` says its name and keeps its seconds."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self._say(name)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start


def _said(
    run: RunFolder,
    fit: FitResult,
    finding: Finding,
    presses: ScanRecord,
    stage_s: Mapping[str, float],
    output: Output,
) -> bool:
    """Print the result; return whether it is as it has to be."""
    from rich.markup import escape

    deviations = deviations_from_truth(finding)
    passed = presses.kept and all(deviation[2] for deviation in deviations.values())
    times = ", ".join(f"{name} {s:.0f} s" for name, s in stage_s.items())
    report, recorded = run / "report.html", run / "recording.rrd"
    output.result(
        {
            **fit.to_dict(),
            "run": str(run.path),
            "scan": presses.to_dict(),
            "passed": passed,
            "deviations": {
                name: {"deviation": value, "tolerance": limit, "within": within}
                for name, (value, limit, within) in deviations.items()
            },
            "seconds": dict(stage_s),
        },
        scan_table(presses),
        *summary(finding),
        f"Time: {times}.",
        f"Report:    {escape(str(report))}",
        f"Recording: {escape(str(recorded))}",
        f"Open it:   {escape(to_type('review', run.path))}",
    )
    return passed


def deviations_from_truth(finding: Finding) -> dict[str, tuple[float, float, bool]]:
    """Return deviation, tolerance and whether it is kept, for each parameter of the true map."""
    assert finding.truth is not None  # the laboratory wrote it
    result = {}
    for name, true in matched(finding.fit.map, finding.truth).items():
        kind, limit = TOLERANCES[name.split(".")[-1]]
        deviation = finding.fit.parameters[name].value - true
        if kind == "relative":
            deviation /= true
        result[name] = (deviation, limit, abs(deviation) <= limit)
    return result
