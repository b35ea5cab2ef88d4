"""Text tables of any dialect: separator, decimal mark, comment lines and header are found."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from models import InputError
from palpmap.importing.readers.recording import Table
from palpmap.importing.readers.units import NO_UNIT, name_and_unit, spelled

COMMENTS = ("#", "%", "//")
SEPARATORS = (",", ";", "\t", "|", " ")
PACKED = {b"\x1f\x8b": "a file packed by gzip", b"PK\3\4": "a zip archive",
          b"BZh": "a file packed by bzip2", b"\xfd7zXZ": "a file packed by xz"}  # fmt: skip
SAMPLE_LINES = 200
MOSTLY = 0.9
_EMPTY = {"", "nan", "na", "n/a", "null", "none", "-"}
_NUMBER = re.compile(r"[+-]?(\d+[.]?\d*|[.]\d+)([eEdD][+-]?\d+)?|[+-]?inf(inity)?", re.ASCII)
_DECIMAL = re.compile(r"[+-]?\d*,\d+([eEdD][+-]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+([.]\d*)?", re.ASCII)

Line = tuple[int, str]


def read_text(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read a text table.

    Returns
    -------
    tables : one
    notes : sentences about what was found

    Raises
    ------
    InputError
        No table in the text, or a row with more or fewer cells than the others.
    """
    text = _decoded(path, data)
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith(COMMENTS)
    ]
    if len(lines) < 2:
        found = "one line" if lines else "no line"
        raise InputError(f"{path}: found {found} of text, expected a header and rows of readings")
    separator, comma = _dialect(path, lines)
    rows = [(number, _cells(path, number, line, separator)) for number, line in lines]
    rows = _commented_header(path, text, rows, separator, comma) + rows
    header, units, body = _parts(path, rows, comma)
    names = once_each(header)
    _refuse_ragged(path, len(names), body)
    numbers = [number for number, _ in body]
    columns = {
        name: as_column([cells[i] for _, cells in body], comma) for i, name in enumerate(names)
    }
    kept = {name: values for name, values in columns.items() if not _is_blank(name, values)}
    table = Table(
        path.stem,
        kept,
        {name: unit for name, unit in zip(names, units, strict=True) if unit},
        lambda row: f"{path}, line {numbers[row]}",
        stacks_by="file",
    )
    mark = {"\t": "tabs", " ": "spaces"}.get(separator, f"'{separator}'")
    decimal = " and decimal commas" if comma else ""
    said = f"{path.name}: {len(body)} rows of text, {mark} between cells{decimal}."
    if names[0] == "column_1" and (above := rows.index(body[0])):
        said += f" {above} above them {'was' if above == 1 else 'were'} taken for a title."
    return [table], [said]


def once_each(names: list[str]) -> list[str]:
    """Return the names, repeated ones with a number behind each.

    >>> once_each(["t", "F", "F"])
    ['t', 'F.1', 'F.2']
    """
    return [
        f"{name}.{names[: i + 1].count(name)}" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    ]


def header_units(names: list[str], below: list[str] | None) -> tuple[list[str], list[str]]:
    """Return column names and units, from the headers and from a row of units below them."""
    if below is not None:
        return [name.strip() for name in names], [spelled(bare(cell)) or "" for cell in below]
    return [name.strip() for name in names], [name_and_unit(name)[1] for name in names]


def is_units_row(cells: list[str]) -> bool:
    """Whether a row holds units and nothing else."""
    units = [bare(cell) for cell in cells]
    known = [spelled(unit) is not None for unit in units]
    return any(known) and all(k or unit in NO_UNIT for k, unit in zip(known, units, strict=True))


def bare(cell: str) -> str:
    """Return a cell without brackets.

    >>> bare(" [mm] ")
    'mm'
    """
    return cell.strip().strip("[](){}").strip()


