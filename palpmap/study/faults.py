"""Faults of TOML files, each in one sentence."""

import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from models import InputError, nearest, shortened

T = TypeVar("T", bound=BaseModel)


def read_table(path: Path, kind: type[T], what: str) -> T:
    """Read a TOML file as a table.

    Parameters
    ----------
    what : name of such a file, for messages

    Raises
    ------
    InputError
        Naming file and key, what was found and what is expected.
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {found}, expected a {what} (.toml); check the path")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from error
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        raise InputError(fault_sentence(path, error, kind)) from error


@contextmanager
def naming_study(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Name the study's file in sentences of code that knows its content alone."""
    try:
        yield
    except InputError as error:
        if path is None or not str(error).startswith("study, "):
            raise
        raise InputError(f"{path}{str(error).removeprefix('study')}") from error


_EXPECTED = {
    "float_type": "a number without quotes",
    "int_type": "a whole number without quotes",
    "bool_type": "true or false, without quotes",
    "string_type": "text in quotes",
    "tuple_type": "a list in square brackets",
    "dict_type": "a table",
    "model_type": "a table",
    "finite_number": "a finite number",
    "string_too_short": "text that is not empty",
    "float_parsing": "a number, such as 0.49",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_parsing": "true or false",
    "list_type": "a list in square brackets",
    "mapping_type": "a table",
    "path_type": "the name of a file",
    "missing": "this key",
    "too_long": "fewer values",
    "too_short": "more values",
}
"""Pydantic's kinds of faults in the words of a person who writes TOML."""


def expected_by(fault: Mapping[str, Any]) -> str:
    """Return the expectation behind one of pydantic's faults, in plain words.

    >>> expected_by({"type": "float_parsing", "msg": "Input should be a valid number, unable to"})
    'a number, such as 0.49'
    >>> expected_by({"type": "value_error", "msg": "'stl' is not one of 'vtu', 'csv'."})
    "one of 'vtu', 'csv'."
    """
    said = _EXPECTED.get(fault["type"]) or fault["msg"].removeprefix("Value error, ")
    _, choice, these = said.partition(" is not one of ")  # of a command's option
    return f"one of {these}" if choice else said.removeprefix("Input should be ")


def fault_sentence(path: Path, error: ValidationError, root: type[BaseModel]) -> str:
    """Turn the first fault of a TOML file into a sentence; the number of further ones is said."""
    key, what, others = _first_fault(error, root)
    more = f" ({others} more fault{'s' * (others > 1)} in this file)" if others else ""
    return f"{path}, key {key}: {what}{more}"


def argument_sentence(error: ValidationError, root: type[BaseModel]) -> str:
    """Turn the first fault of a table that was made in Python into a sentence."""
    key, what, _ = _first_fault(error, root, in_python=True)
    return f"{key or root.__name__}: {what}"


def _first_fault(
    error: ValidationError, root: type[BaseModel], in_python: bool = False
) -> tuple[str, str, int]:
    """Return the key of a table's first fault, what is wrong, and the number of others."""
    # A misspelt key is a missing one too: the misspelling explains more.
    faults = sorted(error.errors(include_url=False), key=lambda f: f["type"] != "extra_forbidden")
    fault = faults[0]
    place = fault["loc"] or ("",)
    key = ".".join(str(part) for part in place if part not in ("int", "float"))
    fields = _fields_of_table(place[:-1], root)
    last = str(place[-1])
    found = fault["input"]
    asked = in_python and fault.get("ctx", {}).get("class_name")  # where a file has a table
    expected = f"a {asked}" if asked else expected_by(fault)
    if place[0] == "effects" and fault["type"] in ("tuple_type", "model_type"):
        expected = 'a table for each effect: write [[effects]], and name = "..." below it'
    if fault["type"] == "extra_forbidden":
        what = f"unknown key{nearest(last, tuple(fields))}; expected {', '.join(fields)}"
    elif fault["type"] == "missing":
        what = f"the key is missing; add {fields[last].description}"
    elif isinstance(found, dict) or last == "effects":
        what = f"expected {expected}"
    else:
        what = f"found {shortened(found)}, expected {expected}"
        if fault["type"] == "literal_error":
            what += nearest(str(found), tuple(re.findall("'([^']+)'", expected)))
    return key, what, len(faults) - 1


def _fields_of_table(
    location: tuple[int | str, ...], root: type[BaseModel]
) -> dict[str, FieldInfo]:
    table = root
    for part in location:
        if field := table.model_fields.get(str(part)):
            kinds = [field.annotation, *get_args(field.annotation)]
            table = next(
                (k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), table
            )
    return {field.alias or name: field for name, field in table.model_fields.items()}
