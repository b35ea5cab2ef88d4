"""Files that are written whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.errors import InputError


@contextmanager
def replaced(path: str | os.PathLike[str], ending: str = ".part") -> Iterator[Path]:
    """Give a path beside `path` to write to; at the end that file takes its place in one step.

    A killed program leaves the old file or the new one. After an error the file beside is removed.

    Parameters
    ----------
    ending : added to the name of the file beside; writers that go by a file's ending need their own

    Raises
    ------
    InputError
        There is no such folder, or a folder has the file's name.
    OSError
        The disk is full or read-only, ...; names `path`.

    Examples
    --------
    >>> path = getfixture("tmp_path") / "study.toml"
    >>> with replaced(path) as beside:
    ...     length = beside.write_text("text")
    >>> path.read_text()
    'text'
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: found a folder, expected a file's name; choose another one")
    if not path.parent.is_dir():
        raise InputError(
            f"{path}: there is no folder {path.parent}, expected one to write the file to; make it "
            "first or choose another path"
        )
    beside = path.with_name(path.name + ending)
    try:
        yield beside
        beside.replace(path)
    except BaseException as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        if isinstance(error, OSError):  # writing to a full disk does not say in which file
            reason = error.strerror or str(error)
            raise OSError(error.errno, reason, str(path)) from error
        raise
