"""The virtual laboratory: a planned scan, the body under it, the presses of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from identify.map import GaussianMap
from models import InputError, Scan, stack_scans
from palpmap.study.body import Body
from palpmap.study.body_model import outside_of, support_of
from palpmap.study.study import About, Map, Noise, Probe, Study
from palpmap.study.truth_file import Truth

if TYPE_CHECKING:
    from models import PressProgram
    from sim.body import SoftBody, TruthMap
    from sim.motion import BodySurface, Motion, Refusal, ScanPlan, ScanSettings
    from sim.robot import Placement
    from sim.scan import Frame, PressOutcome, PressResult, RobotPlant, ScanRun

DEFAULT_FORCE_N = 0.3
OFF_SURFACE_M = 1e-3
PRESSES_PER_SIDE = 9
MIDDLE_M = np.array([0.45, 0.0])  # of the body, before the arm
MARGIN_SHARE = 1 / 8  # of the body's edges, from the rim to the first presses: 12 of 96 mm


@dataclass(frozen=True)
class Laboratory:
    """A scan that is planned but not yet made.

    Attributes
    ----------
    plan, settings : how it is made
    body : with the true map and the hidden effects in it
    hidden : hidden effects
    inclusions : of the true map without what is hidden
    motion : of the arm, None is planned when the scan is made
    """

    plan: ScanPlan
    settings: ScanSettings
    body: SoftBody
    hidden: RobotPlant
    inclusions: int
    motion: Motion | None = None

    @property
    def truth(self) -> TruthMap:
        """The true map, with planted inclusions."""
        return self.hidden.body.truth

    def press(
        self,
        on_frame: Callable[[Frame], None] | None = None,
        on_press: Callable[[PressResult, Scan], None] | None = None,
        on_outcome: Callable[[PressOutcome], None] | None = None,
    ) -> tuple[ScanRun, Scan]:
        """Make all presses; return how they went, and the readings that the robot reports.

        Parameters
        ----------
        on_frame : called with each picture of the running scan
        on_press : called after each press that was made, with all reported readings so far
        on_outcome : called for every planned press with what became of it

        Raises
        ------
        InputError
            No press could be made.
        """
        from sim.scan import run_scan

        done: list[Scan] = []

        def reported(result: PressResult) -> None:
            done.append(self.hidden.report(result.scan))
            if on_press:
                on_press(result, stack_scans(done))

        made = run_scan(
            self.plan,
            self.body,
            self.settings,
            on_frame,
            reported,
            on_outcome,
            self.hidden.mechanisms,
            self.motion,
        )
        if not done:
            first = made.outcomes[0]
            raise InputError(
                f"none of {len(made.outcomes)} presses could be made. {first.sentence}"
            )
        return made, stack_scans(done)


def build_laboratory(
    study: Study,
    plan: ScanPlan,
    settings: ScanSettings,
    plant: Sequence[tuple[str, float]] = (),
    truth: Truth | None = None,
    motion: Motion | None = None,
) -> Laboratory:
    """Solve the body of a planned scan.

    Parameters
    ----------
    plant : effects to hide, with their sizes
    truth : of the body; None is `default_truth`
    motion : of the plan, where it is known already
    """
    from sim.body import HiddenBody, SoftBody
    from sim.scan import plant_on_robot

    truth = truth or Truth(default_truth(plan.body, settings.seed))
    block = study.body.size_m
    if plant and block is None:
        raise InputError(
            'effects can be planted in blocks; the study has body.shape = "surface": leave out '
            "--plant"
        )
    size = block or tuple(plan.body.extent_m)
    hidden = plant_on_robot(
        plant, plan, settings, HiddenBody(size, study.body.poisson_ratio, truth.map)
    )
    body = SoftBody(
        block or (plan.body.vertices_m, plan.body.triangles),
        hidden.pressed.modulus if plant else truth.map,
        hidden.pressed.poisson_ratio,
        [plan.tip_of(press) for press in range(len(plan))],
        plan.points_m,
        plan.directions,
        support=support_of(study.body),
        force_n=np.array([plan.force_of(press) for press in range(len(plan))]),
        law=truth.law,
        creep=truth.creep,
        bend_per_m=plan.body.bends(plan.points_m, -plan.directions, 0.5 * plan.radii_m),
    )
    return Laboratory(plan, settings, body, hidden, len(truth.map.inclusions), motion)


def known_of(study: Study, scan: Path, laboratory: Laboratory) -> Study:
    """Return the facts known before a scan: noise, number of inclusions, tip, place."""
    settings = laboratory.settings
    noise = Noise(displacement_m=settings.displacement_noise_m, force_n=settings.force_noise_n)
    return study.model_copy(
        update={
            "study": About(name=study.name, scan=scan.resolve()),  # pyright: ignore[reportCallIssue]
            "noise": noise,
            "map": Map(inclusions=laboratory.inclusions),
            "body": study.body.model_copy(update={"origin_m": (0.0, 0.0, 0.0)}),
            "probe": probe_of(laboratory.plan),
        }
    )


def with_touch_error(study: Study, made: ScanRun) -> Study:
    """Return the study with the error of first touch that the robot states for its presses.

    One below half of the noise of a reading is left out.
    """
    errors = [press.judged.touch_sd_m for press in made.presses]
    touch_m = float(np.sqrt(np.mean(np.square(errors))))
    if touch_m < (study.noise.displacement_m or 0.0) / 2:
        return study
    noise = study.noise.model_copy(update={"touch_m": float(f"{touch_m:.2g}")})
    return study.model_copy(update={"noise": noise})


def probe_of(plan: ScanPlan) -> Probe:
    """Return the tip that a study of a plan's scan states."""
    kinds = _kinds(plan)
    tip = "several" if len(kinds) > 1 else {"ball": "sphere"}.get(kinds[0], kinds[0])
    return Probe.model_validate({"tip": tip, "radius_m": plan.tip_of(0).radius_m})


