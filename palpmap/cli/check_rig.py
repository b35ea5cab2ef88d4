"""`palpmap check-rig`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def check_rig(
    files: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help="Files of a raw recording.")
    ],
    rig: Annotated[
        Path, typer.Option("--rig", metavar="TOML", help="Mapping, see `palpmap import --propose`.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="HTML", help="Write the page there.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Bias, drift, weight, hysteresis, noise and lag of a rig, by its approaches and retreats.

    Example: palpmap check-rig run.mcap --rig rig.toml --out rig.html
    """
    from palpmap.commands.check_rig import run_check_rig

    run_check_rig(files=files, rig=rig, out=out, output=Output(quiet=quiet, json=json))
