"""A finding from the files of a run folder, and the files that show it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from identify.fit.files import read_fit
from identify.fit.result import FitResult
from identify.residual.compare import compare
from models.scan import Scan
from models.scan_file import read_scan
from models.thin import thinned
from palpmap.figures.fit import draw_figures, save_figures
from palpmap.report.fit_report import write_report
from palpmap.result.finding import Finding
from palpmap.result.truth import FILE as TRUTH
from palpmap.result.truth import read_truth
from palpmap.run_folder import how_made
from palpmap.study.placement import place_scan
from palpmap.study.study import Study, load_study


def load_finding(run: Path) -> Finding:
    """Read a run folder's fit, study, scan and truth, and compare them.

    Raises
    ------
    InputError
        Something is missing, or the fit belongs to another scan.
    """
    return build_finding(run, read_fit(run / "fit.json"), load_study(run / "study.toml"))


def build_finding(
    run: Path, fit: FitResult, study: Study, stage_s: Mapping[str, float] | None = None
) -> Finding:
    """Compare a fit with its study's scan and gather what figures and report need."""
    found = finding_of(fit, study, read_scan(study.scan, study.study.units_checked))
    truth = read_truth(run / TRUTH)
    return replace(found, truth=truth, stage_s=dict(stage_s or {}), how=how_made(run))


def finding_of(fit: FitResult, study: Study, scan: Scan) -> Finding:
    """Compare a fit with a scan in its own frame, without a run folder.

    Raises
    ------
    InputError
        The fit belongs to another scan.
    """
    if len(scan.used()) != len(fit.force_n):
        scan = thinned(scan)  # as `palpmap explain` does with a large one
    placement = place_scan(scan, study)
    comparison = compare(fit, placement.scan)
    return Finding.of(study, fit, placement.scan, placement.origin_m, comparison)


def write_finding(finding: Finding, folder: Path) -> dict[str, Path]:
    """Write comparison.json, figures/*.png and report.html; return paths by name."""
    pictures = draw_figures(finding)
    paths = {p.stem: p for p in save_figures(pictures, folder / "figures")}
    paths |= {"comparison": folder / "comparison.json", "report": folder / "report.html"}
    finding.comparison.write(paths["comparison"])
    write_report(finding, pictures, paths["report"])
    return paths
