"""Tables whose rows are readings of numbered presses, as a scan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from models import PHASES, InputError, Scan, nearest
from palpmap.importing.mapping.columns import numbers, on_clock_of, rotated, seconds
from palpmap.importing.mapping.rig import Rig
from palpmap.importing.readers.recording import Recording, Table

LONGEST_TIME_S = 1e8  # beyond it the clock counts from 1970
PLATEAU = 0.97  # of the largest travel or force: above it the tip holds


def scan_of_readings(recording: Recording, rig: Rig) -> tuple[Scan, list[str]]:
    """Return the scan of a recording whose rows are numbered presses, and the assumptions.

    All columns are brought to the clock of the force; one of another table is interpolated, and
    of press and phase the last value counts.
    """
    names, key = rig.force.named
    force, table = numbers(recording, names, rig.force.unit, "force", key)
    clock = rig.force.clock or rig.time
    time = seconds(recording, table, clock, "time")
    m = len(force)

    def column(names: tuple[str, ...], unit: str, dimension: str, key: str) -> np.ndarray:
        values, home = numbers(recording, names, unit, dimension, key)
        return _on_rows(recording, rig, values, home, table, time, key, held=dimension == "")

    # `Rig.needed` has asked for these
    assert rig.press.number
    assert rig.travel
    assert rig.point
    press = _whole(column((rig.press.number,), "", "", "press.number")[:, 0], table)
    direction = _directions(rig, m, column)
    said = []
    vectors, along = _along(rig, rig.force.sign * force, direction)
    travel = column((rig.travel.column,), rig.travel.unit, "length", "travel.column")
    travel = rig.travel.sign * travel[:, 0]
    points = column(rig.point.columns, rig.point.unit, "length", "point.columns")
    points = rotated(rig, points, place=True)
    radius = _radii(rig, m, column)
    press, order = _in_order(press, time, said)
    travel, along = travel[order], along[order]
    if rig.press.phase:
        phase = _phases(recording, rig, table, time)[order]
    else:
        phase = phases(press, travel, along)
        said.append(
            f"No column of the phase: readings above {PLATEAU:.0%} of a press's largest travel or "
            "force are its hold, those before it load, those after it unload."
        )
    if time is None:
        said.append("No column of the time: creep, drift and other effects in time are not seen.")
    elif abs(time[0]) > LONGEST_TIME_S:
        said.append(f"Times are counted from the first reading, at {time[0]:.3f} s.")
        time = time - time[0]
    scan = Scan(
        press=press,
        time_s=np.full(m, np.nan) if time is None else time[order],
        phase=phase,
        point_m=points[order],
        direction=direction[order],
        force_n=along,
        displacement_m=travel,
        probe_radius_m=radius[order],
        force_vector_n=None if vectors is None else vectors[order],
    )
    used = scan.used()
    _refuse_wrong_sign(used.press, used.force_n, rig.force.sign, "force")
    _refuse_wrong_sign(used.press, used.displacement_m, rig.travel.sign, "travel")
    return scan, said


def _in_order(
    press: np.ndarray, time: np.ndarray | None, said: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers of presses (m,) that never fall, and the order (m,) of the rows for them.

    What was done to them is added to `said`.
    """
    order = np.arange(len(press))
    if not np.any(np.diff(press) < 0):
        return press, order
    if time is None or not np.all(np.diff(time) > 0):
        order = np.argsort(press, kind="stable")
        said.append("The rows were sorted by press.")
        return press[order], order
    # Numbers of places, pressed in an order of their own
    new = np.diff(press, prepend=press[0] - 1) != 0
    made = press[new]
    first = ", ".join(map(str, made[:5])) + " and so on" * (len(made) > 5)
    said.append(
        "The presses were numbered anew, from 0 in the order of time; the recording numbers them "
        f"{first}."
    )
    return np.cumsum(new) - 1, order


