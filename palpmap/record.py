"""Content of palpmap's JSON files: frozen pydantic models, written and read with a schema number.

A file of an older palpmap may lack what has a default; a file with a newer schema is refused.
"""

import json
import os
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from models import InputError, replaced
from palpmap.study.faults import expected_by

SCHEMA = 1


class Record(BaseModel):
    """Plain data of a JSON file, or of a part of one: frozen, every number finite."""

    model_config = ConfigDict(frozen=True, populate_by_name=True, allow_inf_nan=False)

    @classmethod
    def copy_of(cls, source: object, **others: Any) -> Self:
        """Return a record of an object's attributes of the same names; `others` go before."""
        same = {name: getattr(source, name) for name in cls.model_fields if name not in others}
        return cls(**same, **others)

    def to_dict(self) -> dict[str, JsonValue]:
        """Return the content of the JSON file."""
        return self.model_dump(mode="json", by_alias=True)

    def changed(self, **fields: Any) -> Self:
        """Return the record with other values of some fields."""
        return self.model_copy(update=fields)


class FileRecord(Record):
    """A whole JSON file, with the version of its schema."""

    schema_version: int = Field(
        default=SCHEMA, alias="schema", ge=1, le=SCHEMA, description="version of the file's form"
    )

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the record as JSON; the file is replaced in one step."""
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
        with replaced(path) as beside:
            beside.write_text(text + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a record that `write` wrote.

        Raises
        ------
        InputError
            The file is missing, is no JSON, is damaged, or comes from a newer palpmap.
        """
        content = _content(Path(path))
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"]))
            raise InputError(
                f"{path}, key {key}: expected {expected_by(first)}; run the command that writes it "
                "again"
            ) from error


def _content(path: Path) -> dict[str, JsonValue]:
    """Return a file's JSON object, of a schema that this palpmap knows."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}), expected a file of a run folder; "
            "check the path or run the command that writes it"
        ) from error
    except ValueError as error:
        raise InputError(
            f"{path}: found text that is not JSON ({error}), expected a record of palpmap; "
            "run the command that writes it again"
        ) from error
    found = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(found, int):
        raise InputError(
            f"{path}, key schema: found {found!r}, expected a number; this is no record of palpmap"
        )
    if found > SCHEMA:
        raise InputError(
            f"{path}, key schema: found {found}, expected at most {SCHEMA}; update palpmap"
        )
    return content
