"""Units of a mapping beside the recording's own, and refusals in words of the mapping."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from models import InputError
from palpmap.importing.mapping.rig import Rig
from palpmap.importing.readers.recording import Recording
from palpmap.importing.readers.units import spelled

_FACTORS = re.compile(r": divide by \d+| \(divide by [\d.]+\)")
_LOOKS = "this looks like"
_OUTLINE = "check body.size_m and body.origin_m in the study"
_FIRST_TOUCH = "found its first touch at"
"""Words of refusals that a wrong unit brings about."""


@dataclass(frozen=True)
class Source:
    """Columns of a recording that a mapping reads in one unit.

    Attributes
    ----------
    key : of the mapping, such as `point.unit`
    names : of the columns
    unit : as the mapping says
    scan : the columns of the scan that are made of them
    """

    key: str
    names: tuple[str, ...]
    unit: str
    scan: tuple[str, ...]


def sources(rig: Rig) -> Iterator[Source]:
    """Yield the columns that a mapping reads in a unit."""
    points = ("x_m", "y_m", "z_m")
    if rig.point is not None:
        yield Source("point.unit", rig.point.columns, rig.point.unit, points)
    if rig.pose is not None:
        yield Source("pose.unit", rig.pose.columns, rig.pose.unit, (*points, "displacement_m"))
    if rig.travel is not None:
        travel = rig.travel
        yield Source("travel.unit", (travel.column,), travel.unit, ("displacement_m", "force_n"))
    if rig.radius is not None:
        yield Source("radius.unit", (rig.radius.column,), rig.radius.unit, ("probe_radius_m",))
    yield Source("force.unit", rig.force.named[0], rig.force.unit, ("force_n",))
    if rig.time is not None:
        yield Source("time.unit", (rig.time.column,), rig.time.unit, ("time_s",))


def other_units(recording: Recording, rig: Rig) -> dict[str, str]:
    """Return the units that a recording states otherwise than the mapping, by the mapping's key."""
    found = {}
    for source in sources(rig):
        try:
            channels = [recording.channel(name, source.key) for name in source.names]
        except InputError:  # the column is missing, or named by its table: said as it is read
            continue
        stated = dict.fromkeys(spelled(channel.unit) for channel in channels if channel.unit)
        if others := [unit for unit in stated if unit and unit != spelled(source.unit)]:
            found[source.key] = ", ".join(others)
    return found


def told(rig: Rig, stated: Mapping[str, str]) -> list[str]:
    """Return a sentence for each of `other_units`, which were read as the mapping says."""
    return [
        f"{source.key} is {source.unit}, but the recording states {stated[source.key]} for "
        f"{', '.join(source.names)}: read in {source.unit}; correct the mapping if that is wrong."
        for source in sources(rig)
        if source.key in stated
    ]


def in_mapping(text: str, rig: Rig, stated: Mapping[str, str]) -> str:
    """Return a refusal of a scan with the units of the mapping that it may come from.

    Parameters
    ----------
    text : about columns of the scan
    stated : `other_units`: these first of all
    """
    column = re.search(r"column (\w+)", text)
    named = column[1] if column else "x_m" if _FIRST_TOUCH in text else ""
    if named == "probe_radius_m" and rig.radius is None:
        return text.replace("column probe_radius_m", "key probe.radius_m of the mapping")
    own = [source for source in sources(rig) if named in source.scan]
    own = [source for source in own if source.key in stated] or own
    if not own or not any(sign in text for sign in (_LOOKS, _OUTLINE, _FIRST_TOUCH)):
        return text
    keys = []
    for source in own:
        said = f" (the recording states {stated[source.key]})" if source.key in stated else ""
        keys.append(f'{source.key} = "{source.unit}"{said}, read from {", ".join(source.names)}')
    text = _FACTORS.sub("", text).replace(_OUTLINE, _OUTLINE.replace("study", "mapping"))
    also = "" if _LOOKS in text else "or "
    return f"{text}; {also}correct in the mapping {'; or '.join(keys)}"
