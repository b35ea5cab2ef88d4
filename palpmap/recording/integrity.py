"""How much of a recording file is whole: closed, stopped by a kill, cut off, or foreign.

An .rrd file is a header of 12 bytes and messages, each a header of 16 bytes (kind and length of its
payload, unsigned 64 bit, little endian) and a payload. A closed file has a message of kind 0 at its
end, and a footer. Rerun reads a file without that end, but not one that ends within a message.
"""

import shutil
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from models import InputError

_MAGIC = b"RRF2"
_FILE_HEADER = 12
_MESSAGE_HEADER = struct.Struct("<QQ")
_END = 0


@dataclass(frozen=True)
class Integrity:
    """Usable part of a file.

    Attributes
    ----------
    closed : ended by its writer
    total_bytes, whole_bytes : size of the file, and of its whole messages
    """

    closed: bool
    total_bytes: int
    whole_bytes: int


def examine(path: Path) -> Integrity:
    """Walk over the messages of a recording.

    Raises
    ------
    InputError
        If the file is empty, no Rerun recording, or too short to hold anything.
    """
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path} is empty; a recording was expected, so record the run again")
    with path.open("rb") as file:
        start = file.read(_FILE_HEADER)
        if start[:4] != _MAGIC[: len(start)]:
            raise InputError(
                f"{path} is not a Rerun recording (it starts with {start[:4]!r}, not {_MAGIC!r}); "
                "give a run folder or the recording.rrd in it"
            )
        whole = _FILE_HEADER
        while header := file.read(_MESSAGE_HEADER.size):
            if len(header) < _MESSAGE_HEADER.size:
                break
            kind, length = _MESSAGE_HEADER.unpack(header)
            after = whole + _MESSAGE_HEADER.size + length
            if after > size:
                break
            if kind == _END:
                return Integrity(closed=True, total_bytes=size, whole_bytes=size)
            whole = file.seek(after)
    if whole <= _FILE_HEADER:
        raise InputError(
            f"{path} is cut off after {size} bytes, before anything was recorded; "
            "copy it again, or record the run again"
        )
    return Integrity(closed=False, total_bytes=size, whole_bytes=whole)


@contextmanager
def readable(path: Path, integrity: Integrity) -> Iterator[Path]:
    """Give a file that Rerun can read: the recording, or a copy without its broken end."""
    if integrity.whole_bytes == integrity.total_bytes:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        shutil.copyfile(path, copy)
        with copy.open("r+b") as file:
            file.truncate(integrity.whole_bytes)
        yield copy
