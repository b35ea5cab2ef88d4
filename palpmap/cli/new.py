"""`palpmap new`."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


class Tip(StrEnum):
    """Shapes of a tip."""

    FLAT = "flat"
    SPHERE = "sphere"


def _three(value: str | None, flag: str | None = None) -> tuple[float, ...] | None:
    if value is None:
        return None
    try:
        numbers = tuple(float(part) for part in value.replace("x", ",").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3:
        raise typer.BadParameter(
            f"found '{value}', expected three numbers in m, as 0.1,0.1,0.05", param_hint=flag
        )
    return numbers


ScanFile = Annotated[Path, typer.Argument(metavar="SCAN", help="Scan, .csv or .parquet.")]
StudyFolder = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder of the study.")]
TipShape = Annotated[Tip | None, typer.Option("--tip", help="Shape of the tip.")]
Size = Annotated[str | None, typer.Option("--size", metavar="X,Y,Z", help="Size of a block in m.")]
Surface = Annotated[
    Path | None, typer.Option("--surface", metavar="STL", help="Closed surface of the body.")
]
Thickness = Annotated[
    float | None,
    typer.Option(
        "--thickness",
        metavar="M",
        help="Mean thickness of a body whose surface the contact points make, m.",
    ),
]
ThicknessAssumed = Annotated[
    bool, typer.Option("--thickness-assumed", help="The thickness is a guess.")
]
Margin = Annotated[
    float | None,
    typer.Option(
        "--margin",
        metavar="M",
        help="Distance from the outermost presses to the sides of such a body, m.",
        show_default="found by evidence",
    ),
]
Poisson = Annotated[float | None, typer.Option("--poisson", help="Poisson's ratio of the body.")]
Origin = Annotated[
    str | None,
    typer.Option("--origin", metavar="X,Y,Z", help="The body's frame in the scan's, m."),
]
DisplacementNoise = Annotated[
    float | None,
    typer.Option("--displacement-noise", metavar="M", help="Standard deviation of the travel, m."),
]
ForceNoise = Annotated[
    float | None,
    typer.Option("--force-noise", metavar="N", help="Standard deviation of the force, N."),
]
TouchNoise = Annotated[
    float | None,
    typer.Option(
        "--touch-noise",
        metavar="M",
        help="Standard deviation of a press's depth of first touch, m.",
        show_default="what presses.json beside the scan states",
    ),
]
Inclusions = Annotated[
    str | None,
    typer.Option(
        "--inclusions",
        help='Number of inclusions, "auto", or "free" for a map of any shape.',
        show_default='1; "free" with --thickness',
    ),
]
Name = Annotated[
    str | None, typer.Option("--name", help="Name of the study.", show_default="the file's")
]


def new(
    scan: ScanFile,
    out: StudyFolder,
    tip: TipShape = None,
    size: Size = None,
    surface: Surface = None,
    thickness: Thickness = None,
    thickness_assumed: ThicknessAssumed = False,
    margin: Margin = None,
    poisson: Poisson = None,
    origin: Origin = None,
    displacement_noise: DisplacementNoise = None,
    force_noise: ForceNoise = None,
    touch_noise: TouchNoise = None,
    inclusions: Inclusions = None,
    name: Name = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make a commented study for a scan; asks on a terminal for what is not given.

    Example: palpmap new scan.csv --tip sphere --thickness 0.03 --poisson 0.49 --out study
    """
    if sum(given is not None for given in (size, surface, thickness)) > 1:
        raise typer.BadParameter("give --thickness, --size or --surface, one of the three")
    if thickness_assumed and thickness is None:
        raise typer.BadParameter("--thickness-assumed belongs to --thickness")
    if margin is not None and thickness is None:
        raise typer.BadParameter("--margin belongs to --thickness")
    from palpmap.commands.new import run_new
    from palpmap.importing.new import Facts

    facts = Facts(
        tip=tip.value if tip else None,
        poisson_ratio=poisson,
        size_m=_three(size, "'--size'"),
        surface=surface,
        thickness_m=thickness,
        thickness_assumed=thickness_assumed,
        margin_m=margin,
        origin_m=_three(origin, "'--origin'"),
        displacement_noise_m=displacement_noise,
        force_noise_n=force_noise,
        touch_noise_m=touch_noise,
        inclusions=int(inclusions) if inclusions and inclusions.isdigit() else inclusions,
        name=name,
    )
    run_new(
        scan=scan,
        out=out,
        facts=facts,
        ask=typer.prompt if sys.stdin.isatty() and not (quiet or json) else None,
        three=_three,
        output=Output(quiet=quiet, json=json),
    )
