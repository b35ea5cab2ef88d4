"""The sealed answer of a blind trial: not to be read by accident, and not to be changed unseen."""

import base64
import hashlib
import json
from pathlib import Path

from models import InputError
from palpmap.blind.records import SealRecord, TrialTruthRecord

FOLDER = "sealed"
FILE = "answer.json"


def seal(trial: Path, answer: TrialTruthRecord) -> None:
    """Write a trial's answer, base64 with its SHA-256, under `sealed/`."""
    text = json.dumps(answer.to_dict(), allow_nan=False).encode()
    (trial / FOLDER).mkdir(exist_ok=True)
    sealed = SealRecord(
        answer_base64=base64.b64encode(text).decode(), sha256=hashlib.sha256(text).hexdigest()
    )
    sealed.write(trial / FOLDER / FILE)


def unseal(trial: Path) -> TrialTruthRecord:
    """Read a trial's answer.

    Raises
    ------
    InputError
        No trial, or an answer that was changed.
    """
    path = trial / FOLDER / FILE
    if not path.is_file():
        raise InputError(
            f"{trial}: found no {FOLDER}/{FILE}, expected a folder that `palpmap blind` has made"
        )
    record = SealRecord.read(path)
    try:
        text = base64.b64decode(record.answer_base64, validate=True)
        intact = hashlib.sha256(text).hexdigest() == record.sha256
    except ValueError:
        intact, text = False, b""
    if not intact:
        raise InputError(f"{path}: the answer does not fit its SHA-256: it was changed or cut off")
    return TrialTruthRecord.model_validate_json(text)
