"""`palpmap compare`: residual of a fitted model, with figures and report."""

from pathlib import Path

from models import InputError
from palpmap import api
from palpmap.commands.fit import run_fit
from palpmap.console import Output
from palpmap.report.fit_console import summary
from palpmap.result.next_step import after_fit
from palpmap.run_files.fit_run import with_making, write_finding
from palpmap.run_folder import RunFolder, default_folder
from palpmap.study.study import load_study


def run_compare(*, source: Path, out: Path | None, output: Output) -> bool:
    """Compare the fit of a run with its scan; a study is fitted first.

    Parameters
    ----------
    source : Path
        Run folder with fit.json, study.toml and scan; or a study file.
    out : Path, optional
        Run folder to write to; default: the run itself, or a new one for a study, and for a run
        of `palpmap explain`, whose own report is kept.
    output : Output
        Where the summary goes.

    Returns
    -------
    bool
        Whether the residual is noise (the exit code is 1 if not).
    """
    from rich.markup import escape

    run = source
    if not source.exists():
        raise InputError(
            f"{source}: no such file or folder, expected a run folder or a study file (.toml); "
            "check the path"
        )
    if not source.is_dir():
        load_study(source)  # Complain of the study before a folder is made for it.
        run = out = out or default_folder("compare")
        quiet = Output(quiet=output.quiet or output.json)
        run_fit(
            study=source, inclusions=None, optimizer="gauss-newton", out=run, seed=0, output=quiet
        )
    known = api.read_run(run)
    target = out or run if known.result is None else out
    inputs = [run / "fit.json", run / "study.toml"]
    with RunFolder("compare", target, inputs=inputs) as folder:
        comparison = api.compare(known.fit)
        finding = with_making(known.fit.finding, run)
        paths = write_finding(finding, folder.path)
        output.result(
            {**comparison.to_dict(), "run": str(folder.path)},
            *summary(finding, after_fit(finding, _study(source))),
            f"Report: {escape(str(paths['report']))}",
        )
    return comparison.is_noise


def run_compare_runs(*, one: Path, other: Path, out: Path | None, output: Output) -> bool:
    """Compare the fits of two runs on one body, and leave a run folder with the report.

    Returns
    -------
    bool
        Whether maps and effects of the stiffness agree (the exit code is 1 if not).
    """
    from rich.markup import escape

    fits = [api.read_run(run).fit for run in (one, other)]
    found = api.compare_runs(*fits)
    inputs = [run / name for run in (one, other) for name in ("fit.json", "study.toml")]
    with RunFolder("compare", out, inputs=inputs) as folder:
        found.write_files(folder.path)
        output.result(
            {**found.to_dict(), "run": str(folder.path)},
            *found.renderables(),
            f"Report: {escape(str(folder / 'report.html'))}",
        )
    return not found.bodies_differ


def _study(source: Path) -> Path:
    return source / "study.toml" if source.is_dir() else source
