"""Which way the presses go in a stream, and from when to when each of them lasts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import find_peaks

from models import InputError
from palpmap.importing.streams.clocks import GRID_S, closer_offset, smoothed
from palpmap.importing.streams.stream import Stream

TOGETHER = 0.6  # least correlation of force and depth
SHALLOW_STROKE = 0.15
PROMINENT = 0.3  # of the usual stroke


@dataclass(frozen=True, eq=False)
class Way:
    """The common way of the presses.

    Attributes
    ----------
    correlation : between force and depth beyond a threshold, median over the presses
    agreement : mean over the presses
    offset_s : still to add to the pose's clock
    direction : (3,) mean direction of pressing
    spans : begin and end of each press, s
    """

    correlation: float
    agreement: float
    offset_s: float
    direction: np.ndarray
    spans: list[tuple[float, float]]

    @property
    def rest(self) -> float:
        """What median and mean leave unexplained, as a product.

        A wrong offset fits some presses and lowers the mean; one dip without contact lowers the
        mean of the right offset, but not its median.
        """
        return (1 - abs(self.correlation)) * (1 - abs(self.agreement))


def way_along(force: Stream, pose: Stream, line: np.ndarray) -> Way:
    """Find the way of the presses.

    Of the line's two directions that one points into the body along which force and depth rise
    together more closely.
    """
    found = []
    for direction in (line, -line):
        vectors = force.values
        along = vectors if vectors.shape[1] == 1 else vectors @ direction[:, None]
        spans = press_spans(pose, direction, force)
        moved = replace(force, values=along)
        offset, usual, mean = closer_offset(moved, pose, direction, spans)
        found.append(Way(usual, mean, offset, direction, spans))
    return max(found, key=lambda one: abs(one.correlation))


def check_way(way: Way, sign: int) -> None:
    """Refuse a way along which the force does not rise with the depth.

    Parameters
    ----------
    sign : of the force, as the mapping states it
    """
    if abs(way.correlation) < TOGETHER:
        raise InputError(
            "force and depth do not rise together in most motions (correlation "
            f"{way.correlation:.2f}); check force.columns, force.frame, pose.columns and "
            "pose.clock_offset_s"
        )
    if way.correlation < 0:
        raise InputError(
            f"key force.sign: found {sign}, with which the force falls while the tip "
            f"goes into the body; give {-sign}"
        )


def press_spans(pose: Stream, direction: np.ndarray, force: Stream) -> list[tuple[float, float]]:
    """Return begin and end in s of each motion into the body and out again.

    The tip's depth along the mean direction rises and falls once a press; two presses are parted
    in the middle of the shallow stretch between them.
    """
    start = max(pose.time_s[0], force.time_s[0])
    end = min(pose.time_s[-1], force.time_s[-1])
    time = np.arange(start, end, GRID_S)
    if len(time) < 10:
        raise InputError(
            "force and pose overlap by less than 0.1 s; check time.column, or state "
            "pose.clock_offset_s"
        )
    depth = smoothed(pose.at(time)[:, :3] @ direction[:, None], 5)[:, 0]
    padded = np.concatenate([[depth.min()], depth, [depth.min()]])
    peaks, found = find_peaks(padded, prominence=1e-4)
    if not len(peaks):
        raise InputError("the tip does not move; check pose.columns and pose.unit")
    height = found["prominences"]
    # The padding makes the highest peak as high as the way from the furthest start: never count it
    large = np.quantile(height, 0.9, method="lower")
    usual = np.median(height[height > PROMINENT * large])
    peaks = peaks[height > PROMINENT * usual] - 1
    edges = [float(time[0])]
    for a, b in pairwise(peaks.tolist()):
        between = depth[a:b]
        top = min(between[0], depth[b])
        low = np.flatnonzero(between < between.min() + SHALLOW_STROKE * (top - between.min()))
        edges.append(float(time[a + (low[0] + low[-1]) // 2]))
    edges.append(float(time[-1]))
    return list(pairwise(edges))
