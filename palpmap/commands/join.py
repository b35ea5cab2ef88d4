"""`palpmap join`: one scan of several on the same body."""

from collections.abc import Sequence
from pathlib import Path

from models import InputError, join_scans, read_scan, write_scan
from palpmap.console import Output, to_type
from palpmap.run_folder import sha256
from palpmap.study.study import Study, load_study, write_study


def run_join(
    *, scans: Sequence[Path], out: Path, pause_s: float | None, study: Path | None, output: Output
) -> None:
    """Write one scan from several files; see `models.scan_join.join_scans`.

    Parameters
    ----------
    study : of one of the scans; the same of the joined scan is written beside that, as .toml

    Raises
    ------
    InputError
        Fewer than two scans, one of them twice, scans that do not go together, or an output file
        that is there.
    """
    if len(scans) < 2:
        raise InputError(f"found {len(scans)} scan, expected two or more to join")
    _refuse_twice(scans)
    kept, target = None if study is None else load_study(study), out.with_suffix(".toml")
    for file in (out,) if kept is None else (out, target):
        if file.exists():
            raise InputError(
                f"{file}: is already there and is not overwritten; choose another --out"
            )
    if kept is not None and out == target:
        raise InputError(f"{out}: is to be the study's name; give --out a name that ends in .csv")
    # What looks like another unit is asked about where the joined scan is read with its study
    tables = [read_scan(path, units_checked=True) for path in scans]
    joined, left_out = join_scans(tables, list(map(str, scans)), pause_s)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_scan(joined, out)
    presses = len(joined.press_ids)
    record = {"schema": 1, "scan": str(out), "presses": presses, "rows": len(joined),
              "left_out": list(left_out)}  # fmt: skip
    told = f"{presses} presses, {len(joined)} rows in {out}"
    if kept is None:
        output.result(record, f"{told}; name it as scan in the study.")
    else:
        _write_study(kept, out, target)
        output.result(
            {**record, "study": str(target)},
            f"{told}, its study in {target}.",
            f"Next: {to_type('explain', target)}",
        )
    for columns in left_out:
        output.say(f"Left out, as not every scan has them: {columns}.")


def _write_study(study: Study, scan: Path, target: Path) -> None:
    """Write the study of another scan of its body, whose surface goes through all contacts then."""
    scan, body = scan.resolve(), study.body
    if body.file is not None and body.file == study.scan:
        body = body.model_copy(update={"file": scan})
    about = study.study.model_copy(update={"scan": scan})
    write_study(study.model_copy(update={"study": about, "body": body}), target)


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
