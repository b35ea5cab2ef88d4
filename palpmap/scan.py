"""`palpmap scan`: the virtual laboratory's robot presses on a soft body."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import InputError
from models.scan import Scan, write_scan
from palpmap.console import Output, to_type
from palpmap.recording import Recording
from palpmap.recording_frames import Frame as DrawnFrame
from palpmap.recording_maps import map_views
from palpmap.recording_scene import LinkShape, link_names
from palpmap.run_folder import RunFolder, write_record
from palpmap.study import About, Body, Map, Noise, Probe, Study, load_study, write_study

if TYPE_CHECKING:
    import mujoco
    from rich.console import RenderableType

    from sim.scan_plan import ScanPlan
    from sim.scan_run import Frame, PressResult, ScanRun
    from sim.settings import ScanSettings
    from sim.soft_body import SoftBody
    from sim.truth_map import TruthMap

DEFAULT_FORCE_N = 0.3
PAPER_FORCE_N = 3.0
MARGIN_SHARE = 1 / 8  # of the body's edges, from the rim to the first presses: 12 of 96 mm
SCAN_PARTS = ("robot", "body", "presses", "truth", "events", "about")

# What the scan promises of each press
LARGEST_FORCE_ERROR = 0.01
LARGEST_OVERSHOOT = 0.05
LARGEST_CONTACT_ERROR_M = 2e-4
LARGEST_COUPLING_ERROR = 1e-3


@dataclass(frozen=True)
class Laboratory:
    """A scan that is planned but not yet made: plan, body with its truth, settings, study."""

    plan: "ScanPlan"
    truth: "TruthMap"
    body: "SoftBody"
    settings: "ScanSettings"
    study: Study


def run_scan_command(
    *,
    study: Path | None,
    force: float | None,
    paper_force: bool,
    presses_per_side: int,
    out: Path | None,
    seed: int,
    output: Output,
) -> bool:
    """Scan the built-in phantom, or a study's block with the phantom's map scaled into it.

    Returns
    -------
    bool
        Whether every press kept what the scan promises (force, overshoot, place, coupling).
    """
    from rich.markup import escape

    force_n = PAPER_FORCE_N if paper_force else force or DEFAULT_FORCE_N
    settings = {"force_n": force_n, "presses_per_side": presses_per_side}
    known = None if study is None else load_study(study)
    inputs = [] if study is None else [study]
    with (
        RunFolder("scan", out, seed=seed, settings=settings, inputs=inputs) as run,
        output.progress() as progress,
        Recording(
            run / "recording.rrd",
            "virtual scan",
            seed=seed,
            planned_presses=presses_per_side**2,
            parts=SCAN_PARTS,
        ) as recording,
    ):
        task = progress.add_task("meshing and solving the body", total=presses_per_side**2)
        laboratory = build_laboratory(run.path, known, force_n, presses_per_side, seed)
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


def build_laboratory(
    run: Path, study: Study | None, force_n: float, presses_per_side: int, seed: int
) -> Laboratory:
    """Plan the scan and solve the body; write study.toml and truth.json into the run folder.

    Raises
    ------
    InputError
        A study whose body or tip the laboratory does not have.
    """
    from sim.scan_plan import ScanPlan
    from sim.settings import ScanSettings
    from sim.soft_body import SoftBody

    settings = ScanSettings(seed=seed)
    study = study or default_study()
    _refuse_unknown(study)
    size = study.body.size_m
    assert size is not None  # a block has one
    truth = scaled_truth(size)
    points = _grid(size, presses_per_side)
    plan = ScanPlan(
        points,
        np.tile([0.0, 0.0, -1.0], (len(points), 1)),
        force_n=force_n,
        tip_radius_m=study.probe.radius_m,
        body_size_m=size,
    )
    body = SoftBody(
        size, truth, study.body.poisson_ratio, plan.tip_radius_m, plan.points_m, plan.directions
    )
    about = About(name=study.name, scan=(run / "scan.csv").resolve())  # pyright: ignore[reportCallIssue]
    noise = Noise(displacement_m=settings.displacement_noise_m, force_n=settings.force_noise_n)
    kept = study.model_copy(
        update={
            "study": about,
            "noise": noise,
            "map": Map(inclusions=len(truth.inclusions)),
            "body": study.body.model_copy(update={"origin_m": (0.0, 0.0, 0.0)}),
        }
    )
    write_study(kept, run / "study.toml")
    write_record(run / "truth.json", {"body": truth_record(truth)})
    return Laboratory(plan, truth, body, settings, kept)


def make_scan(
    run: Path, laboratory: Laboratory, recording: Recording, advance: Callable[[], object]
) -> "ScanRun":
    """Make all presses; scan.csv and the recording are complete up to the last one at any time."""
    from sim.scan_program import run_scan
    from sim.scan_run import join_scans

    drawn = _draw_scene(recording, laboratory)
    done: list[Scan] = []

    def on_press(result: "PressResult") -> None:
        done.append(result.scan)
        write_scan(join_scans(done), run / "scan.csv")
        held = result.scan.phase == "hold"
        recording.press_done(
            result.statistics.press,
            float(result.scan.time_s[held][-1]),
            result.scan.point_m[0],
            float(result.scan.force_n[held].mean()),
            float(result.scan.displacement_m[held].mean()),
        )
        advance()

    return run_scan(laboratory.plan, laboratory.body, laboratory.settings, drawn, on_press)


def default_study() -> Study:
    """Return the study of the built-in phantom: the paper's block, a flat tip of 5 mm."""
    return Study(
        study=About(name="virtual phantom", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005),
    )


