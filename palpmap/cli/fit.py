"""`palpmap fit`."""

from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, Quiet, Seed, StudyFile
from palpmap.cli.paper import Optimizer
from palpmap.console import Output


def _inclusions(text: str) -> str:
    if text == "auto" or text.isdecimal():
        return text
    raise typer.BadParameter(f"found '{text}', expected 0, 1, 2, ... or auto")


def _samples(text: str | None) -> int | None:
    if text is None or text.isdecimal():
        return None if text is None else int(text)
    raise typer.BadParameter(f"found '{text}', expected a whole number")


def fit(
    study: StudyFile,
    inclusions: Annotated[
        str | None,
        typer.Option(
            "--inclusions",
            metavar="N|auto",
            callback=lambda text: text if text is None else _inclusions(text),
            help="Number of inclusions.",
            show_default="the study's",
        ),
    ] = None,
    optimizer: Annotated[Optimizer, typer.Option(help="Method.")] = Optimizer.GAUSS_NEWTON,
    samples: Annotated[
        str | None,
        typer.Option(
            "--samples",
            metavar="N",
            help="Draws from the posterior of map and effects.",
            show_default="the study's",
        ),
    ] = None,
    without_outliers: Annotated[
        bool,
        typer.Option(
            "--without-outliers", help="Leave out the readings and presses that `check` doubts."
        ),
    ] = False,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Find the stiffness map that explains a study's scan.

    Example: palpmap fit study.toml --inclusions 1 --out runs/phantom
    """
    from palpmap.commands.fit import run_fit

    return run_fit(
        study=study,
        inclusions=None
        if inclusions is None
        else "auto"
        if inclusions == "auto"
        else int(inclusions),
        optimizer=optimizer.value,
        samples=_samples(samples),
        out=out,
        seed=seed,
        output=Output(quiet=quiet, json=json),
        without_outliers=without_outliers,
    )
