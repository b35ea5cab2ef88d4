"""`palpmap scan`: the virtual laboratory's robot presses on a soft body."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field, JsonValue

from models import InputError, Scan, write_scan
from palpmap.commands.scan_scene import draw_scene
from palpmap.commands.scan_truth import true_parameters, write_truth
from palpmap.console import Output, to_type
from palpmap.record import FileRecord, Record
from palpmap.recording.recorder import Recording
from palpmap.result.press_outcomes import FILE as PRESSES
from palpmap.result.press_outcomes import PressesRecord, PressRecord, press_record
from palpmap.run_folder import RunFolder
from palpmap.study.lab import Lab, read_lab
from palpmap.study.study import Study, load_study, write_study
from palpmap.study.truth_file import Truth, read_truth
from palpmap.study.virtual_lab import (
    DEFAULT_FORCE_N,
    PRESSES_PER_SIDE,
    Laboratory,
    build_laboratory,
    cover_plan_of,
    default_study,
    default_truth,
    grid_plan_of,
    kind_of,
    known_of,
    program_plan_of,
    reachable,
    tip_notes,
    with_touch_error,
)

if TYPE_CHECKING:
    import numpy as np
    from rich.console import RenderableType

    from sim.motion import Motion, Refusal, ScanPlan, ScanSettings
    from sim.scan import PressOutcome, PressResult, PressStatistics, ScanRun, Series

OnFault = Literal["skip", "retry", "stop"]

PAPER_FORCE_N = 3.0
LISTED = 10
RANDOM = "random"
SAMPLES = "samples.parquet"
SCAN_PARTS = ("robot", "body", "presses", "truth", "events", "about")

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
    on_fault: OnFault = "skip",
    presses: int | None = None,
    truth: str | None = None,
    skip_unreachable: bool = False,
    tips: str | None = None,
    arm: str | None = None,
    lab: Path | None = None,
) -> bool:
    """Scan the built-in phantom, or a study's body.

    Parameters
    ----------
    presses_per_side : of the grid, None for `PRESSES_PER_SIDE`
    presses : number of presses that cover the upper surface evenly, in place of a grid
    truth : file of the true map, or "random" for one drawn by the seed; None is the phantom's,
        scaled into a block, and a random one in other bodies
    tips : that take turns, as "3,10" or "flat:3,ball:8" (mm); None is the study's
    skip_unreachable : make the presses that can be made, where some cannot
    program : file of presses (`models.press_program`, in the study's frame) in place of a grid
    plant : effects to hide, with their sizes; said in truth.json, not in the study
    on_fault : what follows a press that cannot be made, see `sim.motion.ScanSettings`
    arm : name or folder of the arm
    lab : file of the laboratory, see `palpmap.study.lab`; arm, truth and plant go before its own

    Returns
    -------
    bool
        Whether every press was made and kept what the scan promises (force, overshoot, place) by
        the robot's own readings.
    """
    from rich.markup import escape

    from models import read_program
    from sim.motion import read_tips

    known = default_study() if study is None else load_study(study)
    place = read_lab(lab) if lab else Lab()
    arm, truth = arm or place.arm, truth or place.truth
    plant = plant or [planted(text) for text in place.plant]
    settings: dict[str, JsonValue] = {}
    carried = read_tips(tips, kind_of(known)) if tips else ()
    widest = max((tip.radius_m for tip in carried), default=None)
    if program is None:
        force_n = PAPER_FORCE_N if paper_force else force or DEFAULT_FORCE_N
        settings |= {"force_n": force_n}
        if presses is not None:
            plan = cover_plan_of(known, force_n, presses, seed=seed, radius_m=widest)
            settings |= {"presses": presses}
        else:
            per_side = presses_per_side or PRESSES_PER_SIDE
            plan = grid_plan_of(known, force_n, per_side)
            settings |= {"presses_per_side": per_side}
    else:
        plan = program_plan_of(known, read_program(program, seed))
    if carried:
        plan = plan.with_tips(carried)
        settings["tips"] = [str(tip) for tip in carried]
    if plant:
        settings["plant"] = [list(one) for one in plant]
    if truth:
        settings["truth"] = truth
    true_body = _truth(truth, known, plan, seed)
    inputs = [path for path in (study, program, lab) if path is not None]
    if truth and truth != RANDOM:
        inputs.append(Path(truth))
    if arm != Lab().arm:
        settings["arm"] = arm
    robot = replace(place.settings(scan_settings(seed, paper_force, on_fault)), arm=arm)
    plan = place.placed(plan) if lab else plan
    plan, motion, refused = reachable(plan, robot, skip_unreachable)
    if refused:
        output.say(refused_table(refused))
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
        laboratory, stated = planned_laboratory(
            run.path, known, plan, robot, plant, true_body, motion
        )
        progress.update(task, description="scanning")
        scanned = make_scan(run.path, laboratory, recording, lambda: progress.advance(task))
        write_study(with_touch_error(stated, scanned), run / "study.toml")
        progress.update(task, description="done")
    record = scan_record(scanned)
    output.result(
        {**record.to_dict(), "run": str(run.path)},
        scan_table(record),
        *map(escape, record.not_kept[:LISTED]),
        *([f"... see {escape(str(run / PRESSES))}"] if len(record.not_kept) > LISTED else []),
        *tip_notes(plan),
        f"Next: {escape(to_type('fit', run / 'study.toml'))}",
        f"Recording: {escape(to_type('review', run.path))}",
    )
    return record.kept


def planted(text: str) -> tuple[str, float]:
    """Return name and size of a plant, `NAME`, `NAME:PERCENT` or a file of hooks.

    >>> planted("breathing:5"), planted("own.py")
    (('breathing', 0.05), ('own.py', 1.0))
    """
    if text.endswith(".py"):
        return text, 1.0
    name, _, percent = text.rpartition(":") if ":" in text else (text, "", "")
    try:
        size = float(percent or 3) / 100
    except ValueError:
        size = 0.0
    if not 0 < size <= 1:
        raise InputError(f"plant: found '{text}', expected NAME, NAME:3 (percent) or FILE.py")
    return name, size


def planned_laboratory(
    run: Path,
    study: Study,
    plan: "ScanPlan",
    settings: "ScanSettings",
    plant: Sequence[tuple[str, float]] = (),
    truth: Truth | None = None,
    motion: "Motion | None" = None,
) -> tuple[Laboratory, Study]:
    """Solve the body of a planned scan; write study.toml and truth.json into the run folder.

    Parameters
    ----------
    plant : see `run_scan_command`
    truth, motion : where they are known already

    Returns
    -------
    the laboratory, and the study of what is known beforehand
    """
    laboratory = build_laboratory(study, plan, settings, plant, truth, motion)
    known = known_of(study, run / "scan.csv", laboratory)
    write_study(known, run / "study.toml")
    write_truth(run, laboratory.hidden.body, laboratory.hidden.records)
    return laboratory, known


def scan_settings(
    seed: int, paper_force: bool = False, on_fault: OnFault = "skip"
) -> "ScanSettings":
    """Return the settings of a scan; with `paper_force` presses may go as deep as the body is."""
    from sim.motion import ScanSettings

    share = PAPER_DEEPEST_SHARE if paper_force else ScanSettings.deepest_share
    return ScanSettings(seed=seed, deepest_share=share, on_fault=on_fault)


def _truth(truth: str | None, study: Study, plan: "ScanPlan", seed: int) -> Truth:
    from sim.body import drawn_truth

    if truth is None:
        return Truth(default_truth(plan.body, seed))
    return Truth(drawn_truth(plan.body, seed)) if truth == RANDOM else read_truth(truth, study)


def make_scan(
    run: Path, laboratory: Laboratory, recording: Recording, advance: Callable[[], object]
) -> "ScanRun":
    """Make all presses; scan.csv, presses.json and recording are complete up to the last one."""
    statistics: dict[int, PressStatistics] = {}
    records: list[PressRecord] = []
    samples: list[Series] = []

    def on_outcome(outcome: "PressOutcome") -> None:
        records.append(press_record(outcome, statistics.get(outcome.press)))
        told = PressesRecord(on_fault=laboratory.settings.on_fault, presses=tuple(records))
        told.write(run / PRESSES)
        if outcome.faults or not outcome.kept:
            recording.event(outcome.sentence, "WARN")
        advance()

    def on_press(result: "PressResult", reported: Scan) -> None:
        statistics[result.statistics.press] = result.statistics
        samples.append(result.series)
        write_scan(reported, run / "scan.csv")
        told = reported.rows(reported.press == laboratory.plan.ids[result.statistics.press])
        used = told.used()
        recording.press_done(
            result.statistics.press,
            float(told.time_s[told.phase == "hold"][-1]),
            told.point_m[0],
            float(used.at_largest_force(used.force_n)[0]),
            float(used.at_largest_force(used.displacement_m)[0]),
        )

    drawn = draw_scene(recording, laboratory, true_parameters(laboratory.truth))
    try:
        made, _ = laboratory.press(drawn, on_press, on_outcome)
    finally:
        if samples:
            write_samples(samples, laboratory.plan.ids, run / SAMPLES)
    return made


def write_samples(samples: "Sequence[Series]", ids: "np.ndarray", path: Path) -> None:
    """Write every time step of the presses, as the robot reads them, into a Parquet file."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    from sim.scan import SERIES_PHASES

    def column(name: str) -> "np.ndarray":
        return np.concatenate([getattr(one, name) for one in samples])

    table = {
        "press": np.asarray(ids)[column("press")],
        "time_s": column("time_s"),
        "phase": pa.DictionaryArray.from_arrays(column("phase").astype(np.int8), SERIES_PHASES),
        "force_n": column("force_n").astype(np.float32),
        "displacement_m": column("displacement_m").astype(np.float32),
        "wanted_n": column("wanted_n").astype(np.float32),
    }
    for joint, angles in enumerate(column("q").T, start=1):
        table[f"joint{joint}_rad"] = angles.astype(np.float32)
    pq.write_table(pa.table(table), path, compression="zstd")


class LargestRecord(Record):
    """Largest deviations of the presses from their commands, as only the simulator knows them."""

    force_error: float = Field(description="of the held force, relative")
    overshoot: float = Field(description="of the force, relative")
    contact_error_m: float = Field(description="of the contact's place, m")
    coupling_error: float = Field(description="of body and robot from each other, relative")
    depth_share: float = Field(description="depth of a press over the body's height")


class ScanRecord(FileRecord):
    """Output of `palpmap scan --json`: how well the presses were made."""

    presses: int = Field(description="planned")
    presses_kept: int = Field(description="made, with force and place kept by the readings")
    kept: bool = Field(description="whether all are")
    outcomes: dict[str, int] = Field(
        default_factory=dict, description="presses that were made, retried, skipped, aborted"
    )
    not_kept: tuple[str, ...] = Field(default=(), description="a sentence on each other press")
    largest: LargestRecord
    force_n: float = Field(description="set force of the first press, N")
    simulated_s: float = Field(description="time of the robot, s")
    wall_s: float = Field(description="time of the computer, s")
    real_time_factor: float = Field(description="the robot's time over the computer's")


def scan_record(scanned: "ScanRun") -> ScanRecord:
    """Return how well the presses were made."""
    statistics = scanned.statistics
    largest = LargestRecord(
        force_error=max(abs(s.force_error) for s in statistics),
        overshoot=max(s.overshoot for s in statistics),
        contact_error_m=max(s.contact_error_m for s in statistics),
        coupling_error=max(s.coupling_error for s in statistics),
        depth_share=max(s.depth_share for s in statistics),
    )
    kept = sum(outcome.kept for outcome in scanned.outcomes)
    counts = Counter(outcome.outcome for outcome in scanned.outcomes)
    return ScanRecord(
        presses=len(scanned.outcomes),
        presses_kept=kept,
        kept=kept == len(scanned.outcomes),
        outcomes=dict(counts),
        not_kept=tuple(outcome.sentence for outcome in scanned.outcomes if not outcome.kept),
        largest=largest,
        force_n=statistics[0].set_force_n,
        simulated_s=scanned.simulated_s,
        wall_s=scanned.wall_s,
        real_time_factor=scanned.real_time_factor,
    )


def scan_table(record: ScanRecord) -> "RenderableType":
    """Return how well the presses were made, as a small table."""
    from rich import box
    from rich.table import Table

    largest = record.largest
    table = Table(box=box.SIMPLE, show_header=False, title="scan", title_justify="left")
    table.add_row(
        "presses that kept force and place",
        f"{record.presses_kept} of {record.presses} at {record.force_n:g} N",
    )
    if set(record.outcomes) - {"made"}:
        told = ", ".join(f"{number} {name}" for name, number in record.outcomes.items())
        table.add_row("presses", told)
    table.add_row(
        "largest force error, overshoot",
        f"{100 * largest.force_error:.2f} %, {100 * largest.overshoot:.1f} %",
    )
    table.add_row(
        "largest contact error, coupling error",
        f"{1e3 * largest.contact_error_m:.3f} mm, {100 * largest.coupling_error:.3f} %",
    )
    if largest.depth_share > SMALL_DEPTH_SHARE:
        table.add_row(
            "deepest press",
            f"{100 * largest.depth_share:.0f} % of the body's height; a real body is linear "
            "to about a tenth",
        )
    table.add_row(
        "robot time, computing time",
        f"{record.simulated_s:.0f} s, {record.wall_s:.1f} s "
        f"({record.real_time_factor:.0f} times real time)",
    )
    return table


def refused_table(refused: "Sequence[Refusal]") -> "RenderableType":
    """Return the presses that cannot be made, and why, as a table."""
    from rich import box
    from rich.table import Column, Table

    table = Table(
        "press",
        "place, mm",
        Column("why it is left out", overflow="fold"),
        box=box.SIMPLE,
        title=f"{len(refused)} presses cannot be made",
        title_justify="left",
    )
    for one in refused:
        place = ", ".join(f"{1e3 * value:.1f}" for value in one.point_m)
        table.add_row(str(one.press), place, one.reason)
    return table
