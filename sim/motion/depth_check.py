"""Whether a body and the scan's settings allow the depths to which its presses would go."""

from __future__ import annotations

import numpy as np

from models import InputError
from sim.motion.planned_motion import in_mm
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody


def refuse_too_deep(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> None:
    """Refuse a scan in which a press would go deeper than body or settings allow.

    Raises
    ------
    InputError
        It names the press that goes furthest beyond, and the force that would do.
    """
    provided = settings.largest_depth(plan.force_n)
    presses = range(len(plan))
    expected = np.array([body.displacement(press, plan.force_of(press)) for press in presses])
    thickness = np.array([plan.thickness_m(press) for press in presses])
    allowed = np.minimum(settings.deepest_share * thickness, provided)
    worst = int((allowed / expected).argmin())
    if expected[worst] <= allowed[worst]:
        return
    force = plan.force_of(worst)
    enough = 0.99 * force * allowed[worst] / expected[worst]
    why = (
        f"the scan setting depth_m provides for {provided * 1e3:.3g} mm"
        if allowed[worst] == provided
        else f"the body is {thickness[worst] * 1e3:.3g} mm thick there, of which at most "
        f"{100 * settings.deepest_share:.0f} % may be pressed, as its law is for small depths"
    )
    raise InputError(
        f"Press {worst} at {in_mm(plan.points_m[worst])} mm: {force:.3g} N would go "
        f"{expected[worst] * 1e3:.3g} mm deep; {why}. Press with at most "
        f"{enough:.3g} N, with a wider tip, or on a thicker or stiffer body."
    )
