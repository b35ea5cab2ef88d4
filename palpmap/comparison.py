"""`palpmap compare`: what of a scan the fitted model does not explain, with figures and report."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.compare import compare
from identify.comparison import Comparison
from identify.fit_file import read_fit
from identify.fit_record import Fit
from identify.residual_statement import length
from models.errors import InputError
from models.scan import read_scan
from palpmap.console import Output
from palpmap.figures import draw_figures, save_figures
from palpmap.finding import Finding, read_truth, study_outline
from palpmap.placement import place_scan
from palpmap.report import parameter_rows, write_report
from palpmap.run_folder import RunFolder, read_record
from palpmap.study import Study, load_study

if TYPE_CHECKING:
    from rich.console import RenderableType

SMALL_STRAIN = 0.1


def run_compare(*, source: Path, out: Path | None, output: Output) -> bool:
    """Compare the fit of a run with its scan; a study is fitted first.

    Parameters
    ----------
    source : Path
        Run folder with fit.json, study.toml and scan; or a study file.
    out : Path, optional
        Run folder to write to; default: the run itself, or a new one for a study.
    output : Output
        Where the summary goes.

    Returns
    -------
    bool
        Whether the residual is noise (the exit code is 1 if not).
    """
    from rich.markup import escape

    run = source
    if not source.is_dir():
        load_study(source)  # Complain of the study before a folder is made for it.
        with RunFolder("compare", out, inputs=[source]) as folder:
            run = out = folder.path
        _fit_first(source, run, output)
    with RunFolder("compare", out or run, inputs=_inputs(run)) as folder:
        finding = load_finding(run)
        paths = write_finding(finding, folder.path)
        record = {**finding.comparison.to_dict(), "run": str(folder.path)}
        output.result(record, *summary(finding), f"Report: {escape(str(paths['report']))}")
    return finding.comparison.is_noise


def _fit_first(study: Path, run: Path, output: Output) -> None:
    from palpmap.fit import run_fit

    quiet = Output(quiet=output.quiet or output.json)
    run_fit(
        study=study, inclusions=None, optimizer="gauss-newton", out=run, seed=0, output=quiet
    )  # fmt: skip


def _inputs(run: Path) -> list[Path]:
    for name in ("fit.json", "study.toml"):
        if not (run / name).is_file():
            raise InputError(
                f"{run}: found no {name}, expected a run folder with a fit; make one with "
                "`palpmap fit STUDY --out RUN`, or give the study file"
            )
    return [run / "fit.json", run / "study.toml"]


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
    run: Path, fit: Fit, study: Study, stage_s: Mapping[str, float] | None = None
) -> Finding:
    """Compare a fit with its study's scan and gather what figures and report need."""
    placement = place_scan(read_scan(study.scan, study.study.units_checked), study)
    truth = run / "truth.json"
    runs = read_record(run / "run.json")["runs"] if (run / "run.json").is_file() else []
    return Finding(
        name=study.name,
        fit=fit,
        scan=placement.scan.used(),
        comparison=compare(fit, placement.scan),
        outline=study_outline(study),
        truth=read_truth(truth) if truth.is_file() else None,
        origin_m=placement.origin_m,
        stage_s=dict(stage_s or {}),
        how=how_made(runs),
        limits=limits_of(fit, study, placement.scan.used().displacement_m),
    )


def write_finding(finding: Finding, folder: Path) -> dict[str, Path]:
    """Write comparison.json, figures/*.png and report.html; return paths by name."""
    pictures = draw_figures(finding)
    paths = {p.stem: p for p in save_figures(pictures, folder / "figures")}
    paths |= {"comparison": folder / "comparison.json", "report": folder / "report.html"}
    finding.comparison.write(paths["comparison"])
    write_report(finding, pictures, paths["report"])
    return paths


