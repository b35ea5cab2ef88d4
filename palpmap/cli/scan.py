"""`palpmap scan`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, PaperForce, Quiet, Seed
from palpmap.console import Output


def scan(
    study: Annotated[
        Path | None,
        typer.Option(
            "--study",
            metavar="STUDY",
            help="Study file whose body and tip are scanned.",
            show_default="the built-in phantom",
        ),
    ] = None,
    force: Annotated[
        float | None,
        typer.Option("--force", metavar="N", min=1e-3, max=100.0, help="Force of each press in N."),
    ] = None,
    paper_force: PaperForce = False,
    presses_per_side: Annotated[
        int, typer.Option("--presses-per-side", min=2, max=50, help="Presses along x and along y.")
    ] = 9,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Let the simulated robot press on a soft body.

    Scan, study file and recording are written to the run folder.

    Example: palpmap scan --force 0.3 --out runs/phantom
    """
    if force is not None and paper_force:
        raise typer.BadParameter("give --force or --paper-force, not both")
    from palpmap.scan import run_scan_command

    return run_scan_command(
        study=study,
        force=force,
        paper_force=paper_force,
        presses_per_side=presses_per_side,
        out=out,
        seed=seed,
        output=Output(quiet=quiet, json=json),
    )
