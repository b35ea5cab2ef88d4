"""`palpmap compare` and `palpmap predict`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, Quiet
from palpmap.console import Output


def compare(
    source: Annotated[
        Path,
        typer.Argument(metavar="RUN|STUDY", help="Run folder with a fit, or a study to fit first."),
    ],
    other: Annotated[
        Path | None,
        typer.Argument(metavar="[RUN]", help="Another run on the same body, to compare maps with."),
    ] = None,
    out: Out = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Test a fit's residual, or compare two runs on one body.

    Of one run: residuals by place, force level, time and order, and whether they are noise.

    Example: palpmap compare runs/phantom
    """
    from palpmap.commands.compare import run_compare, run_compare_runs

    output = Output(quiet=quiet, json=json)
    if other is not None:
        return run_compare_runs(one=source, other=other, out=out, output=output)
    return run_compare(source=source, out=out, output=output)


def predict(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with a fit.")],
    study: Annotated[
        Path,
        typer.Argument(metavar="STUDY", help="Study of another scan of the same body (.toml)."),
    ],
    out: Out = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Predict a scan that the fit has not seen: deeper, at other places, with another tip.

    Example: palpmap predict runs/phantom deeper/study.toml
    """
    from palpmap.commands.predict import run_predict

    return run_predict(run=run, study=study, out=out, output=Output(quiet=quiet, json=json))
