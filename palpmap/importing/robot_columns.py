"""Columns as robots' own loggers number them: six of a pose or a wrench, sixteen of a matrix."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models import InputError
from palpmap.importing.look import bare_name, find_quaternion, find_triples, is_force, matches
from palpmap.importing.readers.recording import Channel, Recording
from palpmap.importing.readers.units import ANGLE, FORCE, LENGTH

_NUMBERED = re.compile(r"^(?P<base>.*?\D)?[_.\[( ]?(?P<number>\d{1,2})[\])]?$")
_WANTED = re.compile(r"target|desired|command|cmd|setpoint|soll|nominal|_d$|_c$", re.I)
_JOINTS = re.compile(r"joint|(^|_)d?q(_|$)|torque|tau|achse", re.I)
_AS_ONE = 1e-4  # off 0 or 1 in the last row of a matrix
_TURNS = {
    "rotation vector": (("rx", "ry", "rz"), "vector"),
    "roll, pitch and yaw": (("roll", "pitch", "yaw"), "xyz"),
    "the angles A, B and C of KUKA": (("a", "b", "c"), "ZYX"),
    "the angles W, P and R of Fanuc": (("w", "p", "r"), "xyz"),
}


@dataclass(frozen=True)
class Place:
    """Columns of a pose.

    Attributes
    ----------
    position : x, y, z
    orientation : its columns, none where there are none
    order, angle_unit : of these, empty for the usual ones
    reason : how the orientation was recognised
    """

    position: tuple[Channel, ...]
    orientation: tuple[Channel, ...] = ()
    order: str = ""
    angle_unit: str = ""
    reason: str = ""


def numbered(recording: Recording) -> list[tuple[Channel, ...]]:
    """Return columns of one table whose names differ by a number, counted from 0 or 1."""
    groups: dict[tuple, dict[int, Channel]] = {}
    for channel in recording.channels:
        match = _NUMBERED.match(bare_name(channel)) if channel.is_number else None
        if match and match["base"]:
            key = (id(channel.table), channel.name.rpartition(":")[0], match["base"])
            groups.setdefault(key, {})[int(match["number"])] = channel
    found = []
    for group in groups.values():
        first = min(group)
        if first in (0, 1) and sorted(group) == list(range(first, first + len(group))):
            found.append(tuple(group[number] for number in sorted(group)))
    return found


def force_triples(recording: Recording) -> list[tuple[Channel, ...]]:
    """Return three columns of every force: named by x, y, z, or the first of a numbered wrench."""
    named: list[tuple[Channel, ...]] = list(find_triples(recording))
    triples = named + [g[:3] for g in numbered(recording) if len(g) in (3, 6)]
    return [t for t in triples if is_force(t[0]) and not _JOINTS.search(t[0].name)]


def find_force(recording: Recording) -> tuple[Channel, ...]:
    """Three columns of the force, or one."""
    if triples := force_triples(recording):
        return max(triples, key=lambda t: sum(float(np.nanstd(c.values)) for c in t))
    single = [
        c
        for c in recording.channels
        if c.is_number and (c.unit in FORCE or (not c.unit and matches(c, "force")))
    ]
    single = [c for c in single if np.nanstd(c.values) > 0] or single
    if not single:
        raise InputError(
            "no column of the recording looks like a force (by unit or name); it has "
            f"{', '.join(recording.names[:12])}; write the mapping by hand, with force.column"
        )
    named = [c for c in single if matches(c, "force")]
    return ((named or single)[0],)


def find_place(recording: Recording, force: Sequence[Channel]) -> Place | None:
    """Return the pose of the tip: the one that moves, as measured rather than as commanded."""
    named: list[tuple[Channel, ...]] = list(find_triples(recording))
    groups = numbered(recording)
    triples = named + [g[:3] for g in groups if len(g) in (3, 6)]
    places = [
        _with_turns(recording, triple, groups) for triple in triples
        if triple[0] not in force and not is_force(triple[0]) and matches(triple[0], "pose")
        and triple[0].unit in ("", *LENGTH) and not _JOINTS.search(triple[0].name)
    ]  # fmt: skip
    places += [place for group in groups if (place := _of_matrix(group))]
    if not places:
        return None

    def rank(place: Place) -> tuple:
        moves = any(np.ptp(c.values[np.isfinite(c.values)]) > 0 for c in place.position)
        base = re.sub(r"[_.\[( ]?\d+[\])]?$", "", bare_name(place.position[0]))
        return moves, not _WANTED.search(base), len(place.position[0].values)

    return max(places, key=rank)


def _of_matrix(group: tuple[Channel, ...]) -> Place | None:
    """Position and rotation of sixteen columns that are a 4 x 4 matrix of a pose."""
    if len(group) != 16:
        return None
    values = np.column_stack([channel.values for channel in group]).reshape(-1, 4, 4)
    for turned, order in ((values, "rows"), (values.swapaxes(1, 2), "columns")):
        last = turned[:, 3] - [0, 0, 0, 1]
        if np.nanmax(np.abs(last)) < _AS_ONE:
            at = np.arange(16).reshape(4, 4)
            at = at if order == "rows" else at.T
            matrix = at[:3, :3] if order == "rows" else at[:3, :3].T
            return Place(
                tuple(group[i] for i in at[:3, 3]),
                tuple(group[i] for i in matrix.ravel()),
                order,
                reason="of a 4 x 4 matrix, by its last row or column",
            )
    return None


def _with_turns(
    recording: Recording, position: tuple[Channel, ...], groups: Sequence[tuple[Channel, ...]]
) -> Place:
    """Add the orientation that stands beside a position."""
    table = position[0].table
    if quaternion := find_quaternion(recording, table):
        return Place(position, quaternion, "xyzw", reason="four columns of unit length")
    for group in groups:
        if len(group) == 6 and group[:3] == position:
            return Place(position, group[3:], "vector", "rad",
                         "a rotation vector, as in Universal Robots' poses: check it")  # fmt: skip
    own = {bare_name(c).lower(): c for c in recording.channels if c.table is table and c.is_number}
    for what, (names, order) in _TURNS.items():
        if own.keys() >= set(names):
            turns = tuple(own[name] for name in names)
            unit = turns[0].unit if turns[0].unit in ANGLE else ""
            wide = max(float(np.nanmax(np.abs(c.values))) for c in turns) > 2 * np.pi
            unit = unit or ("deg" if wide else "rad")
            return Place(position, turns, order, unit, f"{what}, by their names: check it")
    return Place(position)
