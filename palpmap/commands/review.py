"""`palpmap review`: look at the recording of a run, or list its content."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from models import InputError
from palpmap.console import Output, complain, to_type
from palpmap.recording.integrity import examine, readable
from palpmap.recording.viewer import (
    Instant,
    ViewerError,
    has_display,
    open_window,
    render,
    viewer_program,
)

if TYPE_CHECKING:
    from rich.table import Table

    from palpmap.recording.reader import RecordingSummary

RECORDING = "recording.rrd"


def run_review(
    run: Path, png: bool, summary: bool, output: Output, at: Instant | None = None
) -> bool:
    """Open a recording, render it to a picture, or print its content.

    Parameters
    ----------
    run : run folder, or .rrd file
    png : render the layout to recording.png beside the recording
    at : what the picture shows; None is the end of the run
    summary : print what the recording holds
    output : where to speak

    Returns
    -------
    bool
        Whether all went well: with `summary`, whether the recording is whole.

    Raises
    ------
    InputError
        If there is no recording of palpmap, or no such press or time in it.
    """
    recording = find_recording(run)
    integrity = examine(recording)
    if summary:
        return _summarize(recording, output)
    with readable(recording, integrity) as file:
        if png:
            if at is not None:
                _refuse_beyond(recording, at)
            return _render(recording, file, output, at)
        return _open(recording, file, output)


def _refuse_beyond(recording: Path, at: Instant) -> None:
    """Refuse a press or a time that the recording does not have."""
    from palpmap.recording.reader import read_summary

    spans = read_summary(recording).spans
    asked = (("--press", "press", at.press, ""), ("--time", "sim_time", at.time_s, " s"))
    for option, timeline, value, unit in asked:
        if value is None:
            continue
        low, high = spans.get(timeline, (0.0, 0.0))
        if not low <= value <= high:
            raise InputError(
                f"{option}: found {value:g}{unit}, expected {low:g} to {high:g}{unit}, as "
                f"{recording} holds; give one of these"
            )


def find_recording(run: Path) -> Path:
    """Return the recording of a run folder, or the recording itself.

    Raises
    ------
    InputError
        If there is none.
    """
    if run.is_file():
        return run
    if not run.exists():
        raise InputError(f"there is no {run}; give a run folder or a recording (.rrd)")
    recording = run / RECORDING
    if not recording.is_file():
        raise InputError(
            f"there is no {RECORDING} in {run}; give a folder that 'palpmap demo', 'scan', 'fit' "
            "or 'explain' wrote with --out and, in the case of 'explain', to its end"
        )
    return recording


def _open(recording: Path, file: Path, output: Output) -> bool:
    if not has_display():
        output.result(
            {"recording": str(recording), "opened": False},
            f"There is no display here. On a machine with one: "
            f"{shlex.join([viewer_program(), str(recording)])}\n"
            f"Without: {to_type('review', recording, '--png')}, or --summary",
        )
        return True
    output.say(f"showing {recording}; close the window to go on")
    code = open_window(file)
    if code != 0:
        complain(
            f"the viewer ended with exit code {code}; try palpmap review {recording} --png, or "
            "--summary"
        )
    return code == 0


def _render(recording: Path, file: Path, output: Output, at: Instant | None) -> bool:
    picture = recording.with_suffix(".png")
    try:
        render(file, picture, at)
    except ViewerError as error:
        complain(str(error))
        return False
    except PermissionError as error:
        raise InputError(f"{picture} cannot be written; make its folder writable") from error
    output.result({"picture": str(picture)}, f"picture: {picture}")
    return True


def _summarize(recording: Path, output: Output) -> bool:
    from palpmap.recording.reader import read_summary

    found = read_summary(recording)
    output.result(found.record(), *_tables(found))
    if not found.closed:
        complain(f"{recording} was {found.ending()}")
    elif found.missing:
        complain(f"{recording} lacks: {', '.join(found.missing)}")
    return found.whole


def _tables(found: "RecordingSummary") -> list["Table | str"]:
    """Describe the content of a recording: facts, then spans, values and entities."""
    from rich.table import Column, Table

    seed = "" if found.seed is None else f", seed {found.seed}"
    facts = "\n".join(
        [
            f"{found.name}{seed} (palpmap {found.palpmap}), "
            f"{found.bytes / 1e6:.1f} MB: {found.path}",
            f"recording: {found.ending()}",
            f"missing: {', '.join(found.missing) or 'nothing'}"
            + ("" if found.layout else "; no layout is embedded"),
        ]
    )
    spans = Table("timeline", "first", "last", box=None)
    for name, (first, last) in found.spans.items():
        spans.add_row(name, f"{first:g}", f"{last:g}")
    values = Table("last value of", "", box=None)
    for name, value in found.last_values.items():
        values.add_row(name, f"{value:.6g}")
    entities = Table(Column("entity", overflow="fold"), "rows", "components", box=None)
    for name, entity in found.entities.items():
        rows = f"{entity.rows}" + " + static" * entity.static
        entities.add_row(
            name, rows, ", ".join(sorted({c.split(":")[0] for c in entity.components}))
        )
    return [facts, spans, values, entities]
