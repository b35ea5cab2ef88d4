"""The presses of a virtual scan, planned on a study's body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from palpmap.study.body_model import outside_of
from palpmap.study.study import Probe, Study

if TYPE_CHECKING:
    from models import PressProgram
    from sim.motion import BodySurface, Motion, ScanPlan, ScanSettings, Tip
    from sim.robot import Placement

DEFAULT_FORCE_N = 0.3
PRESSES_PER_SIDE = 9
MIDDLE_M = np.array([0.45, 0.0])  # of the body, before the arm
MARGIN_SHARE = 1 / 8  # of the body's edges, from the rim to the first presses: 12 of 96 mm


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


def plan_presses(
    study: Study,
    force_n: float = DEFAULT_FORCE_N,
    *,
    program: PressProgram | None = None,
    presses: int | None = None,
    per_side: int = PRESSES_PER_SIDE,
    tips: Sequence[Tip] = (),
    seed: int = 0,
) -> ScanPlan:
    """Plan a program of presses, a number that cover the body evenly, or a grid.

    Parameters
    ----------
    program : see `program_plan_of`; it has forces of its own
    presses : see `cover_plan_of`
    per_side : of the grid
    tips : that take turns
    seed : of the cover
    """
    if program is not None:
        plan = program_plan_of(study, program)
    elif presses is not None:
        widest = max((tip.radius_m for tip in tips), default=None)
        plan = cover_plan_of(study, force_n, presses, widest, seed)
    else:
        plan = grid_plan_of(study, force_n, per_side)
    return plan.with_tips(tips) if tips else plan


def grid_plan_of(study: Study, force_n: float, per_side: int) -> ScanPlan:
    """Plan a grid of presses on a study's body: level rows on a block, else spread evenly."""
    if study.body.size_m is None:
        return cover_plan_of(study, force_n, per_side**2)
    points = _grid(study.body.size_m, per_side)
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return plan_at(study, points, down, force_n)


def cover_plan_of(
    study: Study, force_n: float, presses: int, radius_m: float | None = None, seed: int = 0
) -> ScanPlan:
    """Plan presses that cover the upper surface of a study's body evenly, along its normals.

    Parameters
    ----------
    radius_m : of the widest tip, None is the study's

    Raises
    ------
    InputError
        A body without room for the presses.
    """
    footing = surface_of(study).cover(presses, radius_m or study.probe.radius_m, seed=seed)
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
        origin_m=study.body.origin_m,
    )


def stand_of(surface: BodySurface) -> Placement:
    """Return where a body stands: on the table, its middle before the arm."""
    from sim.robot import Placement

    low = surface.lowest_m
    x, y = MIDDLE_M - low[:2] - surface.extent_m[:2] / 2
    return Placement((float(x), float(y), float(-low[2])))


def reachable(plan: ScanPlan, settings: ScanSettings) -> tuple[ScanPlan, Motion]:
    """Plan the motion of all presses, before any body is solved.

    Returns
    -------
    the plan of the presses that can be made, and the motion, which names those that cannot

    Raises
    ------
    InputError
        No press can be made or, where a fault stops the scan, some cannot.
    """
    from sim.motion import plan_motion, plan_scene, refuse

    motion = plan_motion(plan, plan_scene(plan, settings), settings)
    refuse(motion.refused, len(plan), settings.on_fault != "stop")
    made = ~np.isin(plan.ids, [one.press for one in motion.refused])
    return plan.only(np.flatnonzero(made)), motion


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
        study.body.origin_m,
        body_in_world=stand_of(surface),
        **settings,
    )


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


def _grid(size: tuple[float, float, float], per_side: int) -> np.ndarray:
    """Points of the presses, row by row to and fro, (j, 3) m."""
    x, y = (np.linspace(MARGIN_SHARE * s, (1 - MARGIN_SHARE) * s, per_side) for s in size[:2])
    rows = [(xi, yk, size[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])]
    return np.array(rows)
