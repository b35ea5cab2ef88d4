"""The mapping `rig.toml`: which column or topic of a rig's recordings is what, in which unit.

It is written once a rig (`palpmap import FILE --propose` makes a first one) and kept for all
recordings of that rig.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from models import InputError
from palpmap.importing.mapping.orientation import ORDERS, fits_order
from palpmap.importing.readers.units import factor
from palpmap.study.body import Body, Point, Positive, Real, Table
from palpmap.study.faults import fault_sentence
from palpmap.study.study import Map, Noise, Probe


def _list_of(count: int, what: str) -> BeforeValidator:
    def check(value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) == count:
            return tuple(value)
        raise ValueError(f"a list of {count} {what}")

    return BeforeValidator(check)


Name = Annotated[str, Field(min_length=1)]
ThreeNames = Annotated[tuple[Name, Name, Name], _list_of(3, "columns [x, y, z]")]


def _orientation(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) in ORDERS:
        return tuple(value)
    raise ValueError(
        "a list of 3 columns (rotation vector, or angles of turns), of 4 (quaternion) or of 9 "
        "(matrix)"
    )


Orientation = Annotated[tuple[Name, ...], BeforeValidator(_orientation)]
Quaternion = Annotated[tuple[Real, Real, Real, Real], _list_of(4, "numbers [w, x, y, z]")]
Sign = Literal[1, -1]
AXES = ("tip +x", "tip -x", "tip +y", "tip -y", "tip +z", "tip -z")
TRAVEL = "travel"


def _direction(value: Any) -> Any:
    if value == TRAVEL or value in AXES:
        return value
    if isinstance(value, (list, tuple)) and len(value) == 3:
        numbers = [type(entry) in (int, float) for entry in value]
        if (all(numbers) and any(value)) or all(isinstance(entry, str) for entry in value):
            return tuple(value)
    raise ValueError(
        'three numbers [x, y, z], three columns, an axis such as "tip +z", or "travel"'
    )


Direction = Annotated[Any, BeforeValidator(_direction)]


class Clock(Table):
    """`[time]`: the column that counts the time.

    `pause_s` is the rest between parts whose clock starts anew.
    """

    column: Name = Field(description="the column of the time")
    unit: Name = "s"
    pause_s: Positive | None = None


class Column(Table):
    """One column with its unit; a sign of -1 turns it round."""

    column: Name = Field(description="the column's name")
    unit: Name = Field(description="the column's unit, in quotes")
    sign: Sign = 1


class Place(Table):
    """Three columns of a position, with their unit."""

    columns: ThreeNames = Field(description="three columns [x, y, z]")
    unit: Name = Field(description="the columns' unit, in quotes")


class Press(Table):
    """`[press]`: which readings belong together, and whither was pressed.

    Attributes
    ----------
    number : column of the press's number; `part` where each file, sheet or group is a press
    phase : column of the phase; found from force and travel where it is missing
    phases : names of the phase column's cells: load, hold, unload, approach or retract
    direction : direction of pressing, into the body: three numbers, three columns, an axis of the
        tip ("tip +z"), or "travel", the way the tip went
    """

    number: Name | None = None
    phase: Name | None = None
    phases: dict[str, Literal["load", "hold", "unload", "approach", "retract"]] = Field(
        default_factory=dict
    )
    direction: Direction = TRAVEL


class Force(Table):
    """`[force]`: the sensor, one column along the direction of pressing or three.

    Attributes
    ----------
    frame : axes in which three columns stand: those of the robot's base or of the tip
    sign : 1 where pressing into the body counts positive (one column), or where the vector is
        the force on the body; -1 where it is the force on the tip
    clock : time of these readings, where it is another than `[time]`
    """

    column: Name | None = None
    columns: ThreeNames | None = None
    unit: Name = Field(description="the force's unit, in quotes")
    sign: Sign = 1
    frame: Literal["base", "tip"] = "base"
    clock: Clock | None = None

    @model_validator(mode="after")
    def _one_or_three(self) -> Self:
        if (self.column is None) == (self.columns is None):
            raise ValueError('column = "..." or columns = [x, y, z], one of the two')
        return self

    @property
    def named(self) -> tuple[tuple[str, ...], str]:
        """Columns, one or three, and the key that names them."""
        if self.columns is not None:
            return self.columns, "force.columns"
        return (str(self.column),), "force.column"


class Pose(Table):
    """`[pose]`: where the tip is.

    Attributes
    ----------
    columns, unit : position
    orientation : columns of a rotation vector or of angles (3), a quaternion (4) or a matrix (9)
    order : of these, see `palpmap.importing.mapping.orientation.ORDERS`
    angle_unit : of three columns
    tip_offset_m : from the measured point to the tip's end, in the axes of the tip
    clock : time of these readings, where it is another than `[time]`
    clock_offset_s : add it to this clock to get the force's; found where it is missing
    """

    columns: ThreeNames = Field(description="three columns [x, y, z]")
    unit: Name = Field(description="the position's unit, in quotes")
    orientation: Orientation | None = None
    order: str = ""
    angle_unit: Name = "rad"
    tip_offset_m: Point = (0.0, 0.0, 0.0)
    clock: Clock | None = None
    clock_offset_s: Real | None = None

    @model_validator(mode="after")
    def _offset_needs_axes(self) -> Self:
        if any(self.tip_offset_m) and self.orientation is None:
            raise ValueError("orientation = [its columns], as tip_offset_m is in the tip's axes")
        return self

    @model_validator(mode="after")
    def _order_goes_with_columns(self) -> Self:
        count = len(self.orientation or ())
        if count and self.order and not fits_order(count, self.order):
            raise ValueError(f"order = {ORDERS[count]}, as orientation has {count} columns")
        return self


class Frame(Table):
    """`[frame]`: where the recording's base frame stands in the scan's frame."""

    position_m: Point = (0.0, 0.0, 0.0)
    rotation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Rows(Table):
    """`[rows]`: readings of a press that are taken into the scan, from a stream.

    `surface_m` is the largest distance by which a contact point is moved onto the surface.
    """

    load: Annotated[int, Field(ge=2, le=1000)] = 5
    hold: Annotated[int, Field(ge=0, le=1000)] = 5
    unload: Annotated[int, Field(ge=0, le=1000)] = 4
    surface_m: Positive = 2.0e-3


class Rig(Table):
    """The whole mapping.

    Attributes
    ----------
    kind : "readings" where rows are already presses, "stream" where presses are to be cut
    parts : where each file's press touched, [x, y, z] in m, by the file's name without its ending,
        for recordings without position; of a stream, `travel` then counts from anywhere
    """

    kind: Literal["readings", "stream"] = Field(description='"readings" or "stream"')
    name: str = "imported recording"
    time: Clock | None = None
    press: Press = Field(default_factory=Press)
    force: Force = Field(description="the table [force]")
    travel: Column | None = None
    point: Place | None = None
    radius: Column | None = None
    parts: dict[str, Point] = Field(default_factory=dict)
    pose: Pose | None = None
    frame: Frame = Field(default_factory=Frame)
    rows: Rows = Rows()
    probe: Probe | None = None
    body: Body | None = None
    noise: Noise = Field(default_factory=Noise)
    map: Map = Field(default_factory=Map)

    @model_validator(mode="before")
    @classmethod
    def _empty_tables_are_not_given(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {k: v for k, v in value.items() if not (k in ("probe", "body") and v == {})}

    def needed(self) -> tuple[tuple[str, str], ...]:
        """Keys without which this kind of recording cannot become a study, each with its question.

        Those that are given are left out.
        """
        asked = []
        if self.kind == "readings":
            asked += [
                (self.press.number, "press.number", "the column that numbers the presses"),
                (self.travel, "travel.column", "the column of the tip's travel since first touch"),
                (self.point or self.parts or None, "point.columns",
                 "the columns of the contact points"),
                (None if self.press.direction == TRAVEL else 1, "press.direction",
                 "the direction of pressing, into the body, such as [0.0, 0.0, -1.0]"),
            ]  # fmt: skip
        else:
            asked += [
                (self.time or (self.force.clock and self.pose and self.pose.clock), "time.column",
                 "the column of the time"),
                (self.pose or self.parts or None, "pose.columns",
                 "the columns of the tip's position; joint angles alone do not give it without "
                 "the robot's kinematics. Of files of one press each, [parts] may give the places"),
                (self.travel or not self.parts or None, "travel.column",
                 "the column of the tip's way, as parts give the places alone"),
            ]  # fmt: skip
        asked += [
            (self.probe, "probe.tip and probe.radius_m",
             'the tip\'s shape ("flat" or "sphere") and radius'),
            (self.body, "body.shape, body.size_m (or body.file) and body.poisson_ratio",
             "the body that was pressed"),
        ]  # fmt: skip
        return tuple((key, question) for given, key, question in asked if given is None)


def load_rig(path: str | os.PathLike[str]) -> Rig:
    """Read and check a mapping.

    Raises
    ------
    InputError
        Naming file and key, what was found and what is expected.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(
            f"{path}: no such file, expected a mapping (rig.toml); `palpmap import FILE --propose` "
            "prints a first one"
        )
    try:
        text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: found bytes that are not UTF-8; save it as UTF-8") from error
    rig = parse_rig(text, path)
    if rig.body is not None and rig.body.file is not None:
        file = path.resolve().parent / rig.body.file
        rig = rig.model_copy(update={"body": rig.body.model_copy(update={"file": file})})
    return rig


