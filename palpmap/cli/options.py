"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

StudyFile = Annotated[
    Path, typer.Argument(metavar="STUDY", help="Study file (.toml), which names the scan.")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="RUN", help="Run folder.", show_default="runs/<command>-<date>"),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
PaperForce = Annotated[bool, typer.Option("--paper-force", help="Press with the 3 N of the paper.")]
EffectFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--effect", metavar="FILE", help="An effect of your own: Python code, which is executed."
    ),
]
