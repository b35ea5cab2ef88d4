"""Presses that the arm can reach and that are left out all the same: too weak, or too deep."""

from __future__ import annotations

import numpy as np

from sim.motion.planned_motion import Refusal
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody

WEAKEST = 2.0
"""Times the touch force that a set force has at least."""

HALVINGS = 30  # of the bracket in which the largest force that would do is sought


def beyond_limits(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> tuple[Refusal, ...]:
    """Return the presses with forces near that of touch, and those that would go too deep."""
    found = ((press, _reason(press, plan, body, settings)) for press in range(len(plan)))
    return tuple(Refusal.of(plan, press, reason) for press, reason in found if reason)


def _reason(press: int, plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> str:
    """Return why a press must not be made; nothing if it may."""
    force = plan.force_of(press)
    if force < WEAKEST * settings.touch_force_n:
        return (
            f"the touch force of {settings.touch_force_n:g} N is more than half of the set force "
            f"of {force:g} N. Press harder or lower touch_force_n."
        )
    thickness, provided = plan.thickness_m(press), settings.largest_depth(force)
    limits = {
        settings.deepest_share * thickness: f"the body is {1e3 * thickness:.3g} mm thick there, of "
        f"which at most {100 * settings.deepest_share:.0f} % may be pressed, as its law is for "
        "small depths",
        plan.tip_of(press).deepest_m: "the ball would sink in whole, beyond the law of its contact",
        provided: f"the scan setting depth_m provides for {1e3 * provided:.3g} mm",
    }
    allowed = min(limits)
    expected = body.displacement(press, force)
    if expected <= allowed:
        return ""
    low, high = 0.0, force
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if body.displacement(press, middle) <= allowed else (low, middle)
    if not np.isfinite(expected):
        return (
            f"the body's law has no equilibrium at {force:.3g} N. Press with at most "
            f"{0.99 * low:.3g} N or with a wider tip."
        )
    return (
        f"{force:.3g} N would go {expected * 1e3:.3g} mm deep; {limits[allowed]}. Press with at "
        f"most {0.99 * low:.3g} N, with a wider tip, or on a thicker or stiffer body."
    )
