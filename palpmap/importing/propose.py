"""A first mapping for a recording, by looking: each line has its reason; a person corrects it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from models import PHASES, InputError
from palpmap.importing.look import (
    counts_presses,
    find_clock,
    find_travel,
    find_triples,
    first_fitting,
    is_force,
    is_phase,
    is_unit,
    matches,
    refuse_hidden,
    time_unit,
    unit_of,
)
from palpmap.importing.mapping.rig import Rig, parse_rig
from palpmap.importing.readers.recording import PART, Channel, Recording, Table
from palpmap.importing.readers.units import LENGTH
from palpmap.importing.robot_columns import find_force, find_place
from palpmap.importing.streams.alignment import force_with_depth

COURSE = 40  # rows a file: fewer are readings, not a course
ALIKE = 0.02  # of the correlation: two frames cannot be separated
_IN_BASE = r"^O_F_|TCP_force|base|world"
"""Forces in the base's axes by their names: of Franka's and of Universal Robots' own loggers."""
PHASE_WORDS = {
    "approach": ("approach", "anfahr", "annäh"),
    "load": ("load", "press", "belast", "loading", "in", "down"),
    "hold": ("hold", "halt", "dwell", "stay"),
    "unload": ("unload", "entlast", "release", "out", "up"),
    "retract": ("retract", "retreat", "rückzug", "away"),
}


@dataclass
class Line:
    """One line of the proposal."""

    text: str
    reason: str = ""


def propose_rig(recording: Recording) -> str:
    """Return a mapping as TOML; unknown entries stand there as comments.

    Raises
    ------
    InputError
        If no column can be the force.
    """
    refuse_hidden(recording)
    force = find_force(recording)
    table = force[0].table
    press = first_fitting(recording, "press", counts_presses)
    travel = find_travel(recording, force)
    readings = press is not None and travel is not None and not _is_machine(recording, travel)
    lines = [
        Line("# What the columns of this rig's recordings mean. Correct it, fill in what is"),
        Line("# missing (lines that begin with '# ... ='), and keep it for all recordings."),
        Line(""),
        Line(
            f'kind = "{"readings" if readings else "stream"}"',
            f"'{press.name}' numbers the presses" if readings and press else
            "each file is a course from free to contact: its press will be cut from it"
            if press and travel else
            f"'{press.name}' numbers the presses, but no column looks like travel: if the rows are "
            "readings, name it under [travel]"
            if press else
            "no column numbers the presses: they will be cut from the stream",
        ),
    ]  # fmt: skip
    clock = find_clock(table)
    if clock:
        unit, why = time_unit(clock)
        lines += [Line("\n[time]"), Line(f'column = "{_short(clock, table)}"', "rises from row to "
                  "row"), Line(f'unit = "{unit}"', why)]  # fmt: skip
        if PART in table.columns and np.any(np.diff(clock.numbers()) < 0):
            lines.append(Line("# pause_s =", "the clock starts anew in each part: the rest in s"))
    else:
        lines += _unread_clocks(recording, table)
    lines += _readings(recording, force, travel, press) if readings else _stream(recording, force)
    lines += [
        Line("\n[probe]"),
        Line("# tip =", '"flat" or "sphere"; a recording does not tell it'),
        Line("# radius_m =", "radius of the tip in m"),
        Line("\n[body]"),
        Line("# shape =", '"block", or "surface" with file = "organ.stl"'),
        Line("# size_m =", "of a block: [x, y, z] in m"),
        Line("# origin_m =", "of a block: its lower corner in the recording's frame, [x, y, z] in "
             "m; z lies size_m[2] below the touches"),
        Line("# poisson_ratio =", "0.49 for silicone and tissue"),
    ]  # fmt: skip
    text = "\n".join(_aligned(lines)) + "\n"
    parse_rig(text, Path("proposed mapping"))
    return text


def _aligned(lines: Sequence[Line]) -> list[str]:
    return [f"{line.text:<44}  # {line.reason}" if line.reason else line.text for line in lines]


def _quoted(channels: Sequence[Channel]) -> str:
    return "[" + ", ".join(f'"{channel.name}"' for channel in channels) + "]"


def _short(clock: Channel, table: Table) -> str:
    return next(name for name, values in table.columns.items() if values is clock.values)


def _unread_clocks(recording: Recording, table: Table) -> list[Line]:
    lines = []
    for channel in recording.channels:
        if channel.table is table and matches(channel, "time"):
            try:
                channel.numbers(empty=True)
            except InputError as error:
                lines.append(Line("\n# [time]", f"not read: {error}; seconds, or dates such as "
                                  "2026-03-01 10:00:00.125, are read"))  # fmt: skip
    return lines


