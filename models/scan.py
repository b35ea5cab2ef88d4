"""The Scan: the one table between measuring and explaining, and its two file forms.

One row a sample, SI units; a press is a run of rows with the same id. CSV (UTF-8, header row, ','
between cells, '.' in numbers) and Parquet hold the same columns.
"""

import csv
import io
import os
import re
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from models.errors import InputError
from models.scan_checks import (
    CONTACT_PHASES,
    DIRECTION,
    FORCE_VECTOR,
    PHASES,
    POINT,
    TIP_POSE,
    Where,
    check_columns,
    check_header,
)

SCHEMA = 1
_SCHEMA_KEY = b"palpmap.scan_schema"
_PHASE = np.dtype(("U", max(map(len, PHASES))))
_PARQUET = b"PAR1"  # with which such a file begins
_COMMENTS = re.compile(r"([ \t]*(#[^\r\n]*)?(\r\n|\r|\n))+")
_FINITE_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, eq=False)
class Scan:
    """Measured table of a palpation: m samples of J presses; all arrays are read-only.

    Attributes
    ----------
    press : (m,) int64
        Id of the press of each sample, in the order in which the presses were made.
    time_s : (m,) float64
        Absolute time over the whole scan in s; all NaN where the source has none.
    phase : (m,) str
        load, hold, unload, approach or retract.
    point_m : (m, 3) float64
        Contact point on the undeformed surface in m, body frame; one a press.
    direction : (m, 3) float64
        Unit direction of pressing, into the body; one a press.
    force_n : (m,) float64
        Contact force along the direction in N, pressing positive.
    displacement_m : (m,) float64
        Travel of the tip along the direction since first touch in m, inwards positive.
    probe_radius_m : (m,) float64
        Radius of the flat tip, or of the sphere, in m; one a press.
    force_vector_n : (m, 3) float64 or None
        Force vector on the body in N.
    tip_pose : (m, 7) float64 or None
        Measured pose of the tip: position in m and quaternion w, x, y, z.

    Raises
    ------
    ValueError
        If the arrays' lengths differ, a phase is unknown or the press ids fall.
    """

    press: np.ndarray
    time_s: np.ndarray
    phase: np.ndarray
    point_m: np.ndarray
    direction: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    probe_radius_m: np.ndarray
    force_vector_n: np.ndarray | None = None
    tip_pose: np.ndarray | None = None

    def __post_init__(self):
        m = len(self.press)
        widths = {"point_m": 3, "direction": 3, "force_vector_n": 3, "tip_pose": 7}
        kinds = {"press": np.int64, "phase": _PHASE}
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            array = np.array(value)
            if field.name == "phase" and not np.isin(array, PHASES).all():
                unknown = set(array.tolist()) - set(PHASES)
                raise ValueError(f"phase holds {unknown}, expected {PHASES}")
            array = array.astype(kinds.get(field.name, np.float64))
            shape = (m, widths[field.name]) if field.name in widths else (m,)
            if array.shape != shape:
                raise ValueError(f"{field.name} has shape {array.shape}, expected {shape}")
            array.flags.writeable = False
            object.__setattr__(self, field.name, array)
        if np.any(np.diff(self.press) < 0):
            raise ValueError("press ids fall, expected the order in which the presses were made")

    def __len__(self) -> int:
        """Return the number of samples m."""
        return len(self.press)

    @cached_property
    def _first_row(self) -> np.ndarray:
        return _read_only(np.unique(self.press, return_index=True)[1])

    @property
    def press_ids(self) -> np.ndarray:
        """Ids of the presses, (J,)."""
        return self.press[self._first_row]

    @cached_property
    def press_index(self) -> np.ndarray:
        """Index 0..J-1 of the press of each row, (m,)."""
        return _read_only(np.searchsorted(self.press_ids, self.press))

    @property
    def contact_points(self) -> np.ndarray:
        """Contact point of each press in m, (J, 3)."""
        return self.point_m[self._first_row]

    @property
    def contact_directions(self) -> np.ndarray:
        """Unit direction of pressing of each press, into the body, (J, 3)."""
        return self.direction[self._first_row]

    @property
    def contact_radii(self) -> np.ndarray:
        """Tip radius of each press in m, (J,)."""
        return self.probe_radius_m[self._first_row]

    @property
    def has_time(self) -> bool:
        """Whether the source knew the time of its samples."""
        return not bool(np.isnan(self.time_s).any())

    @property
    def in_contact(self) -> np.ndarray:
        """Whether a row's phase is load, hold or unload, (m,) bool."""
        return np.isin(self.phase, CONTACT_PHASES)

    @property
    def ignored_rows(self) -> int:
        """Number of approach and retract rows, which models do not use."""
        return int(np.count_nonzero(~self.in_contact))

    def rows(self, which: np.ndarray) -> "Scan":
        """Return the Scan of the chosen rows (mask or indices in rising order)."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{k: v[which] for k, v in arrays.items() if v is not None})

    def used(self) -> "Scan":
        """Return the Scan without approach and retract rows; `ignored_rows` counts those."""
        return self.rows(self.in_contact)

    @property
    def near_largest_force(self) -> np.ndarray:
        """Rows within 10 % of their press's largest force, (m,) bool.

        The single largest would be the one whose noise is largest.
        """
        largest = np.full(len(self.press_ids), -np.inf)
        np.maximum.at(largest, self.press_index, self.force_n)
        return self.force_n >= 0.9 * largest[self.press_index]

    def at_largest_force(self, values: np.ndarray) -> np.ndarray:
        """Return each press's mean (J,) of values (m,) near its largest force."""
        near = self.near_largest_force
        count = np.bincount(self.press_index, near)
        return np.bincount(self.press_index, near * values) / np.maximum(count, 1.0)

    def replace(self, **changes) -> "Scan":
        """Return a copy with some arrays replaced."""
        return replace(self, **changes)