def parse_rig(text: str, path: Path) -> Rig:
    """Read a mapping from text; `path` names it in errors."""
    try:
        rig = Rig.model_validate(tomllib.loads(text))
        _check_units(rig)
        _check_parts(rig)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: found text that is not TOML: {error}; correct it") from error
    except ValidationError as error:
        raise InputError(fault_sentence(path, error, Rig)) from error
    except InputError as error:
        raise InputError(f"{path}, {error}") from error
    return rig


def _check_parts(rig: Rig) -> None:
    if not rig.parts:
        return
    if rig.pose is not None or rig.point is not None:
        key = "pose" if rig.pose is not None else "point"
        raise InputError(
            f"key parts: found the places of presses, and positions in {key}; remove one of the two"
        )
    direction = rig.press.direction
    if rig.kind == "stream" and (isinstance(direction, str) or isinstance(direction[0], str)):
        raise InputError(
            "key press.direction: expected three numbers, into the body, as parts have no way of "
            "their own"
        )


def _check_units(rig: Rig) -> None:
    if rig.pose is not None:
        factor(rig.pose.angle_unit, "angle", "pose.angle_unit")
    for name, dimension in (
        ("time", "time"), ("force", "force"), ("travel", "length"), ("point", "length"),
        ("radius", "length"), ("pose", "length"),
    ):  # fmt: skip
        part = getattr(rig, name)
        if part is not None:
            factor(part.unit, dimension, f"{name}.unit")
        if (clock := getattr(part, "clock", None)) is not None:
            factor(clock.unit, "time", f"{name}.clock.unit")
