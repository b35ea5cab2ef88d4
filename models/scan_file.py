"""The Scan on disk, as CSV or Parquet.

CSV (UTF-8, header row, ',' between cells, '.' in numbers) and Parquet hold the same columns.
"""

import csv
import io
import os
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from models.arguments import kinds_checked
from models.errors import InputError
from models.replaced import replaced
from models.scan import Scan
from models.scan_checks import check_columns
from models.scan_columns import (
    DIRECTION,
    FORCE_VECTOR,
    OUTCOME,
    POINT,
    TEXT,
    TIP_POSE,
    Where,
    check_header,
    cut,
)

SCHEMA = 1
_SCHEMA_KEY = b"palpmap.scan_schema"
_PARQUET = b"PAR1"  # with which such a file begins
_COMMENTS = re.compile(r"([ \t]*(#[^\r\n]*)?(\r\n|\r|\n))+")
_FINITE_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@kinds_checked
def read_scan(path: str | os.PathLike[str], units_checked: bool = False) -> Scan:
    """Read a Scan from a .csv or .parquet file and check it.

    Lines at the top of a .csv that begin with '#' are comments.

    Parameters
    ----------
    path : file whose ending tells its form
    units_checked : the user has confirmed the units: sizes that look like millimetres or grams are
        then accepted

    Raises
    ------
    InputError
        Naming file, row, column, what was found, what is expected and what to do.

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.read_scan("tests/data/twelve_presses/scan.csv").press_ids[:3].tolist()
    [0, 2, 4]
    """
    path = Path(path)
    forms = {".csv": _read_csv, ".parquet": _read_parquet}
    read = None if path.is_dir() else _by_ending(path, forms)
    if read is None or not path.is_file():
        kind = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {kind}, expected a scan (.csv or .parquet); check the path")
    data = path.read_bytes()
    if not data:
        raise InputError(f"{path}: the file is empty, expected a header row and one row a sample")
    columns, where = read(path, data)
    check_columns(columns, where, units_checked)
    return _scan_from_columns(columns)


@kinds_checked
def write_scan(scan: Scan, path: str | os.PathLike[str]) -> None:
    """Write a Scan as .csv or .parquet; numbers are read back bit for bit.

    The file is replaced in one step, so that a killed program leaves the old or the new one.

    Raises
    ------
    InputError
        The ending is neither .csv nor .parquet, or there is no such folder.

    Examples
    --------
    >>> import palpmap as pm
    >>> scan = pm.read_scan("tests/data/twelve_presses/scan.csv")
    >>> path = getfixture("tmp_path") / "copy.parquet"
    >>> pm.write_scan(scan, path)
    >>> len(pm.read_scan(path))
    264
    """
    path = Path(path)
    write = _by_ending(path, {".csv": _write_csv, ".parquet": _write_parquet})
    with replaced(path) as beside:
        write(_table_from_scan(scan), beside)


def _by_ending(path: Path, forms: dict):
    if path.suffix.lower() not in forms:
        raise InputError(f"{path}: found the ending '{path.suffix}', expected .csv or .parquet")
    return forms[path.suffix.lower()]


def _scan_from_columns(columns: dict[str, np.ndarray]) -> Scan:
    def together(names: tuple[str, ...]) -> np.ndarray | None:
        there = names[0] in columns
        return np.column_stack([columns[name] for name in names]) if there else None

    direction = np.column_stack([columns[name] for name in DIRECTION])
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    # Only what a file's rounding has spoilt is renormalised: reading back stays exact.
    off = np.abs(length - 1) > 1e-12
    return Scan(
        press=columns["press"].astype(np.int64),
        time_s=columns["time_s"],
        phase=columns["phase"],
        point_m=np.column_stack([columns[name] for name in POINT]),
        direction=np.where(off, direction / length, direction),
        force_n=columns["force_n"],
        displacement_m=columns["displacement_m"],
        probe_radius_m=columns["probe_radius_m"],
        force_vector_n=together(FORCE_VECTOR),
        tip_pose=together(TIP_POSE),
        outcome=columns.get(OUTCOME),
    )


def check_scan(scan: Scan, name: str, units_checked: bool = False) -> None:
    """Check a Scan that was made of arrays as one that is read from a file.

    Parameters
    ----------
    name : of the scan, for sentences
    units_checked : see `read_scan`

    Raises
    ------
    InputError
        Naming the scan (`name`), row, column, what was found, what is expected and what to do.
    """
    check_columns(_columns_of(scan), Where(name, in_study=False), units_checked)


def _columns_of(scan: Scan) -> dict[str, np.ndarray]:
    columns = {"press": scan.press, "time_s": scan.time_s, "phase": scan.phase}
    columns |= dict(zip(POINT, scan.point_m.T, strict=True))
    columns |= dict(zip(DIRECTION, scan.direction.T, strict=True))
    columns |= {name: getattr(scan, name) for name in ("force_n", "displacement_m")}
    columns["probe_radius_m"] = scan.probe_radius_m
    if scan.force_vector_n is not None:
        columns |= dict(zip(FORCE_VECTOR, scan.force_vector_n.T, strict=True))
    if scan.tip_pose is not None:
        columns |= dict(zip(TIP_POSE, scan.tip_pose.T, strict=True))
    if scan.outcome is not None:
        columns[OUTCOME] = scan.outcome
    return columns


