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
    out: Out = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Say what of a scan the model does not explain.

    Residuals by place, force level, time and order, and whether they are noise.

    Example: palpmap compare runs/phantom
    """
    from palpmap.commands.compare import run_compare

    return run_compare(source=source, out=out, output=Output(quiet=quiet, json=json))


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
