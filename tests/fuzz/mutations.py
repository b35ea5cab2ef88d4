"""Mutations of a study and its scan, of the kinds that users, exports and accidents make."""

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.paths import TWELVE

CELLS = (
    "", " ", "nan", "inf", "-inf", "1e308", "-1e308", "1e-300", "0", "-1", "1e9", "9" * 400,
    "0x10", "1,5", "1;5", "true", "None", "=1+1", "'", '"', "\x00", "é", "１２", "1e5e5", "--1",
    "2024-01-01", "load", "LOAD", "a" * 5000, "1_000", "9223372036854775808",
)  # fmt: skip
VALUES = (
    "0", "-1", "1e308", "1e300", "1e-300", "1e-110", "nan", "inf", "-inf", "9" * 400, "true", '""',
    '"x"', "[]", "[1]", "[1, 2, 3]", "[0.9, 0.9, 0.0001]", "[0.3, 0.3, 0.002]", "{}", "{a = 1}",
    "1979-05-27", '"../../etc"', f'"{"a" * 300}"', "10000000", "0.5", "0.4999", '"auto"',
    '"surface"', '"sphere"', '"base-sliding"', '"base-elastic"', "[" * 2000 + "]" * 2000,
    '"a\\u0000b"', "[nan, 1, 1]", "[1e-200, 1, 1]", "1e12", "-1e12",
)  # fmt: skip
APPENDED = (
    "[[effects]]\nname = 'creep'", "[[effects]]\nname = 'viscoelasticity'",
    "[[effects]]\nname = 'own'\nfile = 'none.py'", "[[effects]]\nname = 'own'\nfile = 'study.toml'",
    "[[effects]]\nname = 'skin_layer'\ninitial = {a = 1e400}", "effects = 3",
    "[body]", "[x]\ny = 1",
    "[map.fixed]\nbackground_pa = 1", "\ufeff", "\x00", "[[study]]",
    "[[effects]]\nname = 'contact_offset'\ninitial = {offset_m = 1e300}",
    "[[effects]]\nname = 'own'\nfile = 'scan.csv'",
)  # fmt: skip


def mutate(folder: Path, rng: np.random.Generator) -> Path:
    """Write a study with one to three mutations into a folder; return the study file."""
    text = (TWELVE / "study.toml").read_text(encoding="utf-8")
    rows = list(csv.reader(io.StringIO((TWELVE / "scan.csv").read_text(encoding="utf-8"))))
    data: bytes | None = None
    for _ in range(rng.integers(1, 4)):
        kind = rng.integers(9)
        if kind < 2:
            text = _study(text, rng)
        elif kind < 7:
            rows = _table(rows, rng)
        elif kind == 7:
            data = _bytes(_csv(rows), rng)
        else:
            text, data = text.replace("scan.csv", "scan.parquet"), _parquet(rows, rng)
    name = "scan.parquet" if "scan.parquet" in text else "scan.csv"
    (folder / name).write_bytes(_csv(rows) if data is None else data)
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


def _csv(rows: list[list[str]]) -> bytes:
    file = io.StringIO()
    csv.writer(file).writerows(rows)
    return file.getvalue().encode("utf-8", "replace")


def _study(text: str, rng: np.random.Generator) -> str:
    lines = text.splitlines()
    keys = [i for i, line in enumerate(lines) if " = " in line]
    if not keys:
        return text
    at = int(rng.choice(keys))
    what = rng.integers(5)
    if what < 3:
        lines[at] = f"{lines[at].split(' = ')[0]} = {rng.choice(VALUES)}"
    elif what == 3:
        del lines[at]
    else:
        lines.append(str(rng.choice(APPENDED)))
    return "\n".join(lines)


def _table(rows: list[list[str]], rng: np.random.Generator) -> list[list[str]]:
    if len(rows) < 3:
        return rows
    rows = [list(row) for row in rows]
    column, row = int(rng.integers(len(rows[0]))), int(rng.integers(1, len(rows)))
    what = rng.integers(8)
    body = [r for r in rows[1:] if column < len(r)]
    if what == 0 and column < len(rows[row]):
        rows[row][column] = str(rng.choice(CELLS))
    elif what == 1:
        cell = str(rng.choice(CELLS))
        for r in body:
            r[column] = cell
    elif what == 2:
        factor = rng.choice([-1, 0, 1e3, 1e-3, 1e9, 1e300, 1e-300, 0.1])
        for r in body:
            r[column] = _scaled(r[column], factor)
    elif what == 3:
        rows = [[cell for i, cell in enumerate(r) if i != column] for r in rows]
    elif what == 4:
        rows[0][column] = str(rng.choice([*CELLS, "force", "time", "press", "x_mm"]))
    elif what == 5:
        rows = rows[: int(rng.integers(0, len(rows)))]
    elif what == 6:
        rows[1:] = [rows[1:][i] for i in rng.permutation(len(rows) - 1)]
    else:
        a, b = sorted(rng.integers(1, len(rows), 2).tolist())
        rows = rows[:a] + rows[b:] if rng.integers(2) else rows[:b] + rows[a:b] + rows[b:]
    return rows


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * float(factor))
    except ValueError:
        return cell


def _bytes(data: bytes, rng: np.random.Generator) -> bytes:
    if not data:
        return data
    what, at = rng.integers(4), int(rng.integers(len(data)))
    if what == 0:
        return data[:at]
    if what == 1:
        return data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]
    if what == 2:
        return data.decode("utf-8").encode("utf-16")
    return data.replace(b",", rng.choice([b";", b"\t", b", ", b"|"]))


def _parquet(rows: list[list[str]], rng: np.random.Generator) -> bytes:
    width = len(rows[0]) if rows else 0
    body = [row for row in rows[1:] if len(row) == width]
    kinds = (pa.string(), pa.float64(), pa.int64(), pa.uint64(), pa.float32(), pa.bool_())
    columns, names = [], []
    for i in range(width):
        cells = [row[i] for row in body]
        column = pa.array(cells)
        try:
            kind = pa.float64() if rows[0][i] != "phase" else pa.string()
            if rng.random() < 0.1:
                kind = kinds[rng.integers(len(kinds))]
            column = column.cast(kind)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            pass
        if rows[0][i] == "press" and rng.random() < 0.3:
            column = pa.array(np.full(len(cells), 2**63, dtype=np.uint64))
        columns.append(column)
        names.append(rows[0][i])
    table = pa.Table.from_arrays(columns, names=names)
    said = [b"1", b"2", b"foreign", b"\xff", b"-1", b"9" * 40][rng.integers(6)]
    file = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({b"palpmap.scan_schema": said}), file)
    data = file.getvalue()
    return data[: int(rng.integers(len(data)))] if rng.random() < 0.2 else data
