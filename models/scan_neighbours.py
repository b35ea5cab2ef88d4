"""Presses of a Scan whose force no press beside them comes near."""

import numpy as np

from models.scan import Scan
from models.scan_readings import presses_of

LARGER = 2.2  # than beside it: 1.8 at most over hard balls, measured, and inclusions, simulated
BESIDE = 2.2  # tip radii: contacts that touch or overlap press on mostly the same part of the body
SCATTERS = 4.0  # robust standard deviations of a press from those beside it, in logarithms
FEWEST = 2  # presses beside it
LITTLE_FORCE = 0.3  # of a typical press's largest: below it noise makes such a ratio


def too_strong(scan: Scan) -> dict[int, float]:
    """Return presses with a force that none beside them explains, and its ratio to the largest.

    Forces are compared on the way in, at the largest travel that both presses reach. A hard spot
    is felt beside it too, as far as the tip is wide.

    Parameters
    ----------
    scan : rows in contact, without presses that met no body
    """
    courses, firsts = [], []
    for _, rows in presses_of(scan):
        way_in = scan.phase[rows] != "unload"
        travel, force = scan.displacement_m[rows][way_in], scan.force_n[rows][way_in]
        order = np.argsort(travel, kind="stable")
        courses.append((np.append(0.0, travel[order]), np.append(0.0, force[order])))
        firsts.append(rows.start)
    point, radius = scan.point_m[firsts], scan.probe_radius_m[firsts]
    least = LITTLE_FORCE * float(np.median([force.max() for _, force in courses]))
    ratios: dict[int, np.ndarray] = {}
    for j, (travel, force) in enumerate(courses):
        near = np.linalg.norm(point - point[j], axis=1) < BESIDE * radius[j]
        near &= np.isclose(radius, radius[j], rtol=1e-3)
        near[j] = False
        pairs = []
        for other_travel, other in (courses[k] for k in np.flatnonzero(near)):
            common = min(travel[-1], other_travel[-1])
            pairs.append([np.interp(common, travel, force), np.interp(common, other_travel, other)])
        if len(pairs) >= FEWEST:
            own, beside = np.maximum(np.transpose(pairs), 1e-12)
            ratios[j] = np.log(own / beside) * (own > least)
    if not ratios:
        return {}
    scatter = 1.4826 * float(np.median([abs(np.median(ratio)) for ratio in ratios.values()]))
    limit = max(np.log(LARGER), SCATTERS * scatter)
    return {
        int(scan.press_ids[j]): float(np.exp(ratio.min()))
        for j, ratio in ratios.items()
        if ratio.min() > limit
    }