def limits_of(fit: Fit, study: Study, displacement_m: np.ndarray) -> tuple[str, ...]:
    """Say in sentences what the result rests on."""
    limits = [
        "The map is a background and Gaussian inclusions; other shapes are only approximated.",
        f"Poisson's ratio {study.body.poisson_ratio:g} was given, not found.",
        "The intervals count the noise only, not what the model leaves out.",
    ]
    deepest = float(np.max(displacement_m))
    if study.body.size_m is not None:
        share = deepest / study.body.size_m[2]
        text = (
            f"The model is linear in the force. The deepest press reaches {1e3 * deepest:.2g} mm, "
            f"{100 * share:.2g} % of the body's height"
        )
        beyond = ", more than small strain bears: expect errors of that order"
        limits.append(text + (beyond if share > SMALL_STRAIN else "") + ".")
    if study.body.thickness_assumed:
        limits.append("The body's thickness was assumed; moduli and depths scale with it.")
    if study.body.project_points:
        limits.append("A block stands in for a curved body.")
    if study.probe.tip == "sphere":
        limits.append("The tip is a sphere: its contact grows with the force.")
    if fit.discretization_error is not None:
        largest = float(np.max(np.abs(fit.discretization_error)))
        limits.append(
            f"The coarse model is off the finer one by up to {100 * largest:.2g} %; this was "
            "corrected, the finer one's own error was not."
        )
    else:
        limits.append("No finer model was compared: the mesh's own error is not counted.")
    if fit.noise.estimated:
        limits.append("Noise that the study does not give was estimated from the scan.")
    return tuple(limits)


def how_made(runs: list[dict[str, Any]]) -> dict[str, str]:
    """Return commands, seeds, settings, input hashes and versions of a run folder as text."""
    how: dict[str, str] = {}
    for number, run in enumerate(runs, start=1):
        settings = ", ".join(f"{k} = {v}" for k, v in run.get("settings", {}).items())
        seed = "" if run.get("seed") is None else f", seed {run['seed']}"
        how[f"{number}. palpmap {run.get('command', '?')}"] = (
            f"{run.get('started', '?')}{seed}{'; ' + settings if settings else ''}"
        )
        for name, digest in run.get("inputs", {}).items():
            how[Path(name).name] = f"SHA-256 {digest}"
    if runs:
        how["Versions"] = ", ".join(f"{k} {v}" for k, v in runs[-1].get("versions", {}).items())
    return how


def summary(finding: Finding) -> tuple["RenderableType", ...]:
    """Return the finding as rich renderables that fit one screen."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    c = finding.comparison
    found = Table(box=box.SIMPLE, title=Text(f"{finding.name}: found map"), title_justify="left")
    known = finding.truth is not None
    for name in ("parameter", "found", "95 % interval", *(("true", "") if known else ())):
        found.add_column(name, justify="left" if name == "parameter" else "right")
    for name, value, interval, true, inside in parameter_rows(finding):
        mark = {True: "inside", False: "outside", None: ""}[inside]
        found.add_row(*map(Text, (name, value, interval, *((true, mark) if known else ()))))
    verdict = Text(c.statement, style="green" if c.is_noise else "yellow")
    return found, _residual_table(c), verdict, *(Text(f"- {note}") for note in c.notes)


def _residual_table(c: Comparison) -> "RenderableType":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, show_header=False, title="residual", title_justify="left")
    rms, noise = length(c.rms_m, signed=False), length(c.expected_rms_m, signed=False)
    table.add_row("rms", f"{rms}, noise alone {noise}")
    table.add_row("chi-square per degree of freedom", f"{c.chi2_per_dof:.3f}, p = {c.chi2_p:.2g}")
    asked = [t for t in c.tests if t.untestable is None]
    fires = [t.name for t in asked if t.fires]
    said = ", ".join(fires) if fires else "none"
    table.add_row(f"questions that find structure (of {len(asked)})", said)
    worst = "; ".join(
        f"press {p.press} {length(p.mean_m)} ({p.sigmas:.1f} sigma)" for p in c.worst_presses[:3]
    )
    table.add_row("largest misfits", worst)
    return table
