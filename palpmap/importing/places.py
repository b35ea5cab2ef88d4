"""Presses in files of their own, whose places stand in the mapping: of a testing machine, say.

Such a machine tells its travel along one line: its recordings have no position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from models import InputError, Scan
from palpmap.importing.mapping.columns import numbers, rotated
from palpmap.importing.mapping.rig import Place, Pose, Rig
from palpmap.importing.readers.recording import PART, Recording, Table

_ADDED = ("part_x", "part_y", "part_z")


def with_places(recording: Recording, rig: Rig) -> tuple[Recording, Rig]:
    """Return a recording with columns of the position, and the mapping that names them.

    Of readings these are the contact points; of a stream, where the tip is, but for the unknown
    zero of its travel (see `at_places`).

    Raises
    ------
    InputError
        A file without a place, or a place without its file.
    """
    if not rig.parts:
        return recording, rig
    assert rig.travel  # `Rig.needed` asks
    travel, table = numbers(
        recording, (rig.travel.column,), rig.travel.unit, "length", "travel.column", True
    )
    position = _of_rows(table, rig)
    if rig.kind == "stream":
        direction = np.array(rig.press.direction, dtype=float)
        position = position + rig.travel.sign * travel * direction / np.linalg.norm(direction)
    columns = table.columns | dict(zip(_ADDED, position.T, strict=True))
    placed = replace(table, columns=columns)
    tables = tuple(placed if one is table else one for one in recording.tables)
    names = {"columns": _ADDED, "unit": "m"}
    given = {"pose": Pose(**names)} if rig.kind == "stream" else {"point": Place(**names)}
    return replace(recording, tables=tables), rig.model_copy(update=given)


def _of_rows(table: Table, rig: Rig) -> np.ndarray:
    """Places (m, 3) of a table's rows, m, in the recording's frame."""
    files = table.parts or (table.name,)
    for name in files:
        if files.count(name) > 1:
            raise InputError(
                f"key parts: {files.count(name)} files are called {name}, which leaves open whose "
                "place it has; give each file a name of its own"
            )
        if name not in rig.parts:
            raise InputError(
                f'key parts: no place of {name}, expected "{name}" = [x, y, z] in m, the contact '
                "point of its press"
            )
    for name in rig.parts:
        if name not in files:
            raise InputError(
                f"key parts: found a place of {name}, which is none of the {len(files)} files; "
                "correct the name or remove the line"
            )
    places = np.array([rig.parts[name] for name in files])
    part = table.columns.get(PART, np.zeros(len(table)))
    return places[part.astype(int)]


def at_places(scan: Scan, rig: Rig) -> Scan:
    """Return a scan of presses cut from a stream with each contact point where it was stated."""
    if not rig.parts or rig.kind != "stream":
        return scan
    stated = rotated(rig, np.array(list(rig.parts.values())), place=True)
    return scan.replace(point_m=np.array(list(_nearest(scan, stated)))[scan.press_index])


def _nearest(scan: Scan, stated: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the stated place beside the line of each press."""
    for point, direction in zip(scan.contact_points, scan.contact_directions, strict=True):
        off = stated - point
        beside = off - np.outer(off @ direction, direction)
        yield stated[int(np.linalg.norm(beside, axis=1).argmin())]