def tip_notes(plan: ScanPlan) -> tuple[str, ...]:
    """Name the tips of a plan that no fit takes."""
    kinds = _kinds(plan)
    if kinds in (["ball"], ["flat"]):
        return ()
    return (
        f"Tips: {', '.join(kinds)}. A fit knows flat tips or balls, one kind at a time: it will "
        "refuse this scan. Press with each kind in a scan of its own.",
    )


def _kinds(plan: ScanPlan) -> list[str]:
    return sorted({plan.tip_of(press).kind for press in range(len(plan))})


def default_study() -> Study:
    """Return the study of the built-in phantom: the paper's block, a flat tip of 5 mm."""
    return Study(
        study=About(name="virtual phantom", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005),
    )


def kind_of(study: Study) -> Literal["flat", "ball"]:
    """Return the laboratory's word for a study's tip."""
    return "ball" if study.probe.tip == "sphere" else "flat"


def surface_of(study: Study) -> BodySurface:
    """Return the surface of a study's body, body frame.

    Raises
    ------
    fem.errors.MeshError
        A surface that cannot be used.
    """
    from sim.motion import BodySurface

    if study.body.size_m is not None:
        return BodySurface.block(study.body.size_m)
    return BodySurface(*outside_of(study.body))


def grid_plan_of(study: Study, force_n: float, per_side: int) -> ScanPlan:
    """Plan a grid of presses on a study's body: level rows on a block, else spread evenly."""
    if study.body.size_m is None:
        return cover_plan_of(study, force_n, per_side**2)
    points = _grid(study.body.size_m, per_side)
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return plan_at(study, points, down, force_n)


def cover_plan_of(
    study: Study,
    force_n: float,
    presses: int,
    steepest_deg: float | None = None,
    seed: int = 0,
    radius_m: float | None = None,
) -> ScanPlan:
    """Plan presses that cover the upper surface of a study's body evenly, along its normals.

    Parameters
    ----------
    steepest_deg : largest angle of a press to the vertical
    radius_m : of the widest tip, None is the study's

    Raises
    ------
    InputError
        A body without room for the presses.
    """
    from sim.motion import STEEPEST_DEG

    steepest = STEEPEST_DEG if steepest_deg is None else steepest_deg
    footing = surface_of(study).cover(presses, radius_m or study.probe.radius_m, steepest, seed)
    return plan_at(study, footing.points_m, -footing.normals, force_n)


def plan_at(study: Study, points: np.ndarray, directions: np.ndarray, force_n: float) -> ScanPlan:
    """Plan presses at points (j, 3) of a study's body, body frame, with one force."""
    from sim.motion import ScanPlan, Tip

    surface = surface_of(study)
    block = study.body.size_m
    return ScanPlan(
        points,
        directions,
        force_n=force_n,
        tip_radius_m=study.probe.radius_m,
        tips=(Tip(kind_of(study), study.probe.radius_m),) * len(points),
        body_size_m=block or tuple(surface.extent_m),
        body_in_world=stand_of(surface),
        surface=None if block else surface,
    )


