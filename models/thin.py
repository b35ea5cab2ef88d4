"""A scan with no more presses than the loop needs, of every kind and evenly spread."""

import numpy as np

from models.scan import Scan

MOST_PRESSES = 200  # time and memory of the loop grow with them
MOST_OF_FREE_MAP = 800  # under a free map, whose cells are larger the more presses there are
_KINDS_APART = 1.0  # of the scan's extent: presses with another tip or force are no neighbours


def thinned(scan: Scan, most: int = MOST_PRESSES) -> Scan:
    """Return a scan with at most so many presses, each next one farthest from those before.

    Farthest in place, in the tip's radius and in depth level: the largest force or the largest
    travel, whichever the robot controlled. The first press and the order are kept. Presses that
    only repeat others are taken last, evenly.
    """
    points = scan.contact_points
    if len(points) <= most:
        return scan
    extent = max(float(np.ptp(points, axis=0).max()), 1e-9)
    kinds = np.column_stack([np.log(scan.contact_radii), _depth_level(scan)])
    low, high = kinds.min(axis=0), kinds.max(axis=0)
    kinds = (kinds - low) / np.where(high > low, high - low, 1.0)
    features = np.hstack([points / extent, _KINDS_APART * kinds])
    return scan.rows(np.isin(scan.press_index, well_spread(features, most)))


def well_spread(features: np.ndarray, most: int) -> np.ndarray:
    """Return the rows, rising, of at most so many of n points (n, k), each next one farthest.

    The first point is among them. Those that only repeat others are taken last, evenly.
    """
    if len(features) <= most:
        return np.arange(len(features))
    kept = [0]
    away = np.linalg.norm(features - features[0], axis=1)
    while len(kept) < most and away.max() > 1e-6:
        kept.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(features - features[kept[-1]], axis=1))
    again = np.setdiff1d(np.arange(len(features)), kept)
    evenly = np.linspace(0, len(again) - 1, most - len(kept)).round().astype(int)
    return np.sort([*kept, *again[evenly]])


def _depth_level(scan: Scan) -> np.ndarray:
    """Commanded depth level of each press (j,), log2 rounded to quarter octaves.

    Of force and travel, the one that varies less: the robot controlled that one. The other varies
    with the stiffness and would bias the selection.
    """
    told = []
    for reading in (scan.force_n, scan.displacement_m):
        most = np.zeros(len(scan.contact_points))
        np.maximum.at(most, scan.press_index, reading)
        told.append(np.log2(np.clip(most / max(most.max(), 1e-12), 1e-3, 1.0)))
    return np.rint(4 * min(told, key=np.std))
