"""Input files of a command, copied into its run folder, so that the folder stands for itself."""

import shutil
from pathlib import Path

from models import InputError, Scan, write_scan
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


def keep_inputs(study: Study, scan: Scan, run: Path) -> Study:
    """Copy scan, body and study into the run folder; return the study that names the copies."""
    write_scan(scan, run / "scan.csv")
    about = study.study.model_copy(update={"scan": (run / "scan.csv").resolve()})
    body = study.body
    if body.file is not None:
        contacts = body.shape == "from-contacts"  # kept beside a scan that may have lost presses
        name = f"contacts{body.file.suffix}" if contacts else body.file.name
        copy = (run / name).resolve()
        if copy != body.file.resolve():
            try:
                shutil.copyfile(body.file, copy)
            except OSError as error:
                raise InputError(
                    f"{body.file}, key body.file: cannot be read ({error.strerror}); check the path"
                ) from error
        body = body.model_copy(update={"file": copy})
    kept = study.model_copy(update={"study": about, "body": body})
    write_study(kept, run / "study.toml")
    return kept