def stand_of(surface: BodySurface) -> Placement:
    """Return where a body stands: on the table, its middle before the arm."""
    from sim.robot import Placement

    low = surface.lowest_m
    x, y = MIDDLE_M - low[:2] - surface.extent_m[:2] / 2
    return Placement((float(x), float(y), float(-low[2])))


def reachable(
    plan: ScanPlan, settings: ScanSettings, skip: bool = False
) -> tuple[ScanPlan, Motion, tuple[Refusal, ...]]:
    """Plan the motion of all presses, before any body is solved.

    Parameters
    ----------
    skip : leave out presses that cannot be made

    Returns
    -------
    the plan and the motion of the presses that can be made, and those that cannot

    Raises
    ------
    InputError
        No press can be made, or, without `skip`, some cannot.
    """
    from sim.motion import Motion, plan_motion, plan_scene

    arm = plan_scene(plan, settings)
    motion = plan_motion(plan, arm, settings)
    if not motion.refused:
        return plan, motion, ()
    if not motion.presses or not skip:
        count = len(motion.refused)
        more = f" ({count} of {len(plan)} presses cannot be made)" if count > 1 else ""
        hint = "" if not motion.presses else "; --skip-unreachable makes the others"
        raise InputError(f"{motion.refused[0]}{more}{hint}")
    kept = np.delete(np.arange(len(plan)), [refusal.press for refusal in motion.refused])
    return plan.only(kept), Motion(motion.presses), motion.refused


def program_plan_of(study: Study, program: PressProgram, **settings: object) -> ScanPlan:
    """Plan the presses of a program, which is in the study's frame, on the study's body.

    Raises
    ------
    InputError
        Presses beside the body.
    """
    from sim.motion import program_plan

    surface = surface_of(study)
    x, y, z = study.body.origin_m
    moved = replace(program, x_m=program.x_m - x, y_m=program.y_m - y, z_m=program.z_m - z)
    return program_plan(
        moved,
        study.body.size_m or surface,
        kind_of(study),
        body_in_world=stand_of(surface),
        **settings,
    )


def default_truth(surface: BodySurface, seed: int = 0) -> TruthMap:
    """Return the phantom's map scaled into a body, or one drawn by seed where it does not fit."""
    from sim.body import drawn_truth

    scaled = scaled_truth(tuple(surface.extent_m), surface.lowest_m)
    centres = np.array([inclusion.centre_m for inclusion in scaled.inclusions])
    block = len(surface.triangles) == 12
    return scaled if block and surface.contains(centres).all() else drawn_truth(surface, seed)


def truth_of(found: GaussianMap, origin_m: np.ndarray | float = 0.0) -> TruthMap:
    """Return a map as the laboratory knows it, moved into the body's frame."""
    from sim.body import Inclusion, TruthMap

    spots = (
        (i.weight_pa, tuple(np.array([i.x_m, i.y_m, i.z_m]) - origin_m), i.radius_m)
        for i in found.inclusions
    )
    return TruthMap(found.background_pa, tuple(Inclusion(*spot) for spot in spots))


def scaled_truth(size: tuple[float, ...], low: np.ndarray | None = None) -> TruthMap:
    """Return the phantom's true map, its inclusion moved and scaled with the body."""
    from sim.body import Inclusion, TruthMap

    default, paper = TruthMap(), (0.096, 0.096, 0.048)
    share = [s / p for s, p in zip(size, paper, strict=True)]
    start = np.zeros(3) if low is None else low
    inclusions = tuple(
        Inclusion(
            inclusion.weight_pa,
            tuple(o + c * s for o, c, s in zip(start, inclusion.centre_m, share, strict=True)),  # pyright: ignore[reportArgumentType]
            inclusion.radius_m * min(share),
        )
        for inclusion in default.inclusions
    )
    return TruthMap(default.background_pa, inclusions)


def _grid(size: tuple[float, float, float], per_side: int) -> np.ndarray:
    """Points of the presses, row by row to and fro, (j, 3) m."""
    x, y = (np.linspace(MARGIN_SHARE * s, (1 - MARGIN_SHARE) * s, per_side) for s in size[:2])
    rows = [(xi, yk, size[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])]
    return np.array(rows)
