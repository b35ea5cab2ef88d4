"""`palpmap compare`: what of a scan the fitted model does not explain, with figures and report."""

from pathlib import Path

from models.errors import InputError
from palpmap.commands.fit import run_fit
from palpmap.commands.write_fit_run import load_finding, write_finding
from palpmap.console import Output
from palpmap.report.fit_console import summary
from palpmap.run_folder import RunFolder
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
    if not source.is_dir():
        load_study(source)  # Complain of the study before a folder is made for it.
        with RunFolder("compare", out, inputs=[source]) as folder:
            run = out = folder.path
        _fit_first(source, run, output)
    explained = (run / "result.json").is_file()
    folder_of_it = out if explained else out or run
    with RunFolder("compare", folder_of_it, inputs=_inputs(run)) as folder:
        finding = load_finding(run)
        paths = write_finding(finding, folder.path)
        record = {**finding.comparison.to_dict(), "run": str(folder.path)}
        output.result(record, *summary(finding), f"Report: {escape(str(paths['report']))}")
    return finding.comparison.is_noise


def _fit_first(study: Path, run: Path, output: Output) -> None:
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
