"""`palpmap export`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


class To(StrEnum):
    """Forms of the export."""

    VTU = "vtu"
    VTI = "vti"
    FEBIO = "febio"
    MUJOCO = "mujoco"
    CSV = "csv"


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with a fit.")],
    to: Annotated[
        To,
        typer.Option(
            "--to", help="ParaView (vtu: mesh, vti: grid), FEBio, MuJoCo, or a table (csv)."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="File.",
            show_default="map.*, map_grid.vti in the run folder",
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write the found map for another program.

    Example: palpmap export runs/phantom --to vtu
    """
    from palpmap.commands.export import run_export

    run_export(run=run, form=to.value, out=out, output=Output(quiet=quiet, json=json))