def _readings(
    recording: Recording, force: tuple[Channel, ...], travel: Channel | None, press: Channel | None
) -> list[Line]:
    assert travel is not None
    assert press is not None
    lines = [
        Line("\n[press]"),
        Line(f'number = "{press.name}"', "whole numbers that seldom change"),
    ]
    phase = next((c for c in recording.channels if matches(c, "phase") and is_phase(c)), None)
    if phase is not None:
        lines.append(Line(f'phase = "{phase.name}"', "few different values"))
        if names := _phase_names(phase):
            pairs = ", ".join(f'"{text}" = "{name}"' for text, name in names.items())
            lines.append(Line(f"phases = {{{pairs}}}", "by the words: check it"))
    triples = find_triples(recording)
    direction = next((t for t in triples if matches(t[0], "direction") and is_unit(t)), None)
    points = [t for t in triples if t[0] not in force and t is not direction and not is_force(t[0])
              and matches(t[0], "point") and t[0].unit in ("", *LENGTH)]  # fmt: skip
    point = points[0] if points else None
    if direction:
        lines.append(Line(f"direction = {_quoted(direction)}", "columns of unit length"))
    elif point and np.ptp(point[2].values) < 1e-6 * (np.ptp(point[0].values) + 1e-12):
        lines.append(
            Line("direction = [0.0, 0.0, -1.0]", "all contact points have one z: down onto it")
        )
    else:
        lines.append(Line("# direction =", "of pressing, into the body: three numbers or columns"))
    unit, why = unit_of(force, "force")
    lines += [Line("\n[force]"), _force_columns(force), Line(f'unit = "{unit}"', why)]
    if len(force) == 1:
        lines.append(_sign(force[0].values, "the pressing force counts positive"))
    elif direction or any(line.text.startswith("direction = [") for line in lines):
        way = [c.values for c in direction] if direction else [0.0, 0.0, -1.0]
        along = sum(c.values * w for c, w in zip(force, way, strict=True))
        lines.append(_sign(np.asarray(along), "the force on the body goes along the direction"))
    lines += _lengths("travel", travel)
    lines.append(_sign(travel.values, "travel into the body counts positive"))
    if point:
        lines += _lengths("point", *point)
    else:
        lines += [Line("\n# [point]"), Line("# columns =", "the contact points [x, y, z]"),
                  Line("# unit =", "their unit"), *_places(travel.table)]  # fmt: skip
    radius = next((c for c in recording.channels if c.is_number and matches(c, "radius")
                   and c.unit in ("", *LENGTH)), None)  # fmt: skip
    lines += _lengths("radius", radius) if radius is not None else []
    said = "".join(line.text for line in [*lines, *_time_lines(travel.table)])
    rest = [n for n in travel.table.columns if f'"{n}"' not in said and n != PART]
    return [*lines, Line(f"\n# Not used: {', '.join(rest)}")] if rest else lines


def _lengths(key: str, *channels: Channel) -> list[Line]:
    """Return a table of the mapping for columns of lengths, which were found by their names."""
    unit, why = unit_of(channels, "length")
    names = Line(f"columns = {_quoted(channels)}", "by their names")
    if len(channels) == 1:
        names = Line(f'column = "{channels[0].name}"', "by its name")
    return [Line(f"\n[{key}]"), names, Line(f'unit = "{unit}"', why)]


def _force_columns(force: tuple[Channel, ...]) -> Line:
    if len(force) == 3:
        return Line(f"columns = {_quoted(force)}", "three axes, by their names")
    return Line(f'column = "{force[0].name}"', "by its name or unit")


def _sign(values: np.ndarray, rule: str) -> Line:
    largest = float(values[int(np.nanargmax(np.abs(values)))])
    return Line(
        f"sign = {1 if largest >= 0 else -1}", f"{rule}, and its largest value is {largest:.3g}"
    )


def _phase_names(phase: Channel) -> dict[str, str]:
    texts = [f"{v:g}" if phase.is_number else str(v) for v in np.unique(phase.values)]
    if set(texts) <= set(PHASES):
        return {}
    if phase.is_number:
        order = ["load", "hold", "unload"]
        return dict(zip(texts, order, strict=False)) if len(texts) <= 3 else {}
    found = {}
    for text in texts:
        low = text.strip().lower()
        if low in PHASES:
            continue
        names = [n for n, words in PHASE_WORDS.items() if low.startswith(words)]
        if names:
            found[text] = names[0]
    return found


