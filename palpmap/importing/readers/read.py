"""Files of a rig, of whatever form, as one recording."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from identify import Progress, silent
from models import InputError
from palpmap.importing.readers.arrays import read_hdf5, read_matlab, read_numpy, read_parquet
from palpmap.importing.readers.bag import read_bag
from palpmap.importing.readers.recording import Recording, Table
from palpmap.importing.readers.sheet import read_sheets
from palpmap.importing.readers.text import read_text

READERS: dict[str, tuple[str, Callable[[Path, bytes], tuple[list[Table], list[str]]]]] = {
    ".xlsx": ("an Excel workbook", read_sheets),
    ".xlsm": ("an Excel workbook", read_sheets),
    ".mat": ("a MATLAB file", read_matlab),
    ".h5": ("an HDF5 file", read_hdf5),
    ".hdf5": ("an HDF5 file", read_hdf5),
    ".npy": ("a NumPy file of plain arrays", read_numpy),
    ".npz": ("a NumPy file of plain arrays", read_numpy),
    ".parquet": ("a Parquet file", read_parquet),
}
BAGS = {".bag": "a ROS 1 bag", ".mcap": "an MCAP file of ROS 2 messages", ".db3": "a ROS 2 bag"}


def read_recording(
    files: Sequence[str | os.PathLike[str]], progress: Progress = silent
) -> Recording:
    """Read files of one recording: text, Excel, MATLAB, HDF5, NumPy, Parquet, MCAP, ROS bags.

    The ending tells the form; what has an unknown ending is read as text. A folder is a ROS 2 bag.

    Raises
    ------
    InputError
        Naming the file, and row or topic where there is one.
    """
    if not files:
        raise InputError("found no file, expected at least one recording")
    tables: list[Table] = []
    notes: list[str] = []
    for path in map(Path, files):
        progress(f"reading {path.name}")
        found, said = _read(path)
        tables += found
        notes += said
    return Recording.of(tables, notes)


def _read(path: Path) -> tuple[list[Table], list[str]]:
    ending = path.suffix.lower()
    is_folder_of_bag = path.is_dir() and (path / "metadata.yaml").is_file()
    if not path.is_file() and not is_folder_of_bag:
        kind = "a folder that is no ROS 2 bag" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {kind}, expected a recording; check the path")
    form, read = READERS.get(ending, ("a table of text", read_text))
    form = BAGS.get(ending, "a ROS 2 bag" if is_folder_of_bag else form)
    try:
        if ending in BAGS or is_folder_of_bag:
            return read_bag(path)
        data = path.read_bytes()
        if not data:
            raise InputError(f"{path}: the file is empty, expected a recording")
        return read(path, data)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(
            f"{path}: reading {form} needs the package '{error.name}', which is not installed; "
            "pip install 'palpmap[import]'"
        ) from error
    except Exception as error:  # a damaged file makes the libraries raise all kinds
        said = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as {form} ({said}); write it again, or name it after what it "
            "is"
        ) from error
