"""`palpmap scan`: the virtual laboratory's robot presses on a soft body."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import InputError
from models.scan import Scan
from models.scan_file import write_scan
from models.scan_join import stack_scans
from palpmap.commands.scan_scene import Laboratory, draw_scene
from palpmap.commands.scan_truth import scaled_truth, true_parameters, write_truth
from palpmap.console import Output, to_type
from palpmap.recording.recorder import Recording
from palpmap.run_folder import RunFolder
from palpmap.study.study import About, Body, Map, Noise, Probe, Study, load_study, write_study

if TYPE_CHECKING:
    from rich.console import RenderableType

    from models.press_program import PressProgram
    from sim.body.true_map import TruthMap
    from sim.motion.scan_plan import ScanPlan
    from sim.motion.settings import ScanSettings
    from sim.scan.result import PressResult, ScanRun

DEFAULT_FORCE_N = 0.3
PRESSES_PER_SIDE = 9
PAPER_FORCE_N = 3.0
MARGIN_SHARE = 1 / 8  # of the body's edges, from the rim to the first presses: 12 of 96 mm
SCAN_PARTS = ("robot", "body", "presses", "truth", "events", "about")

# What the scan promises of each press
LARGEST_FORCE_ERROR = 0.01
LARGEST_OVERSHOOT = 0.05
LARGEST_CONTACT_ERROR_M = 2e-4
LARGEST_COUPLING_ERROR = 1e-3

PAPER_DEEPEST_SHARE = 1.0  # the paper's 3 N press the linear phantom nearly flat
SMALL_DEPTH_SHARE = 0.2  # deeper ones are said: beyond a tenth a linear law goes wrong by so much


def run_scan_command(
    *,
    study: Path | None,
    force: float | None,
    paper_force: bool,
    presses_per_side: int | None,
    out: Path | None,
    seed: int,
    output: Output,
    program: Path | None = None,
    plant: Sequence[tuple[str, float]] = (),
) -> bool:
    """Scan the built-in phantom, or a study's block with the phantom's map scaled into it.

    Parameters
    ----------
    presses_per_side : of the grid, None for `PRESSES_PER_SIDE`
    program : file of presses (`models.press_program`, in the study's frame) in place of a grid
    plant : effects to hide, with their sizes; said in truth.json, not in the study

    Returns
    -------
    bool
        Whether every press kept what the scan promises (force, overshoot, place, coupling).
    """
    from rich.markup import escape

    from models.press_program import read_program

    known = default_study() if study is None else load_study(study)
    settings: dict[str, Any] = {}
    if program is None:
        force_n = PAPER_FORCE_N if paper_force else force or DEFAULT_FORCE_N
        per_side = presses_per_side or PRESSES_PER_SIDE
        plan = grid_plan_of(known, force_n, per_side)
        settings |= {"force_n": force_n, "presses_per_side": per_side}
    else:
        plan = program_plan_of(known, read_program(program, seed))
    if plant:
        settings["plant"] = [list(one) for one in plant]
    inputs = [path for path in (study, program) if path is not None]
    with (
        RunFolder("scan", out, seed=seed, settings=settings, inputs=inputs) as run,
        output.progress() as progress,
        Recording(
            run / "recording.rrd",
            "virtual scan",
            seed=seed,
            planned_presses=len(plan),
            parts=SCAN_PARTS,
        ) as recording,
    ):
        task = progress.add_task("meshing and solving the body", total=len(plan))
        laboratory = build_laboratory(run.path, known, plan, seed, plant, paper_force)
        progress.update(task, description="scanning")
        scanned = make_scan(run.path, laboratory, recording, lambda: progress.advance(task))
        progress.update(task, description="done")
    record = scan_record(scanned)
    output.result(
        {**record, "run": str(run.path)},
        scan_table(record),
        f"Next: {escape(to_type('fit', run / 'study.toml'))}",
        f"Recording: {escape(to_type('review', run.path))}",
    )
    return record["kept"]


def grid_plan_of(study: Study, force_n: float, per_side: int) -> "ScanPlan":
    """Plan a grid of presses on a study's block, row by row.

    Raises
    ------
    InputError
        A study whose body or tip the laboratory does not have.
    """
    from sim.motion.scan_plan import ScanPlan

    size = _block_of(study)
    points = _grid(size, per_side)
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return ScanPlan(
        points, down, force_n=force_n, tip_radius_m=study.probe.radius_m, body_size_m=size
    )


def program_plan_of(study: Study, program: "PressProgram") -> "ScanPlan":
    """Plan the presses of a program, which is in the study's frame, on the study's block.

    Raises
    ------
    InputError
        A study whose body or tip the laboratory does not have, presses beside the block, or tips
        of several radii.
    """
    from sim.motion.scan_plan import program_plan

    size = _block_of(study)
    x, y, _ = study.body.origin_m
    return program_plan(replace(program, x_m=program.x_m - x, y_m=program.y_m - y), size)


def build_laboratory(
    run: Path,
    study: Study,
    plan: "ScanPlan",
    seed: int,
    plant: Sequence[tuple[str, float]] = (),
    paper_force: bool = False,
) -> Laboratory:
    """Solve the body of a planned scan; write study.toml and truth.json into the run folder.

    Parameters
    ----------
    plant : see `run_scan_command`
    paper_force : the presses may go as deep as the body is high
    """
    from sim.body.soft_body import SoftBody
    from sim.body.true_body import HiddenBody
    from sim.motion.settings import ScanSettings
    from sim.scan.plant_on_robot import plant_on_robot

    share = PAPER_DEEPEST_SHARE if paper_force else ScanSettings.deepest_share
    settings = ScanSettings(seed=seed, deepest_share=share)
    size = _block_of(study)
    truth = scaled_truth(size)
    hidden = plant_on_robot(
        plant, plan, settings, HiddenBody(size, study.body.poisson_ratio, truth)
    )
    body = SoftBody(
        size,
        hidden.body.modulus if plant else truth,
        hidden.body.poisson_ratio,
        plan.tip_radius_m,
        plan.points_m,
        plan.directions,
    )
    kept = _known_of(study, run, plan, truth, settings)
    write_study(kept, run / "study.toml")
    laboratory = Laboratory(plan, hidden.body.truth, body, settings, kept, hidden)
    write_truth(run, hidden.body, hidden.records)
    return laboratory


def _known_of(
    study: Study, run: Path, plan: "ScanPlan", truth: "TruthMap", settings: "ScanSettings"
) -> Study:
    """Return what is known of the scan beforehand: noise, number of inclusions, tip, place."""
    about = About(name=study.name, scan=(run / "scan.csv").resolve())  # pyright: ignore[reportCallIssue]
    noise = Noise(displacement_m=settings.displacement_noise_m, force_n=settings.force_noise_n)
    return study.model_copy(
        update={
            "study": about,
            "noise": noise,
            "map": Map(inclusions=len(truth.inclusions)),
            "body": study.body.model_copy(update={"origin_m": (0.0, 0.0, 0.0)}),
            "probe": Probe(tip="flat", radius_m=plan.tip_radius_m),
        }
    )


def make_scan(
    run: Path, laboratory: Laboratory, recording: Recording, advance: Callable[[], object]
) -> "ScanRun":
    """Make all presses; scan.csv and the recording are complete up to the last one at any time."""
    from sim.scan.scan_program import run_scan

    drawn = draw_scene(recording, laboratory, true_parameters(laboratory.truth))
    done: list[Scan] = []

    def on_press(result: "PressResult") -> None:
        start = done[0].time_s[0] if done else result.scan.time_s[0]
        told = laboratory.hidden.report(result.scan, float(start))
        done.append(told)
        write_scan(stack_scans(done), run / "scan.csv")
        used = told.used()
        recording.press_done(
            result.statistics.press,
            float(told.time_s[told.phase == "hold"][-1]),
            told.point_m[0],
            float(used.at_largest_force(used.force_n)[0]),
            float(used.at_largest_force(used.displacement_m)[0]),
        )
        advance()

    made = run_scan(laboratory.plan, laboratory.body, laboratory.settings, drawn, on_press)
    if laboratory.hidden.planted:
        reached = laboratory.hidden.reached([press.scan for press in made.presses])
        write_truth(run, laboratory.hidden.body, reached)
    return made


def default_study() -> Study:
    """Return the study of the built-in phantom: the paper's block, a flat tip of 5 mm."""
    return Study(
        study=About(name="virtual phantom", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005),
    )


def _block_of(study: Study) -> tuple[float, float, float]:
    """Edges of a study's block, if it is one that the laboratory has, with a tip that it has."""
    if study.body.size_m is None:
        raise InputError(
            'the laboratory presses on blocks; the study has body.shape = "surface": give a study '
            "of a block to scan"
        )
    if study.body.support != "base-bonded" or study.body.held_sides:
        raise InputError(
            "the laboratory's body is bonded at its base and free elsewhere; the study has "
            f'body.support = "{study.body.support}" and held_sides = '
            f'{list(study.body.held_sides)}: give support = "base-bonded" and no held_sides to scan'
        )
    if study.probe.tip != "flat":
        raise InputError(
            'the laboratory presses with a flat tip; the study has probe.tip = "sphere": give '
            'probe.tip = "flat" to scan'
        )
    return study.body.size_m


def _grid(size: tuple[float, float, float], per_side: int) -> np.ndarray:
    """Points of the presses, row by row to and fro, (j, 3) m."""
    x, y = (np.linspace(MARGIN_SHARE * s, (1 - MARGIN_SHARE) * s, per_side) for s in size[:2])
    rows = [(xi, yk, size[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])]
    return np.array(rows)


def scan_record(scanned: "ScanRun") -> dict[str, Any]:
    """Return how well the presses were made, as a JSON record."""
    statistics = scanned.statistics
    largest = {
        "force_error": max(abs(s.force_error) for s in statistics),
        "overshoot": max(s.overshoot for s in statistics),
        "contact_error_m": max(s.contact_error_m for s in statistics),
        "coupling_error": max(s.coupling_error for s in statistics),
        "depth_share": max(s.depth_share for s in statistics),
    }
    kept = [
        abs(s.force_error) <= LARGEST_FORCE_ERROR
        and s.overshoot <= LARGEST_OVERSHOOT
        and s.contact_error_m <= LARGEST_CONTACT_ERROR_M
        and s.coupling_error <= LARGEST_COUPLING_ERROR
        for s in statistics
    ]
    return {
        "schema": 1,
        "presses": len(statistics),
        "presses_kept": sum(kept),
        "kept": all(kept),
        "largest": largest,
        "force_n": statistics[0].set_force_n,
        "simulated_s": scanned.simulated_s,
        "wall_s": scanned.wall_s,
        "real_time_factor": scanned.real_time_factor,
    }


def scan_table(record: dict[str, Any]) -> "RenderableType":
    """Return how well the presses were made, as a small table."""
    from rich import box
    from rich.table import Table

    largest = record["largest"]
    table = Table(box=box.SIMPLE, show_header=False, title="scan", title_justify="left")
    table.add_row(
        "presses that kept force, place and coupling",
        f"{record['presses_kept']} of {record['presses']} at {record['force_n']:g} N",
    )
    table.add_row(
        "largest force error, overshoot",
        f"{100 * largest['force_error']:.2f} %, {100 * largest['overshoot']:.1f} %",
    )
    table.add_row(
        "largest contact error, coupling error",
        f"{1e3 * largest['contact_error_m']:.3f} mm, {100 * largest['coupling_error']:.3f} %",
    )
    if largest["depth_share"] > SMALL_DEPTH_SHARE:
        table.add_row(
            "deepest press",
            f"{100 * largest['depth_share']:.0f} % of the body's height; a real body is linear "
            "to about a tenth",
        )
    table.add_row(
        "robot time, computing time",
        f"{record['simulated_s']:.0f} s, {record['wall_s']:.1f} s "
        f"({record['real_time_factor']:.0f} times real time)",
    )
    return table
