"""The run folder of a fit: its recording while it is made, its files, and the finding in them."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from fem import Mesh
from identify.fit import FitIteration, FitResult, FreeMapIteration, write_fit
from identify.map import FreeMap, GaussianMap
from identify.residual import compare
from models import Scan, thinned, touching
from palpmap.experiment import Experiment
from palpmap.figures.curves import near_largest_force
from palpmap.figures.fit import draw_figures, save_figures
from palpmap.recording.maps import cut_views, map_views, near_views
from palpmap.recording.recorder import Recording
from palpmap.report.fit_report import write_report
from palpmap.result.finding import Finding
from palpmap.result.outline import Outline, study_outline
from palpmap.result.truth import FILE as TRUTH
from palpmap.result.truth import read_truth
from palpmap.run_files.volume import write_vti
from palpmap.run_folder import how_made
from palpmap.study.kept_inputs import keep_inputs
from palpmap.study.placement import place_scan
from palpmap.study.study import Study

RECORDED_PARTS = ("body", "presses", "fit", "comparison", "events", "about")


class FitRun:
    """A fit's run folder, with its recording open; a context.

    Parameters
    ----------
    path : the run folder
    experiment : its inputs are copied into the folder
    seed : recorded
    """

    def __init__(self, path: Path, experiment: Experiment, seed: int = 0) -> None:
        self.path = path
        keep_inputs(experiment.study, experiment.scan, path)
        opened = experiment.opened(thin=False)
        self._open = ExitStack()
        self._recording = self._open.enter_context(
            Recording(
                path / "recording.rrd",
                experiment.study.name,
                seed=seed,
                planned_presses=len(experiment.scan.press_ids),
                parts=RECORDED_PARTS,
            )
        )
        mesh = opened.body.coarse.mesh
        self._surface_m = record_scan(self._recording, mesh, opened.scan.used())
        self._outline = study_outline(experiment.study)

    def __enter__(self) -> Self:
        """Return the run itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the recording."""
        self._open.close()

    def record(self, step: FitIteration) -> None:
        """Write a step of the fit into the recording."""
        record_step(self._recording, step, self._outline, self._surface_m)

    def finish(self, finding: Finding) -> Finding:
        """Write fit, comparison, figures and report; end the recording with the residuals.

        Returns the finding with the truth of a virtual body and the making of the run.
        """
        made = with_making(finding, self.path)
        finish_fit(self.path, made, self._recording)
        return made


def record_scan(recording: Recording, mesh: Mesh, scan: Scan) -> np.ndarray:
    """Put the body and the presses of a scan from file into a recording.

    Returns the vertices (n, 3) m of the body's surface, to be coloured by the estimate.
    """
    triangles = mesh.boundary[:, :3]
    used, local = np.unique(triangles, return_inverse=True)
    recording.scene(mesh.nodes[used], local.reshape(-1, 3))
    last = scan.deepest_rows
    times = scan.time_s[last] - scan.time_s.min() if scan.has_time else None
    measured = scan.at_largest_force(scan.displacement_m)
    recording.measured(scan.press_ids, scan.contact_points, measured, times)
    return mesh.nodes[used]


def record_step(
    recording: Recording,
    step: FitIteration,
    outline: Outline,
    surface_m: np.ndarray | None = None,
) -> None:
    """Write a step of a fit into a recording.

    Parameters
    ----------
    outline : of the body
    surface_m : (n, 3) vertices to be coloured by the estimate, where the truth is not known
    """
    if isinstance(step, FreeMapIteration):
        stiffness = step.stiffness
        views = near_views(outline, stiffness.modulus)
    else:
        stiffness = GaussianMap.from_values(np.array(list(step.parameters.values())))
        views = map_views(stiffness.modulus, outline.lower_m, outline.upper_m)
    colors = None if surface_m is None else stiffness.modulus(surface_m)
    recording.iteration(step, views, colors)


def finish_fit(run: Path, finding: Finding, recording: Recording) -> None:
    """Write fit.json, comparison, figures and report; end the recording with the residuals."""
    write_fit(finding.fit, run / "fit.json")
    if isinstance(finding.fit.map, FreeMap):
        write_vti(finding, run / "map.vti")
        recording.found(cut_views(finding, finding.fit, finding.fit.map.modulus))
    _forget_other_fits(finding.fit, run)
    paths = write_finding(finding, run)
    measured, modelled, _ = near_largest_force(finding)
    recording.comparison(
        finding.scan.press_ids,
        1e-3 * modelled,
        1e-3 * (measured - modelled),
        {name: path for name, path in paths.items() if path.suffix == ".png"},
    )
    recording.event(" ".join([finding.comparison.statement, *finding.doubts]))


def _forget_other_fits(fit: FitResult, run: Path) -> None:
    """Remove the files of a former fit of the folder that this one has none of."""
    stale = [] if isinstance(fit.map, FreeMap) else ["map.vti"]
    if fit.posterior is None:
        stale += ["posterior.nc", "figures/posterior.png"]
    for name in stale:
        (run / name).unlink(missing_ok=True)


def with_making(finding: Finding, run: Path) -> Finding:
    """Return a finding with the making of its run, and the truth if a virtual body was scanned."""
    return replace(finding, truth=read_truth(run / TRUTH), how=how_made(run))


def finding_of(fit: FitResult, study: Study, scan: Scan, note: str = "") -> Finding:
    """Compare a fit with a scan in its own frame, without a run folder.

    Raises
    ------
    InputError
        The fit belongs to another scan.
    """
    scan = touching(scan)
    if len(scan.used()) != len(fit.force_n):
        scan = thinned(scan)  # as `palpmap explain` does with a large one
    placement = place_scan(scan, study)
    comparison = compare(fit, placement.scan)
    return Finding.of(study, fit, placement.scan, placement.origin_m, comparison, note)


def write_finding(finding: Finding, folder: Path) -> dict[str, Path]:
    """Write comparison.json, figures/*.png and report.html; return paths by name."""
    pictures = draw_figures(finding)
    paths = {p.stem: p for p in save_figures(pictures, folder / "figures")}
    paths |= {"comparison": folder / "comparison.json", "report": folder / "report.html"}
    finding.comparison.write(paths["comparison"])
    write_report(finding, pictures, paths["report"])
    return paths
