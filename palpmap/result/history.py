"""study.history.json: the versions of a study, each with the step of its model."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import Field

from palpmap.record import FileRecord
from palpmap.result.records import ParameterRecord, StepRecord
from palpmap.study.versions import history_file


class VersionRecord(StepRecord):
    """A version of a study."""

    study: str = Field(description="name of its file")
    added: str | None = Field(description="effect that it adds, null for the first version")
    origin: str | None = Field(
        default=None,
        validation_alias="from",
        serialization_alias="from",
        description="file of the version before it",
    )
    parameters: Mapping[str, ParameterRecord] = Field(description="estimates by parameter")


class HistoryRecord(FileRecord):
    """study.history.json of `palpmap add`."""

    versions: tuple[VersionRecord, ...] = Field(description="oldest first")


def read_history(study: Path) -> tuple[VersionRecord, ...]:
    """Return the versions of a study, oldest first; empty where none were added."""
    file = history_file(study)
    return HistoryRecord.read(file).versions if file.is_file() else ()


def write_history(study: Path, versions: Sequence[VersionRecord]) -> None:
    """Write the versions of a study."""
    HistoryRecord(versions=tuple(versions)).write(history_file(study))