def _table_from_scan(scan: Scan) -> pa.Table:
    columns: dict = dict(_columns_of(scan))
    columns["time_s"] = pa.array(scan.time_s, mask=np.isnan(scan.time_s))
    return pa.table({n: v.tolist() if n in TEXT else v for n, v in columns.items()})


def _write_csv(table: pa.Table, path: Path) -> None:
    with path.open("wb") as file:
        file.write((",".join(table.column_names) + "\n").encode())
        options = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
        pyarrow.csv.write_csv(table, file, options)


def _write_parquet(table: pa.Table, path: Path) -> None:
    pq.write_table(table.replace_schema_metadata({_SCHEMA_KEY: str(SCHEMA)}), path)


def _read_parquet(path: Path, data: bytes) -> tuple[dict[str, np.ndarray], Where]:
    where = Where(str(path))
    try:
        table = pq.ParquetFile(io.BytesIO(data)).read()
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            f"{path}: found a file that is not Parquet or is cut off ({error}); write it again, "
            "or name it .csv if it is text"
        ) from error
    found = (table.schema.metadata or {}).get(_SCHEMA_KEY, b"1").decode("utf-8", "replace")
    if not (found.isascii() and found.isdigit() and len(found) < 10 and int(found) <= SCHEMA):
        raise InputError(
            f"{path}: found scan schema {found[:20]}, expected at most {SCHEMA}; update palpmap"
        )
    check_header(table.column_names, where)
    return _columns_from_table(table, where), where


def _read_csv(path: Path, data: bytes) -> tuple[dict[str, np.ndarray], Where]:
    if data.startswith(_PARQUET):
        raise InputError(f"{path}: found a Parquet file, expected text; name it .parquet")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: found the byte 0x{data[error.start]:02x}, expected UTF-8 text; "
            "save the table as CSV UTF-8"
        ) from error
    rows, lines = _split_cells(path, _without_comments(text))
    where = Where(str(path), lambda row: lines[row + 1])
    header, *body = rows
    if len(header) == 1 and (";" in header[0] or "\t" in header[0]):
        mark = "';'" if ";" in header[0] else "tabs"
        raise InputError(
            f"{path}, line {lines[0]}: found {mark} between the columns, expected ','; "
            "save with ',' between cells and '.' in numbers"
        )
    check_header(header, where)
    for row, cells in enumerate(body):
        if len(cells) != len(header):
            hint = "write numbers with '.', not ','" if len(cells) > len(header) else "complete it"
            if len(cells) == len(header) + 1 and not cells[-1].strip():
                hint = "the line ends with a comma too many, remove it"
            raise InputError(
                f"{where.row(row)}: found {len(cells)} cells, expected {len(header)} as in the "
                f"header; {hint}: {','.join(cells)[:60]}"
            )
    columns = {name: [cells[i] for cells in body] for i, name in enumerate(header)}
    return {name: _from_text(cells, name, where) for name, cells in columns.items()}, where


def _without_comments(text: str) -> str:
    """Empty the lines at the top that begin with '#'; the others keep their numbers."""
    top = _COMMENTS.match(text)
    end = top.end() if top else 0
    return re.sub(r"[^\r\n]", "", text[:end]) + text[end:]


def _split_cells(path: Path, text: str) -> tuple[list[list[str]], list[int]]:
    """Split CSV text into rows of cells and their line numbers; blank lines hold no row."""
    rows, lines = [], []
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for cells in reader:
            if cells and not (len(cells) == 1 and not cells[0].strip()):
                rows.append(cells)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(
            f"{path}, line {reader.line_num}: found text that is not CSV ({error}), expected "
            "cells separated by ','; look for a stray quotation mark"
        ) from error
    if not rows:
        raise InputError(f"{path}: the file is blank, expected a header row and one row a sample")
    return rows, lines


def _columns_from_table(table: pa.Table, where: Where) -> dict[str, np.ndarray]:
    columns = {}
    for name in table.column_names:
        cells = table[name]
        kind = cells.type.value_type if pa.types.is_dictionary(cells.type) else cells.type
        numeric = pa.types.is_floating(kind) or pa.types.is_integer(kind)
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            columns[name] = _from_text([cell or "" for cell in cells.to_pylist()], name, where)
        elif numeric and name not in TEXT:
            columns[name] = cells.cast(pa.float64(), safe=False).to_numpy()
        elif pa.types.is_null(kind) and name == "time_s":
            columns[name] = np.full(len(cells), np.nan)
        else:
            raise InputError(
                f"{where.file}, column {name}: found values of type {cells.type}, expected "
                f"{'text' if name in TEXT else 'numbers'}; convert the column"
            )
    return columns


def _from_text(cells: list[str], name: str, where: Where) -> np.ndarray:
    cells = [cell.strip() for cell in cells]
    if name in TEXT:
        return np.array(cells, dtype=np.str_)
    if name == "time_s" and all(cell.lower() in ("", "nan") for cell in cells):
        return np.full(len(cells), np.nan)
    bad = next((i for i, cell in enumerate(cells) if not _FINITE_NUMBER.fullmatch(cell)), None)
    if bad is None:
        return np.array(cells, dtype=np.float64)
    found = f"'{cut(cells[bad])}'" if cells[bad] else "an empty cell"
    do = "write numbers with '.', not ','" if "," in found else "correct it or remove the row"
    if name == "time_s":
        do += "; if times are unknown leave the whole column empty"
    raise InputError(f"{where.cell(bad, name)}: found {found}, expected a finite number; {do}")
