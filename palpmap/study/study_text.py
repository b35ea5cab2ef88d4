"""Read the tables of a study file; text that is none is refused in a sentence."""

import tomllib
from pathlib import Path
from typing import Any

from models import InputError


def study_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a study file, unchecked.

    Raises
    ------
    InputError
        For a path that is no file, a scan, or text that is not TOML, with its line.
    """
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "no such file"
        inside = path / "study.toml"
        cure = f"give {inside}" if inside.is_file() else "check the path"
        raise InputError(f"{path}: {kind}, expected a study file (.toml); {cure}")
    if path.suffix.lower() in (".csv", ".parquet"):
        raise InputError(
            f"{path}: found a scan, expected a study file (.toml); `palpmap new {path} --out "
            "FOLDER` makes one"
        )
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n"))
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: found the byte 0x{error.object[error.start]:02x} at position {error.start}, "
            "expected UTF-8 text; save the file as UTF-8"
        ) from error
    except ValueError as error:  # TOMLDecodeError, or a number of too many digits
        raise InputError(f"{path}: found text that is not TOML: {error}; correct it") from error
    except RecursionError as error:
        raise InputError(
            f"{path}: found brackets nested too deep to read, expected the tables of a study; "
            "correct it"
        ) from error
