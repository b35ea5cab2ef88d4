"""Input files of a command, copied into its run folder, so that the folder stands for itself."""

import shutil
from pathlib import Path

from models import InputError, Scan, write_scan
from palpmap.study.body import Body
from palpmap.study.study import Study, write_study


def refuse_own_folder(study: Path, out: Path | None) -> None:
    """Refuse a run folder whose study.toml is the study itself, and would be replaced.

    Raises
    ------
    InputError
        Naming the folder.
    """
    if out is not None and (out / "study.toml").resolve() == study.resolve():
        raise InputError(
            f"{out}: is the folder of {study} itself, which would be replaced by the study with "
            "what was found; choose another --out"
        )


def copied(body: Body, copy: Path) -> Body:
    """Return a body whose file is a copy of its present one; one without a file as it is."""
    if body.file is None:
        return body
    copy_file(body.file, copy, ", key body.file")
    return body.model_copy(update={"file": copy.resolve()})


def copy_file(source: Path, copy: Path, key: str = "") -> None:
    """Copy an input file, unless it is in its place already; `key` names it in a message."""
    if copy.resolve() == source.resolve():
        return
    try:
        shutil.copyfile(source, copy)
    except OSError as error:
        raise InputError(
            f"{source}{key}: cannot be copied to {copy} ({error.strerror}); check both paths"
        ) from error


def keep_inputs(study: Study, scan: Scan, run: Path) -> Study:
    """Copy scan, body and study into the run folder; return the study that names the copies."""
    write_scan(scan, run / "scan.csv")
    about = study.study.model_copy(update={"scan": (run / "scan.csv").resolve()})
    body = study.body
    if body.file is not None:
        contacts = body.shape == "from-contacts"  # kept beside a scan that may have lost presses
        name = f"contacts{body.file.suffix}" if contacts else body.file.name
        body = copied(body, run / name)
    study_map = study.map
    if study_map.regions is not None:
        copy = run / study_map.regions.name
        copy_file(study_map.regions, copy, ", key map.regions")
        study_map = study_map.model_copy(update={"regions": copy.resolve()})
    kept = study.model_copy(update={"study": about, "body": body, "map": study_map})
    write_study(kept, run / "study.toml")
    return kept
