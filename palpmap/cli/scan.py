"""`palpmap scan`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Out, PaperForce, Quiet, Seed
from palpmap.console import Output


class OnFault(StrEnum):
    """What follows a press that cannot be made."""

    skip = "skip"
    retry = "retry"
    stop = "stop"


ScannedStudy = Annotated[
    Path | None,
    typer.Option(
        "--study",
        metavar="STUDY",
        help="Study file whose body and tip are scanned.",
        show_default="the built-in phantom",
    ),
]
Force = Annotated[
    float | None,
    typer.Option("--force", metavar="N", min=1e-3, max=100.0, help="Force of each press in N."),
]
PressesPerSide = Annotated[
    int | None,
    typer.Option(
        "--presses-per-side",
        min=2,
        max=50,
        help="Presses along x and along y.",
        show_default="9",
    ),
]
Presses = Annotated[
    int | None,
    typer.Option(
        "--presses",
        min=1,
        max=2500,
        help="Number of presses that cover the upper surface of any body evenly, in place of "
        "a grid.",
        show_default="a grid",
    ),
]
Program = Annotated[
    Path | None,
    typer.Option(
        "--program",
        metavar="FILE",
        help="CSV of presses in place of the grid, in the study's frame: x_m, y_m, radius_m, "
        "force_n, ramp_s, hold_s and optionally unload_s, pause_s, z_m, nx, ny, nz (direction "
        "into the body); where the radius changes, the arm changes its tip.",
        show_default="a grid",
    ),
]
Plant = Annotated[
    list[str] | None,
    typer.Option(
        "--plant",
        metavar="NAME[:PERCENT]|FILE.py",
        help="Plant an effect (% of the travel's rms), a fault (% of the presses) or a file of "
        "hooks in the robot's loop; may be given more than once.",
        show_default="nothing; 3 %",
    ),
]
AfterFault = Annotated[
    OnFault,
    typer.Option(
        "--on-fault",
        help="After a press that fails or cannot be made: go on with the next, try it again first, "
        "or end the scan.",
    ),
]
Tips = Annotated[
    str | None,
    typer.Option(
        "--tips",
        metavar="LIST",
        help="Tips that take turns, radii in mm: 3,10 or flat:3,ball:8; also "
        "cone:RADIUS:ANGLE and ring:OUTER:INNER.",
        show_default="the study's",
    ),
]
Truth = Annotated[
    str | None,
    typer.Option(
        "--truth",
        metavar="FILE|random",
        help="True map of the body (TOML), 'random' for one that the seed draws, or truth.json of "
        "an earlier scan: its body, and what was planted in it, again.",
        show_default="the phantom's in a block, else random",
    ),
]
SkipUnreachable = Annotated[
    bool,
    typer.Option("--skip-unreachable", help="Same as --on-fault skip, the default.", hidden=True),
]
Arm = Annotated[
    str | None,
    typer.Option(
        "--arm",
        metavar="NAME|FOLDER",
        help="Arm that presses: panda, ur5, xarm7, or a folder with arm.toml.",
        show_default="panda",
    ),
]
LabFile = Annotated[
    Path | None,
    typer.Option(
        "--lab",
        metavar="FILE",
        help="Laboratory (TOML): arm, truth, pose of the body, robot, obstacles, plant.",
        show_default="the built-in one",
    ),
]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Show the scan while it is made: in a viewer that listens on port 9876, else in a "
        "new window.",
    ),
]


def scan(
    study: ScannedStudy = None,
    force: Force = None,
    paper_force: PaperForce = False,
    presses_per_side: PressesPerSide = None,
    presses: Presses = None,
    program: Program = None,
    plant: Plant = None,
    on_fault: AfterFault = OnFault.skip,
    tips: Tips = None,
    truth: Truth = None,
    skip_unreachable: SkipUnreachable = False,
    arm: Arm = None,
    lab: LabFile = None,
    live: Live = False,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Let the simulated robot press on a soft body.

    Scan, study file and recording are written to the run folder.

    Example: palpmap scan --force 0.3 --out runs/phantom
    """
    if program is not None and (force is not None or paper_force):
        raise typer.BadParameter("a program has its own forces: give --program or a force")
    if tips is not None and program is not None:
        raise typer.BadParameter("a program has its own radii: give --program or --tips")
    if presses is not None and presses_per_side is not None:
        raise typer.BadParameter("give --presses or --presses-per-side, not both")
    if program is not None and (presses_per_side is not None or presses is not None):
        raise typer.BadParameter("a program has its own places: give --program or a grid")
    if force is not None and paper_force:
        raise typer.BadParameter("give --force or --paper-force, not both")
    from palpmap.commands.scan import planted, run_scan_command

    return run_scan_command(
        study=study,
        force=force,
        paper_force=paper_force,
        presses_per_side=presses_per_side,
        presses=presses,
        truth=truth,
        tips=tips,
        program=program,
        plant=[planted(text) for text in plant or []],
        on_fault=on_fault.value,
        arm=arm,
        lab=lab,
        live=live,
        out=out,
        seed=seed,
        output=Output(quiet=quiet, json=json),
    )