def _radii(rig: Rig, m: int, column: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the tip's radius at each of m readings, m."""
    if rig.radius:
        stated = column((rig.radius.column,), rig.radius.unit, "length", "radius.column")
        return rig.radius.sign * stated[:, 0]
    assert rig.probe
    return np.full(m, rig.probe.radius_m)


def phases(press: np.ndarray, travel: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the phase of each reading (m,), from travel and force of its press."""
    found = np.full(len(press), "load", dtype="U6")
    for rows in _rows_of_presses(press):
        held = hold_of(travel[rows], force[rows], PLATEAU)
        found[rows[held.start : held.stop]] = "hold"
        found[rows[held.stop :]] = "unload"
    return found


def _rows_of_presses(press: np.ndarray) -> list[np.ndarray]:
    return np.split(np.arange(len(press)), np.flatnonzero(np.diff(press)) + 1)


def _refuse_wrong_sign(press: np.ndarray, values: np.ndarray, sign: int, key: str) -> None:
    """Refuse values (m,) whose largest size is negative in most presses."""
    rows = [r for r in _rows_of_presses(press) if len(r)]  # none of a scan without contact
    peaks = np.array([values[r][np.abs(values[r]).argmax()] for r in rows])
    if 2 * np.sum(peaks < 0) > len(peaks):
        j = int(peaks.argmin())
        raise InputError(
            f"key {key}.sign: found {sign}, which makes the {key} negative in "
            f"{np.sum(peaks < 0)} of {len(peaks)} presses (press {press[rows[j][0]]:g}: "
            f"{peaks[j]:.3g} {'N' if key == 'force' else 'm'}), expected a {key} into the body "
            f"that counts positive; set {key}.sign = {-sign}"
        )


def hold_of(travel: np.ndarray, force: np.ndarray, plateau: float) -> slice:
    """Return the readings of a press's hold, a slice; with fewer than two it is empty.

    Travel stays up while the force relaxes, or the force while the tip creeps: the hold begins
    where the first of them reaches its plateau and ends where the last one leaves it.
    """
    high = []
    for values in (travel, force):
        top = values.max()  # below zero in a press in the air, by the sensor's zero
        high.append(np.flatnonzero(values >= top - (1 - plateau) * abs(top)))
    first, last = min(rows[0] for rows in high), max(rows[-1] for rows in high)
    return (
        slice(int(first), int(last) + 1) if last > first else slice(int(first) + 1, int(first) + 1)
    )


def _on_rows(
    recording: Recording,
    rig: Rig,
    values: np.ndarray,
    home: Table,
    table: Table,
    time: np.ndarray | None,
    key: str,
    held: bool,
) -> np.ndarray:
    if home is table:
        return values
    of_home = seconds(recording, home, rig.time, "time")
    if time is None or of_home is None:
        raise InputError(
            f"key {key}: stands in {home.name} and the force in {table.name}, expected a clock "
            "that both share; give time.column"
        )
    back = np.flatnonzero(np.diff(of_home) < 0)
    if len(back):
        raise InputError(
            f"{home.where(int(back[0]) + 1)}: the time falls, expected rows in the order of time"
        )
    return on_clock_of(values, of_home, time, held)


def _along(
    rig: Rig, force: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray]:
    """Force vectors (m, 3) in the scan's frame, where there are any, and the force along (m,)."""
    if not rig.force.columns:
        return None, force[:, 0]
    vectors = rotated(rig, force, place=False)
    return vectors, np.einsum("mi,mi->m", vectors, direction)


def _directions(rig: Rig, m: int, column) -> np.ndarray:
    stated = rig.press.direction
    if isinstance(stated, str):
        raise InputError(
            f"key press.direction: found '{stated}', expected three numbers or three columns: "
            "readings hold no path of the tip"
        )
    if isinstance(stated[0], str):
        found = column(stated, "", "", "press.direction")
    else:
        found = np.tile(np.array(stated, float), (m, 1))
    length = np.linalg.norm(found, axis=1, keepdims=True)
    if np.any(length == 0):
        raise InputError("key press.direction: found a direction of length 0, expected a unit one")
    # what rounding has spoilt is made a unit vector; a column that is none is refused later
    unit = np.where(np.abs(length - 1) < 1e-2, found / length, found)
    return rotated(rig, unit if isinstance(stated[0], str) else found / length, place=False)


def _phases(recording: Recording, rig: Rig, table: Table, time: np.ndarray | None) -> np.ndarray:
    channel = recording.channel(str(rig.press.phase), "press.phase")
    names = dict(rig.press.phases)
    texts = channel.values
    if channel.is_number:
        texts = np.array([f"{value:g}" for value in channel.values])
    known = {text: names.get(text, text.strip().lower()) for text in np.unique(texts).tolist()}
    for text, phase in known.items():
        if phase not in PHASES:
            row = int(np.flatnonzero(texts == text)[0])
            raise InputError(
                f"{channel.table.where(row)}, {channel.name}: found the phase '{text}', which is "
                f"none of {', '.join(PHASES)}{nearest(text, PHASES)}; say what it is under "
                f'press.phases, as in phases = {{"{text}" = "load"}}'
            )
    found = np.array([known[text] for text in texts.tolist()])
    rows = _on_rows(
        recording, rig, np.arange(len(found), dtype=float)[:, None], channel.table, table, time,
        "press.phase", held=True,
    )  # fmt: skip
    return found[rows[:, 0].astype(int)]


def _whole(press: np.ndarray, table: Table) -> np.ndarray:
    bad = np.flatnonzero((press != np.round(press)) | (np.abs(press) > 1e9) | (press < 0))
    if len(bad):
        raise InputError(
            f"{table.where(int(bad[0]))}, key press.number: found {press[bad[0]]:g}, expected "
            "whole numbers 0, 1, 2, ..."
        )
    return press.astype(np.int64)
