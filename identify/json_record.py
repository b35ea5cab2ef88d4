"""Records with a schema number in JSON files, read with an error message for any other file."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from models import InputError

T = TypeVar("T")


def read_json_record(
    path: str | Path, what: str, made_by: str, schema: int, build: Callable[[dict], T]
) -> T:
    """Read a record.

    Parameters
    ----------
    path : the file
    what, made_by : name of the record and the command that writes it, for messages
    schema : newest schema that is understood
    build : makes the record of the JSON object without its schema number; KeyError, TypeError or
        ValueError where it is incomplete

    Raises
    ------
    InputError
        The file is missing, is no such record, or was written by a newer version.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(
            f"{path}: not a readable {what} ({error}); `{made_by}` writes it"
        ) from error
    found = content.pop("schema", None) if isinstance(content, dict) else None
    if not isinstance(found, int):
        raise InputError(f"{path}: no 'schema' number found, expected a {what} of palpmap")
    if found > schema:
        raise InputError(
            f"{path}: written with schema {found}, this palpmap reads up to {schema}; "
            "update palpmap"
        )
    try:
        return build(content)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: damaged {what}, cannot use {error}; `{made_by}` writes it anew"
        ) from error
