"""Readings of a Scan whose size goes with another unit than the table's."""

import numpy as np

from models.scan import Scan
from models.scan_readings import presses_of

STIFFER = 100.0  # than a typical press: no spot of a soft body is
STRONGER = 10.0  # than a typical press: a tip that has hardly moved tells no stiffness
LONGEST_PRESS_S = 1000.0


def too_stiff(scan: Scan) -> dict[int, float]:
    """Return presses with forces of another unit, and the stiffness of each over a typical one's.

    Parameters
    ----------
    scan : rows in contact
    """
    presses = presses_of(scan)
    force = np.array([scan.force_n[rows].max() for _, rows in presses])
    travel = np.array([scan.displacement_m[rows].max() for _, rows in presses])
    stiffness = force / np.where(travel > 0, travel, np.inf)
    typical = float(np.median(stiffness))
    found = (stiffness > STIFFER * typical) & (force > STRONGER * np.median(force)) & (typical > 0)
    return {presses[j][0]: float(stiffness[j] / typical) for j in np.flatnonzero(found)}


def too_slow(scan: Scan) -> tuple[float, float] | None:
    """Return how long a typical press lasts and its readings are apart, s, if that is too long.

    Parameters
    ----------
    scan : rows in contact
    """
    if not scan.has_time:
        return None
    times = [scan.time_s[rows] for _, rows in presses_of(scan)]
    lasts = float(np.median([np.ptp(time) for time in times]))
    apart = float(np.median(np.concatenate([np.diff(time) for time in times])))
    return (lasts, apart) if lasts > LONGEST_PRESS_S else None
