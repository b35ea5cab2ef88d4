"""The limit of a force sensor: a level that the force does not pass while the tip goes deeper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from palpmap.importing.streams.clocks import NEAR_STEP_S, smooth
from palpmap.importing.streams.stream import Stream, noise_of

if TYPE_CHECKING:
    from palpmap.importing.streams.contact import Contact
    from palpmap.importing.streams.press import Window

NOISE = 3.0  # standard deviations of a sample below the level: such samples are at it
BEFORE = (0.5, 0.9)  # of the level: with this part of the way in the flat part is compared
MOVING = 0.5  # of the speed there: a tip that holds a force, or creeps, is slower
FLAT = 0.25  # of the stiffness there; no body yields so much all at once
LEAST_WAY = 0.1  # of the travel, flat
MAIN = 0.5  # of the press's force: a column with less hardly changes in it
FEWEST = 3  # samples


def limited_spans(
    sensor: Stream,
    windows: Sequence[Window],
    contacts: Sequence[Contact | None],
    names: Sequence[str],
    said: list[str],
) -> list[tuple[float, float]]:
    """Return begin and end in s of each stretch in which the sensor is at its limit.

    Parameters
    ----------
    sensor : values (m, k) as the sensor has them
    windows, contacts : the motions of the stream, clocks brought together roughly
    names : of the sensor's columns, (k,)
    """
    felt = [(w, c) for w, c in zip(windows, contacts, strict=True) if c is not None]
    spans = []
    for name, column in zip(names, sensor.values.T, strict=True):
        for sign in (1.0, -1.0):
            level, found = _at_level(sensor.time_s, sign * column, felt)
            if found:
                spans += found
                said.append(
                    f"The sensor is at its limit in {len(found)} of {len(felt)} presses: '{name}' "
                    f"stays at {sign * level:.3g} N while the tip goes deeper. Their readings from "
                    "there on were left out; press less deep, or use a sensor for larger forces."
                )
    return spans


def without_spans(stream: Stream, spans: Sequence[tuple[float, float]]) -> Stream:
    """Return a stream without the messages of some spans; these are no gaps."""
    kept = np.ones(len(stream.time_s), dtype=bool)
    for start, end in spans:
        kept &= (stream.time_s < start) | (stream.time_s > end)
    return Stream(stream.time_s[kept], stream.values[kept], stream.gaps)


def _at_level(
    time: np.ndarray, force: np.ndarray, felt: Sequence[tuple[Window, Contact]]
) -> tuple[float, list[tuple[float, float]]]:
    """Highest level of a column (m,) in the presses, and the stretches at it; none if no limit."""
    noise = max(float(noise_of(force[:, None])[0]), 1e-6 * float(np.ptp(force)))
    courses, levels = [], []
    for window, contact in felt:
        inside = slice(contact.touch, contact.release + 1)
        column = force[np.searchsorted(time, window.time_s[inside])]
        along = (window.force_n - contact.tare_n)[inside]
        if column.max() - column[0] < MAIN * np.ptp(along):
            continue
        courses.append((window.time_s[inside], column, window.depth_m[inside]))
        levels.append(float(np.median(column[column >= column.max() - 2 * NOISE * noise])))
    if not levels:
        return 0.0, []
    level = max(levels)
    near = [one for one, own in zip(courses, levels, strict=True) if own >= level - NOISE * noise]
    if not any(_is_flat(t, f, depth, level, noise) for t, f, depth in near):
        return level, []
    at = [np.flatnonzero(column >= level - NOISE * noise) for _, column, _ in near]
    return level, [(float(t[k[0]]), float(t[k[-1]])) for (t, *_), k in zip(near, at, strict=True)]


def _is_flat(
    time: np.ndarray, force: np.ndarray, depth: np.ndarray, level: float, noise: float
) -> bool:
    """Whether a press's force (m,) no longer rises at a level while the tip goes on at speed."""
    deepest = int(depth.argmax())
    marks = force[0] + np.array(BEFORE) * (level - force[0])
    low, high = (int(np.argmax(force >= mark)) for mark in marks)
    first = int(np.argmax(force >= level - NOISE * noise))
    if not 0 < low < high < deepest or deepest - first < FEWEST:
        return False
    way, force_risen, lasted = (v[high] - v[low] for v in (depth, force, time))
    speed = np.gradient(smooth(depth, time, lasted / 2), time)
    flat = np.arange(first, deepest + 1)[speed[first : deepest + 1] > MOVING * way / lasted]
    if way <= 0 or len(flat) < FEWEST:
        return False
    x, y = depth[flat] - depth[flat].mean(), force[flat] - force[flat].mean()
    least = LEAST_WAY * np.ptp(depth[: deepest + 1]) + 2 * NEAR_STEP_S * way / lasted
    gone = float(np.sum((speed * np.gradient(time))[flat]))
    return bool(gone > least and x @ y < FLAT * force_risen / way * (x @ x))
