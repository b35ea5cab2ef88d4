"""Channels of a recording recognised by name, unit and values."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from models import PHASES, InputError
from palpmap.importing.readers.bag import RECEIVED, STAMP
from palpmap.importing.readers.recording import PART, Channel, Recording, Table
from palpmap.importing.readers.units import (
    DIMENSIONS,
    FORCE,
    LENGTH,
    TIME,
    name_and_unit,
    unknown_unit,
)

NAMES = {
    "time": r"^(t|time|zeit|timestamp|stamp|clock|when|sec|seconds|dat(e|um).*|uhrzeit)$",
    "force": r"force|kraft|wrench|load.?cell|^f_?[xyzn]?$|^f[xyz]\b|^ft[_ ]|f_ext",
    "travel": r"travel|displac|depth|indent|weg|eindring|stroke|extension|crosshead|^d$|height",
    "point": r"contact|point|place|touch|tip|tcp|^p?_?[xyz]$|^pos|position|^[xyz]\b",
    "pose": r"pose|position|tcp|tip|translation|^p?_?[xyz]$|^pos|^[xyz]\b",
    "press": r"press|kontakt|contact.?(no|id|nr)?$|^no$|^nr$|^id$|trial|touch.?(no|id)|^n$",
    "phase": r"phase|state|segment|abschnitt|^ph$",
    "radius": r"radius|^r$",
    "direction": r"^n_?[xyz]$|normal|direction",
}


AXIS = re.compile(r"(?<![a-z])(?P<q>q_?)?(?P<axis>[xyzw])(?![a-z])|\[(?P<number>[0-3])\]$", re.I)


def column_of(channel: Channel) -> str:
    """Return the column's own name, without its table."""
    return channel.name.rpartition(":")[2] if ":" in channel.name else channel.name


def bare_name(channel: Channel) -> str:
    """Return the column's own name without table and unit."""
    return name_and_unit(column_of(channel))[0]


def matches(channel: Channel, what: str) -> bool:
    """Whether the name looks like time, force, travel, point, pose, press, phase, ..."""
    return re.search(NAMES[what], bare_name(channel), re.I) is not None or (
        ":" in channel.name and re.search(NAMES[what], channel.name, re.I) is not None
    )


def first_fitting(recording: Recording, what: str, fits) -> Channel | None:
    """Return the channel whose name and values fit, one fitting by name before others."""
    fitting = [channel for channel in recording.channels if fits(channel)]
    named = [channel for channel in fitting if matches(channel, what)]
    parts = [channel for channel in fitting if column_of(channel) == PART]
    return next(iter(named + parts), None)


def counts_presses(channel: Channel) -> bool:
    """Whether the values number presses: whole, seldom changing, never falling without a name."""
    if not channel.is_number or channel.unit or np.isnan(channel.values).any():
        return False
    values = channel.values
    steps = np.diff(values)
    rising = np.all(steps >= 0) or matches(channel, "press")  # or numbers of their places
    whole = np.all(values == np.round(values)) and rising
    is_topic = RECEIVED in channel.table.columns  # one message a press
    return bool(whole and 0 < np.sum(steps != 0) < (len(values) if is_topic else len(values) / 2))


def find_triples(recording: Recording) -> list[tuple[Channel, Channel, Channel]]:
    """Channels of one table whose names differ by x, y, z or 0, 1, 2 alone."""
    groups: dict[tuple, dict[str, Channel]] = {}
    for channel in recording.channels:
        if not channel.is_number:
            continue
        for match in _axes(channel):
            axis = match["axis"] or "xyzw"[int(match["number"])]
            name = channel.name
            key = (id(channel.table), name[: match.start()], name[match.end() :], bool(match["q"]))
            groups.setdefault(key, {})[axis.lower()] = channel
    triples = [g for g in groups.values() if {"x", "y", "z"} <= set(g)]
    return [(g["x"], g["y"], g["z"]) for g in triples if not _is_quaternion(g)]


def _is_quaternion(group: dict[str, Channel]) -> bool:
    """Return true for columns x, y, z with a w of unit length, not a width."""
    four = [group[axis].values for axis in "xyzw" if axis in group]
    length = np.linalg.norm(four, axis=0)
    known = length[np.isfinite(length)]
    return len(four) == 4 and len(known) > 0 and bool(np.all(np.abs(known - 1) < 0.025))


def _axes(channel: Channel) -> list[re.Match]:
    name = channel.name
    found = [m for m in AXIS.finditer(name) if not m["q"]]
    ends = re.search(r"[a-z_.]?([xyz])(?=(_|\s|\[|\(|/|$))", name, re.I)
    if not found and ends and len(bare_name(channel)) <= 12:
        found = [m for m in re.finditer(r"(?P<q>(?!))?(?P<axis>[xyz])(?P<number>(?!))?"
                                        r"(?=(_|\s|\[|\(|/|$))", name, re.I)]  # fmt: skip
    return found[-1:]


