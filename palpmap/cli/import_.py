"""`palpmap import`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


class Form(StrEnum):
    """Forms of the scan's file."""

    CSV = "csv"
    PARQUET = "parquet"


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="A rig's own files: text, Excel, MATLAB, HDF5, NumPy, Parquet, MCAP, ROS bags.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder of the study.")
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="TOML", help="Mapping: which column or topic is what."),
    ] = None,
    propose: Annotated[
        bool, typer.Option("--propose", help="Print a mapping, with the reason for each line.")
    ] = False,
    form: Annotated[Form, typer.Option("--form", help="Form of the scan.")] = Form.CSV,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make a scan and a study of a rig's own recording.

    Example: palpmap import run.mcap --propose > rig.toml,
    then palpmap import run.mcap --rig rig.toml --out study
    """
    if propose and (rig or out):
        raise typer.BadParameter("give --propose alone; it prints a mapping and writes nothing")
    if not propose and out is None:
        raise typer.BadParameter("give --out FOLDER, or --propose")
    from palpmap.commands.import_ import run_import, run_propose

    output = Output(quiet=quiet, json=json)
    if propose:
        run_propose(files, output)
    else:
        assert out is not None  # asked for above
        run_import(files=files, rig=rig, out=out, form=form.value, output=output)
