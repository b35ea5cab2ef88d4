"""`palpmap paper`."""

from enum import StrEnum
from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, Quiet
from palpmap.console import Output


class Optimizer(StrEnum):
    """Methods that find the parameters."""

    BFGS = "bfgs"
    GAUSS_NEWTON = "gauss-newton"


def paper(
    optimizer: Annotated[Optimizer, typer.Option(help="Method.")] = Optimizer.BFGS,
    test: Annotated[
        list[str] | None,
        typer.Option("--test", metavar="NAME", help="Only this test; may be repeated."),
    ] = None,
    out: Out = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Repeat the paper's six tests on its own mesh.

    Data and model are identical twins: this proves the optimiser, not the physics.

    Example: palpmap paper --optimizer gauss-newton --out runs/paper
    """
    from palpmap.paper.command import run_paper

    return run_paper(
        optimizer=optimizer.value, tests=test, out=out, output=Output(quiet=quiet, json=json)
    )