def is_force(channel: Channel) -> bool:
    """Return true for a unit or name of a force."""
    return channel.unit in FORCE or (not channel.unit and matches(channel, "force"))


def refuse_hidden(recording: Recording) -> None:
    """Refuse a column of forces or lengths that is text by some of its cells.

    Raises
    ------
    InputError
        Naming the first such cell.
    """
    for c in recording.channels:
        looks = is_force(c) or matches(c, "travel") or c.unit in LENGTH
        if looks and not c.is_number and c.reads_as_numbers:
            c.numbers(empty=True)


def find_travel(recording: Recording, force: tuple[Channel, ...]) -> Channel | None:
    """Return the travel of the tip, None where no column looks like it."""
    fits = [
        c
        for c in recording.channels
        if c.is_number and matches(c, "travel") and c.unit in ("", *LENGTH)
        and c not in force and not matches(c, "force")
    ]  # fmt: skip
    return fits[0] if fits else None


def find_clock(table: Table) -> Channel | None:
    """Return the column that times a table's rows, a sender's stamp first."""
    channels = [Channel(n, table, v, table.units.get(n, "")) for n, v in table.columns.items()]

    def rises(channel: Channel) -> bool:
        try:
            values = channel.numbers()
        except InputError:
            return False
        return len(values) > 2 and float(np.mean(np.diff(values) >= 0)) > 0.9

    for wanted in (
        lambda c: c.name == STAMP,
        lambda c: c.unit in TIME and c.unit not in ("min", "h"),
        lambda c: re.search(NAMES["time"], bare_name(c), re.I),
        lambda c: c.name == RECEIVED,
    ):
        for channel in channels:
            if wanted(channel) and channel.name != PART and rises(channel):
                return channel
    return None


def time_unit(clock: Channel) -> tuple[str, str]:
    """Return the unit of a clock, and the reason."""
    if clock.unit in TIME:
        return clock.unit, "as the header says"
    if not clock.is_number:
        return "s", "dates are read as seconds"
    largest = float(np.nanmax(np.abs(clock.values)))
    for unit, scale in (("ns", 1e17), ("us", 1e14), ("ms", 1e11)):
        if largest > scale:
            return unit, f"{largest:.4g} would be {unit} since 1970"
    step = float(np.median(np.diff(clock.values)))
    if step >= 1 and largest > 1e4:
        return "ms", f"steps of {step:g} and a largest of {largest:g} would be long in s: check it"
    return "s", f"steps of {step:.3g} go with s"


def unit_of(channels: Sequence[Channel], dimension: str) -> tuple[str, str]:
    """Return the unit of some columns of force or length, and the reason."""
    unit = channels[0].unit
    if unit in DIMENSIONS[dimension]:
        return unit, "as the recording says"
    stated, known = unknown_unit(column_of(channels[0])), ", ".join(DIMENSIONS[dimension])
    lacking = f"the unit '{stated}' is none of {known}" if stated else "no unit stated"
    largest = float(max(np.nanmax(np.abs(channel.values)) for channel in channels))
    if dimension == "force":
        unit = "N" if largest < 100 else "mN" if largest > 1000 else "g"
        return unit, f"{lacking}; values up to {largest:.3g} look like {unit}: check it"
    limit = 0.06 if len(channels) == 1 else 3.0
    unit = "m" if largest < limit else "mm"
    return unit, f"{lacking}; values up to {largest:.3g} look like {unit}: check it"


def is_phase(channel: Channel) -> bool:
    """Whether the column has as few different values as there are phases."""
    return channel.name.rpartition(":")[2] not in (RECEIVED, STAMP) and (
        1 < len(np.unique(channel.values)) <= 2 * len(PHASES)
    )


def is_unit(triple: tuple[Channel, ...]) -> bool:
    """Return true where three columns are unit vectors."""
    length = np.sqrt(sum(channel.values**2 for channel in triple))
    return bool(np.all(np.abs(length - 1) < 1e-2))


def find_quaternion(recording: Recording, table: Table) -> tuple[Channel, ...]:
    """Return four columns x, y, z, w of unit length in a table, or none."""
    groups: dict[str, dict[str, Channel]] = {}
    for channel in recording.channels:
        if channel.table is table and channel.is_number:
            match = re.search(r"(?P<q>q_?|orientation\.|rotation\.|quat\w*[._]?)(?P<axis>[xyzw])\b",
                              channel.name, re.I)  # fmt: skip
            if match:
                key = channel.name[: match.start("axis")]
                groups.setdefault(key, {})[match["axis"].lower()] = channel
    for group in groups.values():
        if set(group) == set("xyzw") and _is_quaternion(group):
            return tuple(group[axis] for axis in "xyzw")
    return ()
