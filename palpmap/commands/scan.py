"""`palpmap scan`: the virtual laboratory's robot presses on a soft body."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import JsonValue

from models import InputError, Scan, write_scan
from palpmap.commands.growing_map import GrowingMap
from palpmap.commands.scan_scene import draw_scene
from palpmap.commands.scan_truth import true_parameters, truth_of_scan, write_truth
from palpmap.console import Output, to_type
from palpmap.progress import scan_stages
from palpmap.recording.recorder import Recording
from palpmap.recording.viewer import ViewerError, live_viewer
from palpmap.report.scan_console import refused_table, scan_table
from palpmap.result.press_outcomes import FILE as PRESSES
from palpmap.result.press_outcomes import PressesRecord, PressRecord, press_record
from palpmap.result.scan_record import ScanRecord, scan_record
from palpmap.run_files import samples as all_samples
from palpmap.run_folder import RunFolder
from palpmap.study.lab import Lab, read_lab
from palpmap.study.press_plan import (
    DEFAULT_FORCE_N,
    PRESSES_PER_SIDE,
    kind_of,
    plan_presses,
    reachable,
    tip_notes,
)
from palpmap.study.study import Study, load_study, write_study
from palpmap.study.truth_file import Truth, read_truth
from palpmap.study.virtual_lab import (
    Laboratory,
    build_laboratory,
    default_study,
    default_truth,
    known_of,
    with_touch_error,
)

if TYPE_CHECKING:
    from sim.motion import Motion, ScanPlan, ScanSettings
    from sim.scan import PressOutcome, PressResult, PressStatistics, ScanRun, Series

OnFault = Literal["skip", "retry", "stop"]

PAPER_FORCE_N = 3.0
LISTED = 10
RANDOM = "random"
SCAN_PARTS = ("robot", "body", "presses", "truth", "events", "about")

PAPER_DEEPEST_SHARE = 1.0  # the paper's 3 N press the linear phantom nearly flat


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
    tips: str | None = None,
    arm: str | None = None,
    lab: Path | None = None,
    live: bool = False,
) -> bool:
    """Scan the built-in phantom, or a study's body.

    Parameters
    ----------
    presses_per_side : of the grid, None for `PRESSES_PER_SIDE`
    presses : number of presses that cover the upper surface evenly, in place of a grid
    truth : file of the true map, or "random" for one drawn by the seed; None is the phantom's,
        scaled into a block, and a random one in other bodies
    tips : that take turns, as "3,10" or "flat:3,ball:8" (mm); None is the study's
    program : file of presses (`models.press_program`, in the study's frame) in place of a grid
    plant : effects to hide, with their sizes; said in truth.json, not in the study
    on_fault : what follows a press that cannot be made, see `sim.motion.ScanSettings`
    arm : name or folder of the arm
    lab : file of the laboratory, see `palpmap.study.lab`; arm, truth and plant go before its own
    live : a viewer shows the scan while it is made, and the map that the presses so far tell

    Returns
    -------
    bool
        Whether every press was made and kept what the scan promises (force, overshoot, place) by
        the robot's own readings.
    """
    from sim.scan import refuse_plants

    known = default_study() if study is None else load_study(study, scanned=False)
    place = read_lab(lab) if lab else Lab()
    arm, truth = arm or place.arm, truth or place.truth
    plant = plant or [planted(text) for text in place.plant]
    refuse_plants(plant)
    force_n = PAPER_FORCE_N if paper_force else force or DEFAULT_FORCE_N
    plan, settings = _planned(known, program, force_n, presses, presses_per_side, tips, seed)
    settings |= _asked(plant, truth, arm)
    true_body = _truth(truth, known, plan, seed)
    inputs = [Path(path) for path in (study, program, lab, truth) if path and path != RANDOM]
    robot = replace(place.settings(scan_settings(seed, paper_force, on_fault)), arm=arm)
    plan = place.placed(plan) if lab else plan
    plan, motion = reachable(plan, robot)
    if motion.refused:
        output.say(refused_table(motion.refused))
    count = len(plan) + len(motion.refused)
    with (
        RunFolder("scan", out, seed=seed, settings=settings, inputs=inputs) as run,
        output.task(scan_stages(count)) as task,
        _recording(run, seed, count, viewer := _viewer(output) if live else None) as recording,
    ):
        task.say("meshing and solving the body")
        laboratory, stated = planned_laboratory(
            run.path, known, plan, robot, plant, true_body, motion
        )
        task.say("scanning")
        shown = GrowingMap(recording, stated) if viewer and not tip_notes(plan) else None
        scanned = make_scan(run.path, laboratory, recording, task.advance, shown)
        write_study(with_touch_error(stated, scanned), run / "study.toml")
    record = scan_record(scanned)
    _show(record, run, plan, output)
    return record.kept


def _planned(
    study: Study,
    program: Path | None,
    force_n: float,
    presses: int | None,
    presses_per_side: int | None,
    tips: str | None,
    seed: int,
) -> tuple["ScanPlan", dict[str, JsonValue]]:
    """Plan a program, a cover or a grid of presses; return the plan and its settings."""
    from models import read_program
    from sim.motion import read_tips

    carried = read_tips(tips, kind_of(study)) if tips else ()
    per_side = presses_per_side or PRESSES_PER_SIDE
    places = {"presses_per_side": per_side} if presses is None else {"presses": presses}
    settings: dict[str, JsonValue] = {} if program else {"force_n": force_n, **places}
    if carried:
        settings["tips"] = [str(tip) for tip in carried]
    plan = plan_presses(
        study,
        force_n,
        program=read_program(program, seed) if program else None,
        presses=presses,
        per_side=per_side,
        tips=carried,
        seed=seed,
    )
    return plan, settings


def _asked(plant: Sequence[tuple[str, float]], truth: str | None, arm: str) -> dict[str, JsonValue]:
    """Return the options beyond the usual ones, as run.json keeps them."""
    plants: list[JsonValue] = [list(one) for one in plant]
    asked: dict[str, JsonValue] = {"plant": plants, "truth": truth, "arm": arm}
    usual = {"plant": [], "truth": None, "arm": Lab().arm}
    return {name: value for name, value in asked.items() if value != usual[name]}


def _show(record: ScanRecord, run: RunFolder, plan: "ScanPlan", output: Output) -> None:
    from rich.markup import escape

    output.result(
        {**record.to_dict(), "run": str(run.path)},
        scan_table(record),
        *map(escape, record.not_kept[:LISTED]),
        *([f"... see {escape(str(run / PRESSES))}"] if len(record.not_kept) > LISTED else []),
        *(tip_notes(plan) or (f"Next: {escape(to_type('fit', run / 'study.toml'))}",)),
        f"Recording: {escape(to_type('review', run.path))}",
    )


def _recording(run: RunFolder, seed: int, presses: int, viewer: str | None) -> Recording:
    """Begin the recording of a scan, which a viewer at this address shows, too."""
    return Recording(
        run / "recording.rrd",
        "virtual scan",
        seed=seed,
        planned_presses=presses,
        parts=SCAN_PARTS,
        live=viewer,
    )


def _viewer(output: Output) -> str | None:
    """Return the address of a viewer; say why there is none, and go on without."""
    try:
        return live_viewer()
    except (ViewerError, InputError) as error:
        output.say(f"Not shown live: {error}")
        return None


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
    if not (0 < size <= 1 and name) or "=" in name:
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
    laboratory = build_laboratory(study, plan, settings, plant, truth, motion).within_depth()
    known = known_of(study, run / "scan.csv", laboratory)
    write_study(known, run / "study.toml")
    write_truth(run, laboratory.hidden.body, laboratory.hidden.records, truth)
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
    if truth == RANDOM:
        return Truth(drawn_truth(plan.body, seed))
    if not truth.endswith(".json"):
        return read_truth(truth, study)
    return truth_of_scan(Path(truth))


def make_scan(
    run: Path,
    laboratory: Laboratory,
    recording: Recording,
    advance: Callable[[], object],
    map_so_far: GrowingMap | None = None,
) -> "ScanRun":
    """Make all presses; scan.csv, presses.json and recording are complete up to the last one."""
    statistics: dict[int, PressStatistics] = {}
    records: list[PressRecord] = []
    samples: list[Series] = []

    def on_outcome(outcome: "PressOutcome") -> None:
        records.append(press_record(outcome, statistics.get(outcome.press)))
        records.sort(key=lambda record: record.press)
        told = PressesRecord(on_fault=laboratory.settings.on_fault, presses=tuple(records))
        told.write(run / PRESSES)
        if outcome.reason:
            recording.event(outcome.sentence, "INFO" if outcome.kept else "WARN")
        advance()

    def on_press(result: "PressResult", reported: Scan) -> None:
        statistics[result.statistics.press] = result.statistics
        samples.append(result.series)
        write_scan(reported, run / "scan.csv")
        told = reported.rows(reported.press == result.statistics.press)
        used = told.used()
        recording.press_done(
            result.statistics.press,
            float(told.time_s[told.phase == "hold"][-1]),
            told.point_m[0] - laboratory.plan.origin_m,
            float(used.at_largest_force(used.force_n)[0]),
            float(used.at_largest_force(used.displacement_m)[0]),
        )
        if map_so_far is not None:
            map_so_far.follow(reported)

    drawn = draw_scene(recording, laboratory, true_parameters(laboratory.truth))
    try:
        made, reported = laboratory.press(drawn, on_press, on_outcome)
        if map_so_far is not None and made.presses:
            map_so_far.follow(reported, whole=True)
    finally:
        if samples:
            path = run / all_samples.FILE
            all_samples.write_samples(samples, path)
    return made
