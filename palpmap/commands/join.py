"""`palpmap join`: one scan of several on the same body."""

from collections.abc import Sequence
from pathlib import Path

from models import InputError, join_scans, read_scan, write_scan
from palpmap.console import Output
from palpmap.run_folder import sha256


def run_join(*, scans: Sequence[Path], out: Path, pause_s: float | None, output: Output) -> None:
    """Write one scan from several files; see `models.scan_join.join_scans`.

    Raises
    ------
    InputError
        Fewer than two scans, one of them twice, scans that do not go together, or an output file
        that is there.
    """
    if len(scans) < 2:
        raise InputError(f"found {len(scans)} scan, expected two or more to join")
    _refuse_twice(scans)
    if out.exists():
        raise InputError(f"{out}: is already there and is not overwritten; choose another --out")
    # What looks like another unit is asked about where the joined scan is read with its study
    tables = [read_scan(path, units_checked=True) for path in scans]
    joined, left_out = join_scans(tables, list(map(str, scans)), pause_s)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_scan(joined, out)
    presses = len(joined.press_ids)
    output.result(
        {"schema": 1, "scan": str(out), "presses": presses, "rows": len(joined),
         "left_out": list(left_out)},
        f"{presses} presses, {len(joined)} rows in {out}; name it as scan in the study.",
    )  # fmt: skip
    for columns in left_out:
        output.say(f"Left out, as not every scan has them: {columns}.")


def _refuse_twice(scans: Sequence[Path]) -> None:
    first: dict[str, Path] = {}
    for path in filter(Path.is_file, scans):
        digest = sha256(path)
        if digest in first:
            raise InputError(
                f"{path}: holds the same readings as {first[digest]}, expected another scan; the "
                "same noise twice would make the map look surer than it is: name each scan once"
            )
        first[digest] = path
