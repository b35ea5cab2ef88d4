"""`palpmap import`: its output."""

import sys
from collections.abc import Sequence
from pathlib import Path

from palpmap.console import Output, to_type
from palpmap.importing.importing import import_recording
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.propose import propose_rig
from palpmap.importing.readers.read import read_recording
from palpmap.progress import read_stages


def run_propose(files: Sequence[Path], output: Output) -> None:
    """Print a mapping for a recording, quiet or not: it is the result."""
    text = _proposed(files, output)
    if output.json:
        output.result({"schema": 1, "rig": text})
    else:
        sys.stdout.write(text)


def _proposed(files: Sequence[Path], output: Output) -> str:
    with output.task(read_stages(len(files))) as task:
        recording = read_recording(files, task.say)
        task.say("proposing a mapping")
        return propose_rig(recording)


def run_import(
    *, files: Sequence[Path], rig: Path | None, out: Path, form: str, output: Output
) -> None:
    """Write scan, study and page; without a mapping the proposed one is tried.

    Raises
    ------
    InputError
        See `palpmap.importing.importing.import_recording`.
    """
    mapping = rig or parse_rig(_proposed(files, output), Path("proposed mapping"))
    with output.task(read_stages(len(files))) as task:
        made = import_recording(files, mapping, progress=task.say)
    study = made.write(out, form)
    scan = made.scan
    output.result(
        {
            "schema": 1,
            "study": str(study),
            "scan": str(out / f"scan.{form}"),
            "page": str(out / "import.md"),
            "presses": len(scan.press_ids),
            "rows": len(scan),
            "left_out": [
                {"time_s": time, "reason": reason}
                for time, reason in (made.cut.left_out if made.cut else ())
            ],
            "found": list(made.said),
        },
        *(f"- {sentence}" for sentence in made.said),
        f"{len(scan.press_ids)} presses, {len(scan)} rows in {study}.",
        f"Next: {to_type('check', study)}",
    )
