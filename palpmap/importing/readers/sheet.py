"""Excel workbooks: one table a sheet."""

from __future__ import annotations

import io
import zipfile
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from models import InputError
from palpmap.importing.readers.recording import Table, alike
from palpmap.importing.readers.text import as_column, header_units, is_units_row, once_each

LARGEST_BYTES = 2_000_000_000


def read_sheets(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read all sheets that hold a table: a header, perhaps a row of units, and rows of cells.

    Formulas are not worked out: the values that the workbook was saved with are read.
    """
    import openpyxl

    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_BYTES:
        raise InputError(f"{path}: unpacks to {size / 1e9:.1f} GB, expected at most 2 GB")
    book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
    tables, notes = [], []
    for sheet in book.worksheets:
        rows = [
            (number, list(cells))
            for number, cells in enumerate(sheet.iter_rows(values_only=True), start=1)
            if any(cell is not None for cell in cells)
        ]
        table = _table(path, sheet.title, rows)
        if table is None:
            notes.append(f"{path.name}: the sheet '{sheet.title}' holds no table and was left out.")
        else:
            tables.append(table)
    return tables, notes


def _table(path: Path, sheet: str, rows: list[tuple[int, list[Any]]]) -> Table | None:
    first = next((i for i, (_, cells) in enumerate(rows) if _numbers(cells)), None)
    if not first:
        return None
    above = [["" if cell is None else str(cell) for cell in cells] for _, cells in rows[:first]]
    below = above.pop() if len(above) > 1 and is_units_row(above[-1]) else None
    header = above[-1]
    used = [i for i, name in enumerate(header) if name.strip()]
    names, units = header_units(header, below)
    names = once_each([names[i] for i in used])
    body = rows[first:]
    columns = {
        name: _column([cells[i] if i < len(cells) else None for _, cells in body])
        for name, i in zip(names, used, strict=True)
    }
    numbers = [number for number, _ in body]
    return Table(
        sheet,
        columns,
        {name: units[i] for name, i in zip(names, used, strict=True) if units[i]},
        lambda row: f"{path}, sheet {sheet}, row {numbers[row]}",
        stacks_by=alike(sheet),
    )


def _numbers(cells: list[Any]) -> int:
    return sum(isinstance(cell, (int, float)) and not isinstance(cell, bool) for cell in cells)


def _column(cells: list[Any]) -> np.ndarray:
    if all(cell is None or isinstance(cell, (int, float)) for cell in cells):
        return np.array([np.nan if cell is None else float(cell) for cell in cells])
    texts = [
        "" if cell is None
        else cell.isoformat() if isinstance(cell, (date, datetime))
        else str(cell).replace(",", ".") if _is_decimal_comma(cell)
        else str(cell)
        for cell in cells
    ]  # fmt: skip
    return as_column(texts, comma=False)


def _is_decimal_comma(cell: Any) -> bool:
    return isinstance(cell, str) and cell.replace(",", "", 1).lstrip("+-").isdigit()
