"""A scan with no more presses than the loop needs, evenly spread."""

import numpy as np

from models.scan import Scan

MOST_PRESSES = 150  # time and memory of the loop grow with them


def thinned(scan: Scan, most: int = MOST_PRESSES) -> Scan:
    """Return a scan with at most so many presses, each next one farthest from those before.

    The first press is kept, the order of the rest as well.
    """
    points = scan.contact_points
    if len(points) <= most:
        return scan
    kept = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while len(kept) < most:
        kept.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[kept[-1]], axis=1))
    return scan.rows(np.isin(scan.press_index, kept))
