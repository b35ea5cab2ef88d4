"""A finding from the files of a run folder, and the files that show it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from identify.fit.files import read_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.residual.compare import compare
from models.scan import Scan
from models.scan_file import read_scan
from models.thin import thinned
from palpmap.figures.fit import draw_figures, save_figures
from palpmap.report.fit_report import write_report
from palpmap.result.caveats import limits_of
from palpmap.result.finding import Finding, read_truth, study_outline
from palpmap.run_folder import how_made, read_record
from palpmap.study.placement import place_scan
from palpmap.study.study import Study, load_study


def load_finding(run: Path, stage_s: Mapping[str, float] | None = None) -> Finding:
    """Read a run folder's fit, study, scan and truth, and compare them.

    Raises
    ------
    InputError
        Something is missing, or the fit belongs to another scan.
    """
    fit, study = read_fit(run / "fit.json"), load_study(run / "study.toml")
    return build_finding(run, fit, study, stage_s)


def build_finding(
    run: Path, fit: FitResult, study: Study, stage_s: Mapping[str, float] | None = None
) -> Finding:
    """Compare a fit with its study's scan and gather what figures and report need."""
    scan = read_scan(study.scan, study.study.units_checked)
    truth = run / "truth.json"
    runs = read_record(run / "run.json")["runs"] if (run / "run.json").is_file() else []
    found = finding_of(fit, study, scan, read_truth(truth) if truth.is_file() else None)
    return replace(found, stage_s=dict(stage_s or {}), how=how_made(runs))


def finding_of(
    fit: FitResult, study: Study, scan: Scan, truth: GaussianMap | None = None
) -> Finding:
    """Compare a fit with a scan in its own frame, without a run folder.

    Raises
    ------
    InputError
        The fit belongs to another scan.
    """
    if len(scan.used()) != len(fit.force_n):
        scan = thinned(scan)  # as `palpmap explain` does with a large one
    placement = place_scan(scan, study)
    outline, used = study_outline(study), placement.scan.used()
    height_m = float(outline.upper_m[2] - outline.lower_m[2])
    return Finding(
        name=study.name,
        fit=fit,
        scan=used,
        comparison=compare(fit, placement.scan),
        outline=outline,
        truth=truth,
        origin_m=placement.origin_m,
        limits=limits_of(fit, study, used.displacement_m, height_m),
    )


def write_finding(finding: Finding, folder: Path) -> dict[str, Path]:
    """Write comparison.json, figures/*.png and report.html; return paths by name."""
    pictures = draw_figures(finding)
    paths = {p.stem: p for p in save_figures(pictures, folder / "figures")}
    paths |= {"comparison": folder / "comparison.json", "report": folder / "report.html"}
    finding.comparison.write(paths["comparison"])
    write_report(finding, pictures, paths["report"])
    return paths
