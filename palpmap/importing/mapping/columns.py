"""Columns that a mapping names, as arrays in SI units on one clock."""

from __future__ import annotations

import numpy as np

from models import InputError
from palpmap.importing.mapping.rig import Clock, Rig
from palpmap.importing.readers.bag import RECEIVED
from palpmap.importing.readers.recording import PART, Channel, Recording, Table
from palpmap.importing.readers.units import factor


def numbers(
    recording: Recording,
    names: tuple[str, ...],
    unit: str,
    dimension: str,
    key: str,
    empty: bool = False,
) -> tuple[np.ndarray, Table]:
    """Return columns in SI units, (m, k), and the table that they stand in.

    Parameters
    ----------
    empty : True lets empty cells stand, as NaN

    Raises
    ------
    InputError
        A column is missing, holds text, or stands in another table than the others.
    """
    channels = [recording.channel(name, key) for name in names]
    table = channels[0].table
    for channel in channels:
        if channel.table is not table:
            raise InputError(
                f"key {key}: '{channels[0].name}' stands in {table.name} and '{channel.name}' in "
                f"{channel.table.name}, expected columns of one table"
            )
    scale = factor(unit, dimension, key) if dimension else 1.0
    return scale * np.column_stack([channel.numbers(empty) for channel in channels]), table


def seconds(recording: Recording, table: Table, clock: Clock | None, key: str) -> np.ndarray | None:
    """Return the time of a table's rows in s, (m,); None where it has none.

    The clock's column is looked for in the table itself; a topic without it is timed by reception.
    """
    if clock is None:
        return None
    column = clock.column if clock.column in table.columns else clock.column.rpartition(":")[2]
    if column not in table.columns:
        if RECEIVED not in table.columns:
            recording.channel(clock.column, f"{key}.column")  # says what there is
            raise InputError(
                f"key {key}.column: '{clock.column}' does not stand in {table.name}, whose rows it "
                "is to time; name a column of that table in its own clock"
            )
        return table.columns[RECEIVED]
    time = Channel(column, table, table.columns[column], "").numbers()
    # the first is taken off before scaling: nanoseconds since 1970 fill all digits
    scaled = (time - time[0]) * factor(clock.unit, "time", f"{key}.unit")
    start = time[0] * factor(clock.unit, "time", f"{key}.unit")
    return _with_pauses(table, scaled, clock, key) + start


def _with_pauses(table: Table, time: np.ndarray, clock: Clock, key: str) -> np.ndarray:
    """Run on the clock of parts that each begin anew."""
    parts = table.columns.get(PART)
    if parts is None:
        return time
    time = time.copy()
    for first in np.flatnonzero(np.diff(parts)) + 1:
        if time[first] > time[first - 1]:
            continue
        if clock.pause_s is None:
            raise InputError(
                f"{table.where(int(first))}, {clock.column}: the clock starts anew in this part; "
                f"give {key}.pause_s, the rest between two parts in s (leave the clock out if it "
                "is unknown)"
            )
        time[first:] += time[first - 1] + clock.pause_s - time[first]
    return time


def on_clock_of(
    values: np.ndarray, time: np.ndarray, wanted: np.ndarray, held: bool = False
) -> np.ndarray:
    """Return values (m, k) at other times: between two readings, or the last one if `held`."""
    if held:
        return values[np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, None)]
    return np.column_stack([np.interp(wanted, time, column) for column in values.T])


def rotated(rig: Rig, vectors: np.ndarray, place: bool) -> np.ndarray:
    """Turn vectors (m, 3) from the recording's base frame to the scan's; places are moved too."""
    turn = matrices(np.array([rig.frame.rotation_wxyz]))[0]
    moved = vectors @ turn.T
    return moved + np.array(rig.frame.position_m) if place else moved


def matrices(quaternion: np.ndarray) -> np.ndarray:
    """Return rotation matrices (m, 3, 3) of quaternions (m, 4) in the order w, x, y, z.

    >>> matrices(np.array([[2.0, 0.0, 0.0, 0.0]]))[0].tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def continuous(quaternion: np.ndarray) -> np.ndarray:
    """Return the quaternions (m, 4) with signs chosen so that neighbours lie on one side."""
    signs = np.where(np.einsum("mi,mi->m", quaternion[1:], quaternion[:-1]) < 0, -1.0, 1.0)
    return quaternion * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