def _refuse_unknown(study: Study) -> None:
    if study.body.size_m is None:
        raise InputError(
            'the laboratory presses on blocks; the study has body.shape = "surface": give a study '
            "of a block to scan"
        )
    if study.probe.tip != "flat":
        raise InputError(
            'the laboratory presses with a flat tip; the study has probe.tip = "sphere": give '
            'probe.tip = "flat" to scan'
        )


def _grid(size: tuple[float, float, float], per_side: int) -> np.ndarray:
    """Points of the presses, row by row to and fro, (j, 3) m."""
    x, y = (np.linspace(MARGIN_SHARE * s, (1 - MARGIN_SHARE) * s, per_side) for s in size[:2])
    rows = [(xi, yk, size[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])]
    return np.array(rows)


def scaled_truth(size: tuple[float, float, float]) -> "TruthMap":
    """Return the phantom's true map, its inclusion moved and scaled with the body."""
    from sim.truth_map import Inclusion, TruthMap

    default, paper = TruthMap(), (0.096, 0.096, 0.048)
    share = [s / p for s, p in zip(size, paper, strict=True)]
    inclusions = tuple(
        Inclusion(
            inclusion.weight_pa,
            tuple(c * s for c, s in zip(inclusion.centre_m, share, strict=True)),  # pyright: ignore[reportArgumentType]
            inclusion.radius_m * min(share),
        )
        for inclusion in default.inclusions
    )
    return TruthMap(default.background_pa, inclusions)


def truth_record(truth: "TruthMap") -> dict[str, Any]:
    """Return the true map as a JSON record."""
    return {
        "background_pa": truth.background_pa,
        "inclusions": [
            {
                "weight_pa": i.weight_pa,
                **dict(zip(("x_m", "y_m", "z_m"), i.centre_m, strict=True)),
                "radius_m": i.radius_m,
            }
            for i in truth.inclusions
        ],
    }


def true_parameters(truth: "TruthMap") -> dict[str, float]:
    """Return the true map's values by parameter name."""
    record = truth_record(truth)
    values = {"background_pa": record["background_pa"]}
    for number, inclusion in enumerate(record["inclusions"], start=1):
        values |= {f"inclusion_{number}.{name}": value for name, value in inclusion.items()}
    return values


def scan_record(scanned: "ScanRun") -> dict[str, Any]:
    """Return how well the presses were made, as a JSON record."""
    statistics = scanned.statistics
    largest = {
        "force_error": max(abs(s.force_error) for s in statistics),
        "overshoot": max(s.overshoot for s in statistics),
        "contact_error_m": max(s.contact_error_m for s in statistics),
        "coupling_error": max(s.coupling_error for s in statistics),
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
    table.add_row(
        "robot time, computing time",
        f"{record['simulated_s']:.0f} s, {record['wall_s']:.1f} s "
        f"({record['real_time_factor']:.0f} times real time)",
    )
    return table


def _draw_scene(recording: Recording, laboratory: Laboratory) -> "Callable[[Frame], None]":
    """Put arm, body and truth into the recording; return what draws a frame."""
    from models.arm import LINKS
    from sim.laboratory import build_laboratory as build_arm

    plan, body = laboratory.plan, laboratory.body
    place = plan.body_in_world
    shapes = arm_shapes(build_arm(plan.tip_radius_m, plan.body_size_m, place).model)
    drawn = link_names(shapes)
    order = [LINKS.index(name) for name in drawn]
    views = map_views(laboratory.truth, np.zeros(3), np.array(plan.body_size_m))
    recording.truth(views, true_parameters(laboratory.truth))
    recording.scene(
        body.surface_nodes_m,
        body.surface_triangles,
        links=shapes,
        body_modulus_pa=laboratory.truth(body.surface_nodes_m),
        body_position_m=place.position_m,
        body_quaternion=place.quaternion,
        arrow_m_per_n=0.02 / plan.force_n,
    )
    to_body = place.rotation.T

    def draw(frame: "Frame") -> None:
        touching = frame.phase in ("touch", "load", "hold", "unload")
        poses = np.hstack([frame.positions_m, frame.quaternions])[order]
        recording.frame(
            DrawnFrame(
                frame.time_s,
                poses,
                frame.force_n,
                max(frame.displacement_m, 0.0) if touching else 0.0,
                plan.points_m[frame.press],
                to_body @ frame.force_vector_n,
                lambda: body.surface_displacement(frame.press, max(frame.force_n, 0.0)),
            )
        )

    return draw


def arm_shapes(model: "mujoco.MjModel") -> list[LinkShape]:
    """Return the drawable geoms of the arm's links and the probe, from the compiled model."""
    import mujoco

    from models.arm import LINKS

    kinds = {
        mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
        mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
        mujoco.mjtGeom.mjGEOM_BOX: "box",
        mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    }
    shapes = []
    for geom in range(model.ngeom):
        link = model.body(model.geom_bodyid[geom]).name
        kind = kinds.get(mujoco.mjtGeom(model.geom_type[geom]))
        if link in LINKS and kind and model.geom_group[geom] < 3:
            shapes.append(
                LinkShape(
                    link,
                    kind,
                    model.geom_size[geom].copy(),
                    model.geom_pos[geom].copy(),
                    model.geom_quat[geom].copy(),
                    model.geom_rgba[geom].copy(),
                )
            )
    return shapes
