"""Files of named arrays: MATLAB (v4 to v7.2 and v7.3), HDF5, NumPy and Parquet.

Arrays of one group and of equal length become a table; an array of k columns becomes `name[0]` to
`name[k-1]`. The longer axis counts the readings, whichever way the file lays it.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from models import InputError
from palpmap.importing.readers.recording import Table, alike
from palpmap.importing.readers.units import name_and_unit, spelled

MOST_COLUMNS = 64
_NUMBERED = re.compile(r"\[\d+\]$")
HDF5 = b"\x89HDF\r\n\x1a\n"

Leaf = tuple[str, str, Any, str]
"""Group, name, array, unit."""


def read_numpy(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read .npy or .npz; arrays of Python objects are refused, as reading them would run code."""
    loaded = np.load(io.BytesIO(data), allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return _tables(path, [("", path.stem, loaded, "")])
    return _tables(path, [("", name, loaded[name], "") for name in loaded.files])


def read_matlab(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read a .mat file of any version; structs are groups, struct arrays parts."""
    if data[512 : 512 + len(HDF5)] == HDF5 or data.startswith(HDF5):
        return read_hdf5(path, data)
    from scipy.io import loadmat

    found = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=True)
    leaves = [leaf for name, value in found.items() if not name.startswith("__")
              for leaf in _struct_leaves("", name, value)]  # fmt: skip
    return _tables(path, leaves)


def read_hdf5(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read all datasets of an HDF5 file; an attribute `unit` or `units` states a unit."""
    import h5py

    with h5py.File(io.BytesIO(data), "r") as file:
        leaves = list(_hdf5_leaves(file, file, ""))
    return _tables(path, leaves)


def read_parquet(path: Path, data: bytes) -> tuple[list[Table], list[str]]:
    """Read the columns of a Parquet file; empty cells of numbers are NaN, dates count from 1970."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(pa.BufferReader(data))
    leaves = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        unit = ""
        if pa.types.is_timestamp(column.type):
            column, unit = column.cast(pa.timestamp("ns")).cast(pa.int64()), "ns"
        if pa.types.is_dictionary(column.type) or pa.types.is_large_string(column.type):
            column = column.cast(pa.string())
        if pa.types.is_string(column.type):
            leaves.append(("", name, np.array([text or "" for text in column.to_pylist()]), ""))
        else:
            leaves.append(("", name, column.to_numpy(), unit))
    return _tables(path, leaves)


def _struct_leaves(group: str, name: str, value: Any) -> Iterator[Leaf]:
    array = np.asarray(value)
    inner = f"{group}.{name}".lstrip(".")
    if array.dtype.names and array.dtype.kind == "V":
        for number, element in enumerate(array.reshape(-1)):
            where = inner if array.size == 1 else f"{inner}({number + 1})"
            for field in array.dtype.names:
                yield from _struct_leaves(where, field, element[field])
    elif array.dtype.kind == "O":
        if array.size and all(isinstance(cell, str) for cell in array.reshape(-1)):
            yield group, name, array.astype(str), ""
    else:
        yield group, name, array, ""


def _hdf5_leaves(file: Any, group: Any, name: str) -> Iterator[Leaf]:
    import h5py

    for key in group:
        entry = group.get(key)
        if key.startswith("#"):  # MATLAB's own store of what references point to
            continue
        if isinstance(entry, h5py.Group):
            yield from _hdf5_leaves(file, entry, f"{name}/{key}".lstrip("/"))
        elif isinstance(entry, h5py.Dataset):
            yield from _dataset_leaves(file, entry, name, key)


def _dataset_leaves(file: Any, entry: Any, group: str, key: str) -> Iterator[Leaf]:
    import h5py

    stated = entry.attrs.get("unit", entry.attrs.get("units", ""))
    unit = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)
    if entry.dtype.names:
        array = entry[()]
        for field in entry.dtype.names:
            yield f"{group}/{key}".lstrip("/"), field, array[field], ""
    elif h5py.check_ref_dtype(entry.dtype) is not None:
        targets = [file[ref] for ref in np.ravel(entry[()]) if ref]
        if all(_is_characters(target) for target in targets):
            yield group, key, np.array([_characters(target) for target in targets]), ""
        else:  # a MATLAB struct array: one dataset a field, which points to one array an element
            for number, target in enumerate(targets):
                if isinstance(target, h5py.Dataset) and not entry.name.startswith("/#"):
                    yield f"{group}({number + 1})", key, target[()], unit
    elif h5py.check_string_dtype(entry.dtype) is not None:
        yield group, key, np.asarray(entry.asstr()[()]).astype(str), unit
    elif _is_characters(entry):
        yield group, key, np.array(_characters(entry)), ""
    elif entry.shape is not None:
        yield group, key, entry[()], unit


def _is_characters(entry: Any) -> bool:
    return getattr(entry, "attrs", {}).get("MATLAB_class") == b"char"


def _characters(entry: Any) -> str:
    codes = np.asarray(entry[()])
    return "" if codes.dtype.kind not in "ui" else "".join(map(chr, codes.T.reshape(-1)))


def _tables(path: Path, leaves: list[Leaf]) -> tuple[list[Table], list[str]]:
    groups: dict[tuple[str, int], tuple[dict[str, np.ndarray], dict[str, str]]] = {}
    left_out = []
    for group, name, value, unit in leaves:
        columns = dict(_columns(name, value))
        if not columns:
            left_out.append(f"{group}.{name}".lstrip("."))
        for column, values in columns.items():
            arrays, units = groups.setdefault((group, len(values)), ({}, {}))
            arrays[column] = values
            if known := spelled(unit) or name_and_unit(_NUMBERED.sub("", column))[1]:
                units[column] = known
    if not groups:
        raise InputError(f"{path}: found no array of readings, expected named arrays of numbers")
    tables = [
        Table(
            group or path.stem,
            arrays,
            units,
            lambda row, group=group: f"{path}{f', {group}' if group else ''}, row {row + 1}",
            stacks_by=alike(group) or "file",
        )
        for (group, _), (arrays, units) in groups.items()
    ]
    some = ", ".join(left_out[:5]) + (", ..." if len(left_out) > 5 else "")
    return tables, [f"{path.name}: left out, no columns of readings: {some}."] if left_out else []


def _columns(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    array = np.squeeze(np.asarray(value))
    if array.dtype.names:
        for field in array.dtype.names:
            yield from _columns(field, array[field])
        return
    if array.ndim not in (1, 2) or array.shape[0] < 2 or array.dtype.kind not in "biufSU":
        return
    if array.dtype.kind == "S":
        array = np.char.decode(array, "utf-8", "replace")
    array = array if array.dtype.kind == "U" else array.astype(float)
    if array.ndim == 1:
        yield name, array
        return
    array = array.T if array.shape[0] < array.shape[1] else array
    if array.shape[1] <= MOST_COLUMNS:
        for i, column in enumerate(array.T):
            yield f"{name}[{i}]", np.ascontiguousarray(column)
