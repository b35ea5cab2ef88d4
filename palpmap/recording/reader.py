"""Content of a recording, read back without a viewer."""

import warnings
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from models import InputError
from palpmap.recording import entities as parts
from palpmap.recording.integrity import Integrity, examine, readable

_TIMELINES = (parts.SIM_TIME, parts.PRESS, parts.ITERATION)
_SCALAR = "Scalars:scalars"


@dataclass(frozen=True)
class EntitySummary:
    """One entity: rows on the timelines, static data or not, names of its components."""

    rows: int
    static: bool
    components: tuple[str, ...]

    @property
    def has_content(self) -> bool:
        """True if there is more than the style of a curve yet to come."""
        return self.rows > 0 or any(not name.startswith("Series") for name in self.components)


@dataclass(frozen=True)
class RecordingSummary:
    """Content of a recording.

    Attributes
    ----------
    path, bytes : file and its size
    name, palpmap, seed : of the run
    closed : ended by its writer; if not, the run was stopped or the file is cut off
    layout : a layout (blueprint) is embedded
    planned_presses, presses, last_press : presses planned and recorded; id of the last, or None
    spans : timeline -> first and last time (s on `sim_time`)
    entities : path -> rows and components
    last_values : entity of a scalar -> its last value, in the unit that its name says
    missing : parts that the run should have and the recording does not
    """

    path: str
    bytes: int
    name: str
    palpmap: str
    seed: int | None
    closed: bool
    layout: bool
    planned_presses: int
    presses: int
    last_press: int | None
    spans: dict[str, tuple[float, float]]
    entities: dict[str, EntitySummary]
    last_values: dict[str, float]
    missing: tuple[str, ...]

    @property
    def whole(self) -> bool:
        """True if the recording was closed and misses nothing."""
        return self.closed and not self.missing and self.layout

    def ending(self) -> str:
        """Say how the recording ends."""
        made = f"{self.presses} of {self.planned_presses} presses"
        if self.closed:
            return f"closed, {made}"
        last = (
            "before the first press"
            if self.last_press is None
            else f"after press {self.last_press}"
        )
        return f"not closed (the run was stopped, or the file is cut off): ends {last}, {made}"

    def record(self) -> dict[str, object]:
        """Return everything as JSON-ready data."""
        return asdict(self) | {"schema": 1, "whole": self.whole, "ending": self.ending()}


def read_summary(path: str | Path) -> RecordingSummary:
    """Read a recording of palpmap, also one of a run that was stopped.

    Raises
    ------
    InputError
        If the file is missing, empty, foreign, damaged, or cut off before the first whole message.
    """
    path = Path(path)
    integrity = examine(path)
    with readable(path, integrity) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # on a missing footer; we say it ourselves
        try:
            reader = RrdReader(file)
            applications = {entry.application_id for entry in reader.recordings()}
            chunks = list(reader.stream())
            layout = bool(reader.blueprints())
        except (RuntimeError, ValueError) as error:
            raise InputError(
                f"{path} is damaged and cannot be read ({error}); copy it again, or record the run "
                "again"
            ) from error
    if parts.APPLICATION not in applications:
        raise InputError(
            f"{path} is a recording of {', '.join(sorted(applications)) or 'nothing'}, not of "
            "palpmap; give a run folder or the recording.rrd in it"
        )
    return _summary(path, integrity, layout, chunks)


def scalar_series(chunks: Iterable[Chunk], entity: str, timeline: str) -> np.ndarray:
    """Return (r, 2) times and values of a scalar on a timeline, in order (s on `sim_time`)."""
    rows = []
    for chunk in chunks:
        if chunk.entity_path == f"/{entity}" and timeline in chunk.timeline_names:
            batch = chunk.to_record_batch()
            if _SCALAR in batch.schema.names:
                values = np.array([row[0] for row in batch.column(_SCALAR).to_pylist()])
                rows.append(np.column_stack([_times(batch, timeline), values]))
    table = np.concatenate(rows) if rows else np.empty((0, 2))
    return table[np.argsort(table[:, 0], kind="stable")]


def _summary(
    path: Path, integrity: Integrity, layout: bool, chunks: list[Chunk]
) -> RecordingSummary:
    run = _run_facts(chunks)
    entities, spans = _entities_and_spans(chunks)
    presses = scalar_series(chunks, parts.MEASURED, parts.PRESS)[:, 0].astype(int)
    scalars = [entity for entity, found in entities.items() if _SCALAR in found.components]
    there = [entity for entity, found in entities.items() if found.has_content]
    missing = tuple(
        part
        for part in run.get("parts", list(parts.PARTS))
        if not all(any(_within(e, wanted) for e in there) for wanted in parts.PARTS[part])
    )
    return RecordingSummary(
        path=str(path),
        bytes=integrity.total_bytes,
        name=run.get("name", [""])[0],
        palpmap=run.get("palpmap", [""])[0],
        seed=run.get("seed", [None])[0],
        closed=integrity.closed,
        layout=layout,
        planned_presses=run.get("planned_presses", [0])[0],
        presses=len(presses),
        last_press=int(presses[-1]) if len(presses) else None,
        spans=spans,
        entities=entities,
        last_values={entity: _last_value(chunks, entity) for entity in scalars},
        missing=missing,
    )


def _run_facts(chunks: list[Chunk]) -> dict[str, list[Any]]:
    for chunk in chunks:
        if chunk.entity_path == f"/{parts.RUN}":
            batch = chunk.to_record_batch()
            return {name: batch.column(name)[0].as_py() for name in batch.schema.names}
    return {}


def _entities_and_spans(
    chunks: list[Chunk],
) -> tuple[dict[str, EntitySummary], dict[str, tuple[float, float]]]:
    rows: dict[str, int] = defaultdict(int)
    static: dict[str, bool] = defaultdict(bool)
    components: dict[str, set[str]] = defaultdict(set)
    spans: dict[str, tuple[float, float]] = {}
    for chunk in chunks:
        entity = chunk.entity_path.lstrip("/")
        if entity.startswith("__"):
            continue
        batch = chunk.to_record_batch()
        rows[entity] += 0 if chunk.is_static else chunk.num_rows
        static[entity] |= chunk.is_static
        components[entity] |= set(batch.schema.names) - {"rerun.controls.RowId", *_TIMELINES}
        for timeline in chunk.timeline_names:
            times = _times(batch, timeline)
            first, last = spans.get(timeline, (np.inf, -np.inf))
            spans[timeline] = min(first, float(times.min())), max(last, float(times.max()))
    entities = {
        entity: EntitySummary(rows[entity], static[entity], tuple(sorted(components[entity])))
        for entity in sorted(components)
    }
    return entities, {name: spans[name] for name in _TIMELINES if name in spans}


def _times(batch: pa.RecordBatch, timeline: str) -> np.ndarray:
    """Return the times of all rows: s on `sim_time`, numbers on the other timelines."""
    times = batch.column(timeline).cast(pa.int64()).to_numpy()
    return times * 1e-9 if timeline == parts.SIM_TIME else times.astype(float)


def _last_value(chunks: list[Chunk], entity: str) -> float:
    """Value at the end of the first timeline that the scalar is on."""
    series = (scalar_series(chunks, entity, timeline) for timeline in _TIMELINES)
    return next(float(table[-1, 1]) for table in series if len(table))


def _within(entity: str, folder: str) -> bool:
    return entity == folder or entity.startswith(f"{folder}/")
