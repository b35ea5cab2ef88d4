"""What a command read, copied into its run folder, so that the folder stands for itself."""

import shutil
from pathlib import Path

from models.scan import Scan
from models.scan_file import write_scan
from palpmap.study import Study, write_study


def keep_inputs(study: Study, scan: Scan, run: Path) -> Study:
    """Copy scan, body and study into the run folder; return the study that names the copies."""
    write_scan(scan, run / "scan.csv")
    about = study.study.model_copy(update={"scan": (run / "scan.csv").resolve()})
    body = study.body
    if body.file is not None:
        copy = (run / body.file.name).resolve()
        if copy != body.file.resolve():
            shutil.copyfile(body.file, copy)
        body = body.model_copy(update={"file": copy})
    kept = study.model_copy(update={"study": about, "body": body})
    write_study(kept, run / "study.toml")
    return kept
