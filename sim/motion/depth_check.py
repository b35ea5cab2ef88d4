"""Presses that are in reach of the arm and cannot be made as asked all the same."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.motion.planned_motion import Refusal
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody

WEAKEST = 2.0
"""Times the touch force that a set force has at least."""

HALVINGS = 30  # of the bracket in which the largest force that would do is sought


class _Beyond(NamedTuple):
    """What is wrong with a press, and what to do; the force that would do, N."""

    what: str
    advice: str
    enough_n: float


def beyond_limits(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> tuple[Refusal, ...]:
    """Return the presses with forces near that of touch, and those that would go too deep."""
    found = ((press, _beyond(press, plan, body, settings)) for press in range(len(plan)))
    return tuple(Refusal.of(plan, j, f"{one.what}. {one.advice}") for j, one in found if one)


def lowered(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> ScanPlan:
    """Return the plan with less force where a press would go too deep.

    The presses of a program keep their forces.
    """
    if plan.program is not None:
        return plan
    force, why = [plan.force_of(press) for press in range(len(plan))], [""] * len(plan)
    for press, asked in enumerate(force):
        one = _beyond(press, plan, body, settings)
        if one and one.enough_n >= WEAKEST * settings.touch_force_n:
            force[press] = one.enough_n
            why[press] = f"with {one.enough_n:.3g} N in place of {asked:.3g} N: {one.what}"
    return replace(plan, forces_n=np.array(force), lowered=tuple(why)) if any(why) else plan


def _beyond(
    press: int, plan: ScanPlan, body: PressedBody, settings: ScanSettings
) -> _Beyond | None:
    """Return why a press must not be made as it is planned, None if it may."""
    force = plan.force_of(press)
    if force < WEAKEST * settings.touch_force_n:
        return _Beyond(
            f"the touch force of {settings.touch_force_n:g} N is more than half of the set force "
            f"of {force:g} N", "Press harder or lower touch_force_n.", 0.0
        )  # fmt: skip
    thickness, provided = plan.thickness_m(press), settings.largest_depth(force)
    limits = {
        settings.deepest_share * thickness: f"the body is {1e3 * thickness:.3g} mm thick there, of "
        f"which at most {100 * settings.deepest_share:.0f} % may be pressed, as its law is for "
        "small depths",
        plan.tip_of(press).deepest_m: "the ball would sink in whole, beyond the law of its contact",
        provided: f"the scan setting depth_m provides for {1e3 * provided:.3g} mm",
    }
    allowed, expected = min(limits), body.displacement(press, force)
    if expected <= allowed:
        return None
    low, high = 0.0, force
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if body.displacement(press, middle) <= allowed else (low, middle)
    enough = 0.99 * low
    if not np.isfinite(expected):
        what = f"the body's law has no equilibrium at {force:.3g} N"
        return _Beyond(what, f"Press with at most {enough:.3g} N or with a wider tip.", enough)
    return _Beyond(
        f"{force:.3g} N would go {expected * 1e3:.3g} mm deep; {limits[allowed]}",
        f"Press with at most {enough:.3g} N, with a wider tip, or on a thicker or stiffer body.",
        enough,
    )
