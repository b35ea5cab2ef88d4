"""The folder of a new study: a refusal leaves nothing there, and names what the user gave."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from models import InputError
from palpmap.console import is_for_the_user

_NOT_YET = re.compile(r" \(line \d+\)| \(if the values? (is|are) right, set units_checked[^)]*\)")
"""Lines of a scan that is removed, and cures in a study that is."""


@contextmanager
def new_folder(folder: Path, names: Mapping[str, str]) -> Iterator[None]:
    """Make a folder; an error removes the files written since, and the folder if it is new.

    Parameters
    ----------
    folder : of the study
    names : files and keys of the study, as an error names them, each with the user's word for it
    """
    before = set(folder.iterdir()) if folder.is_dir() else None
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except (ValueError, OSError) as error:
        for path in set(folder.iterdir()) - (before or set()):
            path.unlink()
        if before is None:
            folder.rmdir()
        if isinstance(error, OSError) or not is_for_the_user(error):
            raise
        text = _NOT_YET.sub("", str(error))
        for ours, users in names.items():
            text = text.replace(ours, users)
        raise InputError(text) from error
