"""The tool's weight on a wrist sensor, found from free samples in different orientations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from palpmap.importing.mapping.columns import matrices
from palpmap.importing.streams.stream import Stream

if TYPE_CHECKING:
    from palpmap.importing.streams.contact import Contact
    from palpmap.importing.streams.press import Window

GRAVITY = 9.80665
LEAST_TURN_DEG = 3.0
MOST_SAMPLES = 20_000


def without_weight(
    force: Stream,
    pose: Stream,
    windows: Sequence[Window],
    contacts: Sequence[Contact | None],
    said: list[str],
) -> Stream:
    """Subtract the tool's weight and the sensor's bias, if the tip's turning shows them.

    The free force in the scan's frame is w + R b: w is the weight, b the sensor's bias in its own
    axes, R the tip's rotation.

    Parameters
    ----------
    force : values (m, 3) in the scan's frame
    windows, contacts : the motions of the stream; samples inside a contact are not free
    """
    turn = matrices(pose.at(force.time_s)[:, 3:])
    if not turns(turn):
        said.append("The tip hardly turns: its weight is part of the tare of each press.")
        return force
    free = np.ones(len(turn), dtype=bool)
    for window, contact in zip(windows, contacts, strict=True):
        if contact is None:
            free &= (force.time_s < window.time_s[0]) | (force.time_s > window.time_s[-1])
        else:
            start, end = window.time_s[contact.touch] - 0.05, window.time_s[contact.release] + 0.05
            free &= (force.time_s < start) | (force.time_s > end)
    rows = np.flatnonzero(free)[:: max(1, int(np.sum(free)) // MOST_SAMPLES)]
    if len(rows) < 100:
        said.append("There are too few free samples to find the tool's weight.")
        return force
    columns = np.concatenate([np.tile(np.eye(3), (len(rows), 1, 1)), turn[rows]], axis=2)
    found = np.linalg.lstsq(columns.reshape(-1, 6), force.values[rows].reshape(-1), rcond=None)[0]
    weight, bias = found[:3], found[3:]
    said.append(
        f"The tool weighs {np.linalg.norm(weight) / GRAVITY:.3f} kg by the free samples in "
        "different orientations; its weight and the sensor's bias were subtracted."
    )
    return replace(force, values=force.values - weight - turn @ bias)


def turns(turn: np.ndarray) -> bool:
    """Return whether rotations (m, 3, 3) differ enough to show a weight that turns with the tip."""
    cosine = (np.einsum("mij,ij->m", turn, turn[len(turn) // 2]) - 1) / 2
    return bool(np.degrees(np.arccos(np.clip(np.quantile(cosine, 0.05), -1, 1))) > LEAST_TURN_DEG)
