"""Blind trials: `palpmap blind`, `press`, `reveal`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, Quiet, Seed
from palpmap.console import Output

Effects = Annotated[
    str | None,
    typer.Option(
        "--effects",
        metavar="NAME,...",
        help="What may be hidden: names of effects, A+B for two at once, or the words none, "
        "structured, compliance, form, pair, outsider, single.",
        show_default="anything",
    ),
]
Size = Annotated[
    float | None,
    typer.Option(
        "--size",
        metavar="PERCENT",
        help="Size of what is hidden, % of the travel's rms.",
        show_default="1 to 10, drawn",
    ),
]
Radii = Annotated[
    int, typer.Option("--radii", min=1, max=2, help="Tip radii: 5 mm, or 3 and 10 mm (small: 7).")
]
Mixed = Annotated[
    bool,
    typer.Option(
        "--mixed/--plain",
        help="Press the places in random order, every other one three times as hard, with an early "
        "rest, which shows smaller effects; or row by row with one force.",
    ),
]
Small = Annotated[
    bool,
    typer.Option(
        "--small", help="A block two thirds as large with 36 presses: a third of the time."
    ),
]
Robot = Annotated[
    bool,
    typer.Option(
        "--robot",
        help="The virtual robot presses, and what is hidden acts in its loop: slower, and as real "
        "as it gets. Without, finished readings are changed by formula.",
    ),
]
Varied = Annotated[
    bool,
    typer.Option(
        "--varied",
        help="Draw the block, the tip and the places of the presses, too: 4 to 25 cm, 1.5 to 8 mm, "
        "1 to 200 kPa, a part of the top or all of it. Else they are the paper's.",
    ),
]
Tournament = Annotated[
    int | None,
    typer.Option(
        "--tournament",
        metavar="N",
        min=1,
        help="Make, explain and judge N trials, on all cores; goes on where it was stopped.",
        show_default="one trial, not explained",
    ),
]
Further = Annotated[
    int,
    typer.Option(
        "--further",
        metavar="N",
        min=0,
        help="Of a tournament: where the answer is ambiguous, make the presses that it "
        "proposes and explain again, up to N times.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option("--workers", min=1, help="Processes.", show_default="one a core"),
]
Dask = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="Scheduler of a dask cluster that plays."),
]


def blind(
    effects: Effects = None,
    size: Size = None,
    radii: Radii = 1,
    mixed: Mixed = True,
    small: Small = False,
    robot: Robot = False,
    varied: Varied = False,
    tournament: Tournament = None,
    further: Further = 0,
    workers: Workers = None,
    dask: Dask = None,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Hide an effect in a scan and seal the answer.

    Example: palpmap blind --seed 7 --out trial
    """
    if size is not None and not 0 < size <= 50:
        raise typer.BadParameter(f"--size: found {size:g} %, expected more than 0 and at most 50")
    if tournament is None and (workers is not None or dask is not None or further):
        raise typer.BadParameter("--further, --workers and --dask go with --tournament")
    from palpmap.blind.trial import Conditions, run_blind

    names = (name.strip() for name in (effects or "").split(","))
    share = None if size is None else size / 100
    conditions = Conditions(tuple(filter(None, names)), share, radii, mixed, small, robot, varied)
    if tournament is None:
        return run_blind(conditions, out=out, seed=seed, output=Output(quiet, json))
    from palpmap.blind.tournament import run_tournament

    return run_tournament(
        conditions,
        count=tournament,
        further=further,
        workers=workers,
        dask=dask,
        out=out,
        seed=seed,
        output=Output(quiet, json),
    )


def press(
    trial: Annotated[Path, typer.Argument(metavar="TRIAL", help="Folder of `palpmap blind`.")],
    program: Annotated[
        Path,
        typer.Argument(metavar="PROGRAM", help="Presses, such as next_scan_1.csv of `explain`."),
    ],
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Press the body of a blind trial further.

    The answer stays sealed. Scan and study with all presses so far are written beside the first
    ones.

    Example: palpmap press trial trial/explained/next_scan_1.csv
    """
    from palpmap.blind.further_presses import run_press

    return run_press(trial=trial, program=program, output=Output(quiet, json))


def reveal(
    trial: Annotated[Path, typer.Argument(metavar="TRIAL", help="Folder of `palpmap blind`.")],
    answer: Annotated[
        str | None,
        typer.Option(
            "--answer",
            metavar="NAME,...",
            help="Your own answer: effects, or none, or unexplained.",
            show_default="the newest result.json below the folder",
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Show what was hidden in a blind trial beside what was found.

    Exit code 1 if the answer does not pass.

    Example: palpmap reveal trial
    """
    from palpmap.blind.reveal import run_reveal

    return run_reveal(trial=trial, answer=answer, output=Output(quiet, json))