def _stream(recording: Recording, force: tuple[Channel, ...]) -> list[Line]:
    unit, why = unit_of(force, "force")
    table = force[0].table
    place = find_place(recording, force)
    head = [Line("\n[press]"), Line('direction = "travel"', "the way the tip goes")]
    head += [Line("\n[force]"), _force_columns(force), Line(f'unit = "{unit}"', why)]
    travel = find_travel(recording, force) if place is None else None
    if travel is not None and travel.table.parts:
        return [*head[2:], *_of_parts(travel)]
    if place is None:
        return [
            *head,
            Line("\n# [pose]"),
            Line("# columns =", "the tip's position [x, y, z]; joint angles do not give it"),
            Line("# unit =", "its unit"),
        ]
    pose = place.position
    unit, why = unit_of(pose, "length")
    tail = [
        Line("\n[pose]"),
        Line(f"columns = {_quoted(pose)}", "by their names"),
        Line(f'unit = "{unit}"', why),
    ]
    if place.orientation:
        tail += [Line(f"orientation = {_quoted(place.orientation)}", place.reason),
                 Line(f'order = "{place.order}"')]  # fmt: skip
    if place.angle_unit:
        tail.append(Line(f'angle_unit = "{place.angle_unit}"'))
    other = pose[0].table
    clock = find_clock(other)
    if other is not table and clock is not None:
        name, own = _short(clock, other), find_clock(table)
        if own is None or _short(own, table) != name or time_unit(clock) != time_unit(own):
            tail.append(
                Line(f'clock = {{column = "{name}", unit = "{time_unit(clock)[0]}"}}',
                     f"the pose has its own clock in {other.name}")
            )  # fmt: skip
    tail.append(Line("# tip_offset_m =", "from the measured point to the tip's end, in its axes"))
    return [*head, *_tried(recording, force, [*head, *_time_lines(table), *tail]), *tail]


def _is_machine(recording: Recording, travel: Channel) -> bool:
    """Return true for files that are courses of a machine, with its travel and no position."""
    parts = travel.table.parts
    timed = find_clock(travel.table) is not None
    long = len(travel.values) >= COURSE * max(len(parts), 1)
    return bool(parts) and timed and long and find_place(recording, ()) is None


def _of_parts(travel: Channel) -> list[Line]:
    """Lines for files of one press each, without a position."""
    unit, why = unit_of([travel], "length")
    return [
        Line("\n[travel]"),
        Line(f'column = "{travel.name}"', "by its name; it may count from anywhere"),
        Line(f'unit = "{unit}"', why),
        _sign(travel.values - travel.values[0], "travel into the body counts positive"),
        Line("\n[press]"),
        Line("direction = [0.0, 0.0, -1.0]", "into the body, straight down: check it"),
        *_places(travel.table),
    ]


def _places(table: Table) -> list[Line]:
    """Lines for the places of files of one press each."""
    if not table.parts:
        return []
    head = Line("\n# [parts]", "the contact point of each file's press, [x, y, z] in m")
    return [head, *(Line(f'# "{name}" =') for name in table.parts)]


def _time_lines(table: Table) -> list[Line]:
    clock = find_clock(table)
    if clock is None:
        return []
    return [Line("\n[time]"), Line(f'column = "{_short(clock, table)}"'),
            Line(f'unit = "{time_unit(clock)[0]}"')]  # fmt: skip


def _tried(recording: Recording, force: tuple[Channel, ...], lines: list[Line]) -> list[Line]:
    """Sign and frame of the force: those with which force and depth rise together best."""
    frames = (
        ("base", "tip")
        if len(force) == 3 and any(line.text.startswith("orientation") for line in lines)
        else ("base",)
    )
    found: list[tuple[float, int, str]] = []
    plain = 'kind = "stream"\n' + "\n".join(line.text for line in lines)
    for sign, frame in product((1, -1), frames):
        text = plain.replace("[force]", f'[force]\nsign = {sign}\nframe = "{frame}"')
        rig: Rig = parse_rig(text, Path("proposed mapping"))
        try:
            found.append((force_with_depth(recording, rig), sign, frame))
        except InputError:
            continue
    if not found:
        return [Line("# sign =", "1 or -1; it could not be tried, as force and pose do not align")]
    correlation, sign, frame = max(found)
    why = f"force and depth then rise together (correlation {correlation:.2f})"
    if len(frames) == 1:
        return [Line(f"sign = {sign}", why)]
    others = max(((c, s, f) for c, s, f in found if f != frame), default=(0.0, sign, frame))
    if correlation - others[0] < ALIKE:
        named = _frame_by_name(force[0])
        _, sign, frame = others if others[2] == named else (correlation, sign, frame)
        said = "both frames fit alike: check it"
    else:
        said = f"{why}; in the other frame {others[0]:.2f}"
    return [Line(f"sign = {sign}", why), Line(f'frame = "{frame}"', said)]


def _frame_by_name(force: Channel) -> str:
    """Frame of three columns of the force, by their table's `frame_id` or their own name."""
    names = force.table.columns.get("frame_id")
    if names is not None:
        return "base" if re.search("base|world|map", str(names[0]).lower()) else "tip"
    return "base" if re.search(_IN_BASE, force.name, re.I) else "tip"
