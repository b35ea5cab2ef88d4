"""A recording in memory: the columns and topics of foreign files, under their own names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time
from fnmatch import fnmatchcase

import numpy as np

from models import InputError, nearest

PART = "part"


@dataclass(frozen=True, eq=False)
class Table:
    """Columns that share their rows: a text file, a sheet, a group of a file, or a topic.

    Attributes
    ----------
    name : of file, sheet, group or topic
    columns : arrays (m,) by name, float64 (NaN where a cell is empty) or text
    units : unit of a column as its source states it, by the column's name
    where : names a row (0-based) for a person, with its file
    stacks_by : tables of equal columns and equal `stacks_by` are parts of one; "" never stacks
    parts : names of the tables of which it was made, in their order
    """

    name: str
    columns: dict[str, np.ndarray]
    units: dict[str, str]
    where: Callable[[int], str]
    stacks_by: str = ""
    parts: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True, eq=False)
class Channel:
    """One column of a recording.

    Attributes
    ----------
    name : by which a mapping refers to it
    table : the table that it stands in
    values : (m,) float64, or text
    unit : as its source states it, "" where it states none
    """

    name: str
    table: Table
    values: np.ndarray
    unit: str

    @property
    def is_number(self) -> bool:
        """True where all cells are numbers or empty."""
        return self.values.dtype.kind == "f"

    def numbers(self, empty: bool = False) -> np.ndarray:
        """Return the values as float64, (m,).

        Dates become seconds since 1970, times of day seconds since midnight.

        Parameters
        ----------
        empty : True lets empty cells stand, as NaN

        Raises
        ------
        InputError
            Naming the first cell that is neither number nor date, or that is empty.
        """
        values = self.values if self.is_number else self._from_text()
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and not empty:
            raise InputError(
                f"{self.table.where(int(bad[0]))}, {self.name}: found an empty cell or a value "
                f"that is not finite ({len(bad)} of {len(values)} rows), expected a number; fill "
                "it in or remove the row"
            )
        return values

    def _from_text(self) -> np.ndarray:
        values = np.empty(len(self.values))
        for row, text in enumerate(self.values.tolist()):
            number = _number(text)
            if number is None:
                comma = "; write a decimal comma as a point, and no comma between thousands"
                raise InputError(
                    f"{self.table.where(row)}, {self.name}: found '{text[:30]}', expected a "
                    f"number{comma if ',' in text else ''}; correct the cell or name another column"
                )
            values[row] = number
        return values

    @property
    def reads_as_numbers(self) -> bool:
        """True where most cells are numbers, though some may be text."""
        return self.is_number or (
            2 * sum(_number(text) is not None for text in self.values.tolist()) > len(self.values)
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """All tables of the files that were read together.

    Attributes
    ----------
    tables : in the order of the files
    notes : sentences about what was assumed or left out in reading
    """

    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, tables: Iterable[Table], notes: Sequence[str] = ()) -> Recording:
        """Return a recording in which parts of one table (a file or sheet a press) are stacked."""
        groups: dict[tuple, list[Table]] = {}
        for number, table in enumerate(tables):
            alike = table.stacks_by or str(number)
            groups.setdefault((alike, *table.columns), []).append(table)
        said = list(notes)
        stacked = []
        for parts in groups.values():
            stacked.append(parts[0] if len(parts) == 1 else _stack(parts))
            if len(parts) > 1:
                said.append(
                    f"{len(parts)} tables with the same columns ({parts[0].name} to "
                    f"{parts[-1].name}) were read as one, in the order given; the column "
                    f"'{PART}' counts them from 0."
                )
        return cls(tuple(stacked), tuple(said))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all channels: of the column alone where no other table has it."""
        count: dict[str, int] = {}
        for table in self.tables:
            for column in table.columns:
                count[column] = count.get(column, 0) + 1
        return tuple(
            column if count[column] == 1 else f"{table.name}:{column}"
            for table in self.tables
            for column in table.columns
        )

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels, in the order of `names`."""
        found = [
            (table, column, values)
            for table in self.tables
            for column, values in table.columns.items()
        ]
        return tuple(
            Channel(name, table, values, table.units.get(column, ""))
            for name, (table, column, values) in zip(self.names, found, strict=True)
        )

    def channel(self, name: str, key: str) -> Channel:
        """Return a channel by column, or by TABLE:COLUMN where TABLE may hold `*`.

        Parameters
        ----------
        name : of the channel
        key : of the mapping that asks for it, for the error

        Raises
        ------
        InputError
            No channel or more than one has this name.
        """
        pattern, colon, column = name.rpartition(":")
        found = [
            Channel(name, table, table.columns[wanted], table.units.get(wanted, ""))
            for table in self.tables
            for wanted in ({name, column} if colon else {name})
            if wanted in table.columns and (wanted == name or fnmatchcase(table.name, pattern))
        ]
        if len(found) == 1:
            return found[0]
        if found:
            tables = ", ".join(f"'{channel.table.name}:{name}'" for channel in found[:4])
            raise InputError(
                f"key {key}: '{name}' stands in {len(found)} tables of the recording; name one as "
                f"{tables}"
            )
        twice = [one for one in self.names if re.fullmatch(re.escape(name) + r"\.\d+", one)]
        if len(twice) > 1:
            raise InputError(
                f"key {key}: '{name}' stands {len(twice)} times in the recording's header; name "
                f"one, counted from the left, as {', '.join(map(repr, twice[:4]))}"
            )
        some = ", ".join(self.names[:12]) + (", ..." if len(self.names) > 12 else "")
        raise InputError(
            f"key {key}: the recording has no '{name}'{nearest(name, self.names)}; it has {some}"
        )


def _number(text: str) -> float | None:
    """Return a cell's number, NaN where it is empty; of dates and times of day seconds.

    >>> _number("10:00:00.125"), _number("OVERFLOW")
    (36000.125, None)
    """
    for read in (
        lambda: float(text) if text else np.nan,
        lambda: datetime.fromisoformat(text).timestamp(),
        lambda: _of_day(time.fromisoformat(text)),
        lambda: datetime.strptime(text, "%d.%m.%Y %H:%M:%S.%f").timestamp(),
        lambda: datetime.strptime(text, "%d.%m.%Y %H:%M:%S").timestamp(),
    ):
        try:
            return read()
        except ValueError:
            continue
    return None


def _of_day(clock: time) -> float:
    return 3600 * clock.hour + 60 * clock.minute + clock.second + 1e-6 * clock.microsecond


def alike(name: str) -> str:
    """Return a name without its digits: press_001 and press_002 are alike.

    >>> alike("press_001") == alike("press_012")
    True
    """
    return re.sub(r"\d+", "#", name)


def _stack(parts: list[Table]) -> Table:
    starts = np.cumsum([0, *map(len, parts)])

    def where(row: int) -> str:
        part = int(np.searchsorted(starts, row, side="right")) - 1
        return parts[part].where(row - int(starts[part]))

    columns: dict[str, np.ndarray] = {}
    for column in parts[0].columns:
        arrays = [part.columns[column] for part in parts]
        if len({array.dtype.kind for array in arrays}) > 1:  # numbers here, text there
            arrays = [array.astype(str) for array in arrays]
        columns[column] = np.concatenate(arrays)
    columns[PART] = np.repeat(np.arange(len(parts), dtype=float), [len(part) for part in parts])
    units = {name: unit for part in reversed(parts) for name, unit in part.units.items()}
    names = tuple(part.name for part in parts)
    return replace(parts[0], columns=columns, units=units, where=where, parts=names)