def read_scan(path: str | os.PathLike[str], units_checked: bool = False) -> Scan:
    """Read a Scan from a .csv or .parquet file and check it.

    Lines at the top of a .csv that begin with '#' are comments.

    Parameters
    ----------
    path : path
        File whose ending tells its form.
    units_checked : bool
        True where the user has confirmed the units: sizes that look like millimetres or grams
        are then accepted.

    Raises
    ------
    InputError
        Naming file, row, column, what was found, what is expected and what to do.
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


def write_scan(scan: Scan, path: str | os.PathLike[str]) -> None:
    """Write a Scan as .csv or .parquet; numbers are read back bit for bit.

    The file is replaced in one step, so that a killed program leaves the old or the new one.

    Raises
    ------
    InputError
        If the ending is neither .csv nor .parquet.
    """
    path = Path(path)
    write = _by_ending(path, {".csv": _write_csv, ".parquet": _write_parquet})
    beside = path.with_name(path.name + ".part")
    write(_table_from_scan(scan), beside)
    beside.replace(path)


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


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
    )


def _table_from_scan(scan: Scan) -> pa.Table:
    columns: dict = {
        "press": scan.press,
        "time_s": pa.array(scan.time_s, mask=np.isnan(scan.time_s)),
        "phase": scan.phase.tolist(),
    }
    columns |= dict(zip(POINT, scan.point_m.T, strict=True))
    columns |= dict(zip(DIRECTION, scan.direction.T, strict=True))
    columns |= {name: getattr(scan, name) for name in ("force_n", "displacement_m")}
    columns["probe_radius_m"] = scan.probe_radius_m
    if scan.force_vector_n is not None:
        columns |= dict(zip(FORCE_VECTOR, scan.force_vector_n.T, strict=True))
    if scan.tip_pose is not None:
        columns |= dict(zip(TIP_POSE, scan.tip_pose.T, strict=True))
    return pa.table(columns)


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
    schema = int((table.schema.metadata or {}).get(_SCHEMA_KEY, b"1"))
    if schema > SCHEMA:
        raise InputError(
            f"{path}: found scan schema {schema}, expected at most {SCHEMA}; update palpmap"
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
        elif numeric and name != "phase":
            columns[name] = cells.cast(pa.float64()).to_numpy()
        elif pa.types.is_null(kind) and name == "time_s":
            columns[name] = np.full(len(cells), np.nan)
        else:
            raise InputError(
                f"{where.file}, column {name}: found values of type {cells.type}, expected "
                f"{'text' if name == 'phase' else 'numbers'}; convert the column"
            )
    return columns


def _from_text(cells: list[str], name: str, where: Where) -> np.ndarray:
    cells = [cell.strip() for cell in cells]
    if name == "phase":
        return np.array(cells, dtype=np.str_)
    if name == "time_s" and all(cell.lower() in ("", "nan") for cell in cells):
        return np.full(len(cells), np.nan)
    bad = next((i for i, cell in enumerate(cells) if not _FINITE_NUMBER.fullmatch(cell)), None)
    if bad is None:
        return np.array(cells, dtype=np.float64)
    found = f"'{cells[bad]}'" if cells[bad] else "an empty cell"
    do = "write numbers with '.', not ','" if "," in found else "correct it or remove the row"
    if name == "time_s":
        do += "; if times are unknown leave the whole column empty"
    raise InputError(f"{where.cell(bad, name)}: found {found}, expected a finite number; {do}")
