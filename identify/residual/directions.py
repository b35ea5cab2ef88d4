"""Directions of a residual: place, force, time in the press, phase, order of pressing.

Each dimension gives the directions (m, q) of a score test in units of the noise, or the reason
against a test in this scan.  A step common to all readings (an offset and a gain) belongs to the
force; the other dimensions are tested beyond it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identify.residual.hypothesis_tests import nearest_neighbours
from identify.residual.settings import RESIDUAL, ResidualSettings
from identify.residual.whitened import Whitened

PHASES = ("load", "hold", "unload")


@dataclass(frozen=True)
class Dimension:
    """One dimension of the residual: its key, its name in a sentence, and its directions."""

    name: str
    label: str
    directions: Callable[[Whitened, ResidualSettings], "np.ndarray | str"]


def common(w: Whitened) -> np.ndarray:
    """Offset and gain common to all readings, (m, 2)."""
    return np.column_stack([np.ones_like(w.force_n), w.force_n]) / w.sigma_m[:, None]


def with_gain(w: Whitened, columns: np.ndarray) -> np.ndarray:
    """Columns (m, q) as an offset and as a share of the force, over sigma, (m, 2 q)."""
    scaled = columns / w.sigma_m[:, None]
    return np.hstack([scaled, scaled * w.force_n[:, None]])


def bins(values: np.ndarray, count: int = RESIDUAL.bins) -> np.ndarray:
    """Bin of each value (m,), 0..b-1 without empty ones, at most `count`.

    The edges lie halfway between equal counts and equal widths, so that neither a long hold nor
    a few large values take most of the bins.  Bins of less than 1 % of the values join the next.
    """
    low, high = values.min(), values.max()
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        return np.zeros(len(values), dtype=int)
    steps = np.linspace(0, 1, count + 1)[1:-1]
    edges = (np.quantile(values, steps) + low + steps * (high - low)) / 2
    index = np.searchsorted(edges, values, side="right")
    needed = max(3, 0.01 * len(values))
    counts = np.bincount(index, minlength=count)
    merged, filled, current = np.zeros(count, dtype=int), 0.0, 0
    for b in range(count):
        if filled >= needed and counts[b:].sum() >= needed:
            current, filled = current + 1, 0.0
        merged[b] = current
        filled += counts[b]
    return merged[index]


def place(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Smooth patterns over the surface: the leading eigenvectors of the neighbour matrix.

    Eigenvectors of M W M (M subtracts the mean) are the patterns with the largest Moran's I of
    these contact points (Griffith 2003); each as an offset and as a share of the force.
    """
    least = settings.least_presses
    if w.presses < least:
        return f"the scan has only {w.presses} presses; {least} are needed for a pattern of places"
    neighbours = nearest_neighbours(w.scan.contact_points, settings.neighbours)
    centred = neighbours - neighbours.mean(axis=0)
    centred = centred - centred.mean(axis=1)[:, None]
    _, vectors = np.linalg.eigh(centred)
    patterns = vectors[:, ::-1][:, : min(settings.patterns, w.presses // 4)]
    return with_gain(w, patterns[w.press_index])


def force_bins(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Bin of the force F^ of each reading, (m,), or the reason for none."""
    index = bins(w.force_n, settings.bins)
    return index if index.max() >= 2 else "all readings were made at nearly one force"


def time_bins(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Bin of the time since the press's first reading, (m,), or the reason for none."""
    if not w.scan.has_time:
        return "the scan has no time stamps"
    index = bins(since_touch(w), settings.bins)
    return index if index.max() >= 2 else "all readings of a press carry nearly one time"


def force(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Bins of the force F^."""
    return _steps(w, force_bins(w, settings))


def time_in_press(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Bins of the time since the press's first reading."""
    return _steps(w, time_bins(w, settings))


def _steps(w: Whitened, index: np.ndarray | str) -> np.ndarray | str:
    if isinstance(index, str):
        return index
    return (index[:, None] == np.arange(index.max() + 1)) / w.sigma_m[:, None]


def since_touch(w: Whitened) -> np.ndarray:
    """Time since the first reading of the press, s, (m,)."""
    first = np.full(w.presses, np.inf)
    np.minimum.at(first, w.press_index, w.scan.time_s)
    return w.scan.time_s - first[w.press_index]


def phase(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Set steps of holding and of unloading (by level of force) against loading.

    The force within a hold, which varies by noise only, is not used: with a wrong noise, F^ and the
    residual would be correlated there.
    """
    present = [p for p in PHASES if np.any(w.scan.phase == p)]
    if len(present) < 2:
        return f"the scan has only '{present[0]}' readings" if present else "no phase is named"
    columns = [w.scan.phase == p for p in present[1:]]
    if present[-1] == "unload":
        unload = columns.pop()
        span = np.ptp(w.force_n) or 1.0
        level = np.minimum((w.force_n - w.force_n.min()) / span * 4, 3).astype(int)
        columns += [unload & (level == i) for i in range(4)]
    return np.column_stack(columns) / w.sigma_m[:, None]


def order(w: Whitened, settings: ResidualSettings = RESIDUAL) -> np.ndarray | str:
    """Order in which the presses were made: linear, quadratic and cubic trend."""
    least = settings.least_trend_presses
    if w.presses < least:
        return f"the scan has only {w.presses} presses; {least} are needed to see a trend"
    rank = np.argsort(np.argsort(w.scan.press_ids))
    position = 2.0 * rank / (w.presses - 1) - 1
    trends = np.polynomial.legendre.legvander(position, 3)[:, 1:]
    return with_gain(w, trends[w.press_index])


DIMENSIONS = (
    Dimension("place", "the place on the surface", place),
    Dimension("force", "the force", force),
    Dimension("time", "the time within a press", time_in_press),
    Dimension("phase", "the phase of the press", phase),
    Dimension("order", "the order of pressing", order),
)
