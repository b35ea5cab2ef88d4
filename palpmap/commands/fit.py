"""`palpmap fit`: the stiffness map that explains a study's scan."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from identify.experiment import BodyModel
from identify.fit.files import write_fit
from identify.fit.result import FitResult
from identify.fit.search import FitIteration
from identify.fit.start_map import fit_map
from identify.map.gaussian_map import GaussianMap
from identify.optimize.optimizers import OPTIMIZERS
from identify.select.start_fit import with_effects
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.commands.write_fit_run import build_finding, write_finding
from palpmap.console import Output, to_type
from palpmap.figures.curves import near_largest_force
from palpmap.recording.maps import map_views
from palpmap.recording.recorder import Recording
from palpmap.report.fit_console import summary
from palpmap.result.finding import Finding
from palpmap.run_folder import RunFolder
from palpmap.study.kept_inputs import keep_inputs, refuse_own_folder
from palpmap.study.open_study import catalogue_with, open_study, own_effects
from palpmap.study.study import Study, load_study

RECORDED_PARTS = ("body", "presses", "fit", "comparison", "events", "about")


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

    source = study
    known = load_study(source)
    if inclusions is not None:
        refuse_own_folder(source, out)
        known = known.model_copy(
            update={"map": known.map.model_copy(update={"inclusions": inclusions})}
        )
    scan = read_scan(known.scan, known.study.units_checked)
    opened = open_study(known, scan, catalogue_with(own_effects(known, ())), thin=False)
    settings = {"inclusions": known.map.inclusions, "optimizer": optimizer}
    with RunFolder("fit", out, seed=seed, settings=settings, inputs=[source, known.scan]) as run:
        known = keep_inputs(known, scan, run.path)
        with (
            output.progress() as progress,
            Recording(
                run / "recording.rrd",
                known.name,
                seed=seed,
                planned_presses=len(scan.press_ids),
                parts=RECORDED_PARTS,
            ) as recording,
        ):
            task = progress.add_task("meshing the body", total=None)
            body = opened.body
            surface = record_scan(recording, body, opened.scan.used())
            progress.update(task, description="fitting the map")
            record_step = step_recorder(recording, body, lambda: progress.advance(task), surface)
            fit = fit_map(opened, OPTIMIZERS[optimizer], record_step)
            if known.effects:
                fit = with_effects(opened, fit)
                record_step(fit.history[-1])
            progress.update(task, description="comparing and drawing")
            finding = finish_fit(run.path, known, fit, body, recording)
            progress.update(task, description="done", total=1, completed=1)
        record = fit_record(finding)
        output.result(
            {**record, "run": str(run.path)},
            *summary(finding),
            f"Fit: {escape(fit.message)}",
            f"Report: {escape(str(run / 'report.html'))}",
            f"Recording: {escape(to_type('review', run.path))}",
        )
    return fit.success


def record_scan(recording: Recording, body: BodyModel, scan: Scan) -> np.ndarray:
    """Put the body and the presses of a scan from file into a recording.

    Returns the vertices (n, 3) m of the body's surface, to be coloured by the estimate.
    """
    mesh = body.coarse.mesh
    triangles = mesh.boundary[:, :3]
    used, local = np.unique(triangles, return_inverse=True)
    recording.scene(mesh.nodes[used], local.reshape(-1, 3))
    last = scan.deepest_rows
    times = scan.time_s[last] - scan.time_s.min() if scan.has_time else None
    measured = scan.at_largest_force(scan.displacement_m)
    recording.measured(scan.press_ids, scan.contact_points, measured, times)
    return mesh.nodes[used]


def step_recorder(
    recording: Recording,
    body: BodyModel,
    advance: Callable[[], object],
    surface_m: np.ndarray | None = None,
) -> Callable[[FitIteration], None]:
    """Return a callback that writes each step of a fit into a recording.

    Parameters
    ----------
    surface_m : (n, 3) vertices to be coloured by the estimate, where the truth is not known
    """
    lower, upper = body.coarse.mesh.box_m[0], body.search.mesh.box_m[1]

    def record(step: FitIteration) -> None:
        stiffness = GaussianMap.from_values(np.array(list(step.parameters.values())))
        colors = None if surface_m is None else stiffness.modulus(surface_m)
        recording.iteration(step, map_views(stiffness.modulus, lower, upper), colors)
        advance()

    return record


def finish_fit(
    run: Path,
    study: Study,
    fit: FitResult,
    body: BodyModel,
    recording: Recording,
    stage_s: dict[str, float] | None = None,
) -> Finding:
    """Write fit.json, comparison, figures and report; end the recording with the residuals."""
    write_fit(fit, run / "fit.json")
    finding = build_finding(run, fit, study, stage_s)
    if body.note:
        finding = replace(finding, limits=(*finding.limits, body.note))
    paths = write_finding(finding, run)
    measured, modelled, _ = near_largest_force(finding)
    recording.comparison(
        finding.scan.press_ids,
        1e-3 * modelled,
        1e-3 * (measured - modelled),
        {name: path for name, path in paths.items() if path.suffix == ".png"},
    )
    recording.event(finding.comparison.statement)
    return finding


def fit_record(finding: Finding) -> dict:
    """Return the fit as a JSON record."""
    fit = finding.fit
    return {
        "schema": 1,
        "success": fit.success,
        "message": fit.message,
        "parameters": {name: vars(estimate) for name, estimate in fit.parameters.items()},
        "chi2_per_dof": fit.chi2_per_dof,
        "rms_m": fit.rms_m,
        "noise": vars(fit.noise),
        "evaluations": fit.nfev,
        "residual": finding.comparison.statement,
        "residual_is_noise": finding.comparison.is_noise,
    }