def _decoded(path: Path, data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings = ["utf-16"]
    elif packed := next((kind for start, kind in PACKED.items() if data.startswith(start)), None):
        raise InputError(f"{path}: found {packed}, expected the recording itself; unpack it first")
    elif b"\0" in data[:4096]:
        raise InputError(
            f"{path}: found a binary file, expected text (.csv, .txt), Excel, MATLAB, HDF5, NumPy, "
            "Parquet, MCAP or a ROS bag, each under its usual ending"
        )
    else:
        encodings = ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        try:
            return data.decode(encoding).replace("\N{MINUS SIGN}", "-")
        except UnicodeDecodeError:
            continue
    raise InputError(f"{path}: found text in an unknown encoding, expected UTF-8")


def _cells(path: Path, number: int, line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        cells = next(csv.reader(io.StringIO(line), delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{path}, line {number}: found text that is no table ({error})") from error
    return [cell.strip() for cell in cells]


def _dialect(path: Path, lines: list[Line]) -> tuple[str, bool]:
    """Separator of the cells, and whether the decimal mark is a comma.

    The pair that splits most lines of the lower half into equally many cells, most of them
    numbers, is taken.
    """
    sample = lines[len(lines) // 2 :][:SAMPLE_LINES]
    best, chosen = (0.0, 0.0), None
    for separator in SEPARATORS:
        rows = [_cells(path, number, line, separator) for number, line in sample]
        widths = [len(row) for row in rows]
        width = max(set(widths), key=widths.count)
        same = widths.count(width) / len(widths)
        if width < 2 or same < MOSTLY:
            continue
        for comma in (False, True):
            if comma and separator == ",":
                continue
            cells = [cell for row in rows for cell in row]
            numbers = np.mean([_is_number(cell, comma) for cell in cells])
            if (score := (float(numbers), same)) > best:
                best, chosen = score, (separator, comma)
    if chosen is None:
        raise InputError(
            f"{path}: found text that does not split into columns, expected cells separated by a "
            "comma, semicolon, tab, bar or spaces"
        )
    return chosen


def _is_number(cell: str, comma: bool) -> bool:
    if comma:
        cell = cell.replace(",", ".") if "." not in cell else "text"
    return cell.lower() in _EMPTY or _NUMBER.fullmatch(cell) is not None


def _commented_header(
    path: Path, text: str, rows: list[tuple[int, list[str]]], separator: str, comma: bool
) -> list[tuple[int, list[str]]]:
    """Return the comment above the first row if it names the columns."""
    number, first = rows[0]
    above = text.splitlines()[: number - 1]
    if not above or not above[-1].lstrip().startswith(COMMENTS):
        return []
    names = _cells(path, number - 1, above[-1].lstrip(" #%/"), separator)
    numbers = sum(_is_number(cell, comma) for cell in first)
    fits = len(names) == len(first) and not any(_is_number(name, comma) for name in names)
    return [(number - 1, names)] if fits and 2 * numbers > len(first) else []


def _parts(
    path: Path, rows: list[tuple[int, list[str]]], comma: bool
) -> tuple[list[str], list[str], list[tuple[int, list[str]]]]:
    """Header, units and body: the header is the last row of names before the readings."""
    widths = [len(cells) for _, cells in rows[len(rows) // 2 :]]
    width = max(set(widths), key=widths.count)
    bottom = [sum(_is_number(c, comma) for c in cells) for _, cells in rows[len(rows) // 2 :]]
    least = max(1, int(np.median(bottom)) // 2)
    first = next(
        (
            i
            for i, (_, cells) in enumerate(rows)
            if len(cells) >= width
            and sum(_is_number(c, comma) and c != "" for c in cells) >= least
            and not is_units_row(cells)
        ),
        None,
    )
    if first is None:
        raise InputError(f"{path}: found no row of numbers, expected a table of readings")
    wide = [i for i, (_, cells) in enumerate(rows[:first]) if width <= len(cells) <= width + 1]
    while wide and _is_sparse(rows[wide[-1]][1], comma):
        wide.pop()
    if not wide:
        names = [f"column_{i + 1}" for i in range(width)]
        return names, [""] * width, rows[first:]
    below = rows[wide.pop()][1] if len(wide) > 1 and is_units_row(rows[wide[-1]][1]) else None
    names = rows[wide[-1]][1]
    # A reading with few cells stands among those above the first full one
    partly = [
        (number, cells) for number, cells in rows[wide[-1] + 1 : first] if _has_number(cells, comma)
    ]
    body = partly + rows[first:]
    if len(names) == width + 1 and not names[-1]:
        names = names[:-1]
    names = [name or f"column_{i + 1}" for i, name in enumerate(names)]
    below = None if below is None else (below + [""] * len(names))[: len(names)]
    return *header_units(names, below), body


def _is_sparse(cells: list[str], comma: bool) -> bool:
    """Whether a row is a reading with empty cells, and no names."""
    return "" in cells[:-1] and _has_number(cells, comma)


def _has_number(cells: list[str], comma: bool) -> bool:
    return any(_is_number(cell, comma) for cell in cells if cell.lower() not in _EMPTY)


def _refuse_ragged(path: Path, width: int, body: list[tuple[int, list[str]]]) -> None:
    for number, cells in body:
        if len(cells) == width + 1 and not cells[-1]:
            cells.pop()
        if len(cells) != width:
            raise InputError(
                f"{path}, line {number}: found {len(cells)} cells, expected {width} as in the "
                "header; complete or remove the line"
            )


def as_column(cells: list[str], comma: bool) -> np.ndarray:
    """Return cells as numbers where all are numbers or empty, else as text."""
    cells = [cell.replace(",", ".") for cell in cells] if comma else _with_points(cells)
    try:
        return np.array(cells, dtype=float)
    except ValueError:
        pass
    if all(cell.lower() in _EMPTY or _NUMBER.fullmatch(cell) for cell in cells):
        texts = ("nan" if c.lower() in _EMPTY else re.sub("[dD]", "e", c) for c in cells)
        return np.array([float(text) for text in texts])
    return np.array(cells)


def _with_points(cells: list[str]) -> list[str]:
    """Return quoted cells without commas, where these are decimal or group digits in all of them.

    >>> _with_points(["0,5", "12"]), _with_points(["1,250.5", "3.0"]), _with_points(["1,250", "2"])
    (['0.5', '12'], ['1250.5', '3.0'], ['1,250', '2'])
    """
    commas = [cell for cell in cells if "," in cell]
    decimal = all(map(_DECIMAL.fullmatch, commas)) and not any("." in cell for cell in cells)
    grouped = all(map(_GROUPED.fullmatch, commas))
    if not commas or decimal == grouped:
        return cells
    return [cell.replace(",", "." if decimal else "") for cell in cells]


def _is_blank(name: str, values: np.ndarray) -> bool:
    nothing = np.isnan(values).all() if values.dtype.kind == "f" else not np.any(values != "")
    return bool(nothing) and name.startswith("column_")
