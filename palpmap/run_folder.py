"""The run folder: the files of a command, and their origin.

`run.json` holds one entry a command that wrote into the folder: versions, seed, settings, tuning
numbers of the analysis, hashes of the inputs, start, end and outcome. It is written first, so that
a killed run can be read too.
"""

import hashlib
import os
import platform
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType

from filelock import FileLock, Timeout
from pydantic import Field, JsonValue

from identify import Settings
from models import InputError
from palpmap.console import SentenceWarning
from palpmap.record import FileRecord, Record
from palpmap.version import __version__

LOCK = ".lock"
PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "pypardiso",
    "mujoco",
    "pin",
    "pytetwild",
    "pyvista",
    "rerun-sdk",
    "pyarrow",
    "pydantic",
    "matplotlib",
)


class RunRecord(Record):
    """How one command of a run folder ran; fields that an older palpmap did not write are empty."""

    command: str = Field(default="?", description="name of the command")
    started: str = Field(default="?", description="date and time in UTC, ISO 8601")
    ended: str | None = Field(default=None, description="date and time in UTC, null while it runs")
    outcome: str = Field(
        default="running", description="running, done, interrupted, or failed and why"
    )
    seed: int | None = Field(default=None, description="seed of all random numbers")
    settings: Mapping[str, JsonValue] = Field(
        default={}, description="whatever else decides the outcome"
    )
    tuning: Mapping[str, JsonValue] = Field(
        default={}, description="tuning numbers of the analysis, by algorithm and name"
    )
    inputs: Mapping[str, str] = Field(
        default={}, description="SHA-256 of each file read, by its path"
    )
    versions: Mapping[str, str] = Field(
        default={}, description="of Python and the packages that matter"
    )


class RunsRecord(FileRecord):
    """run.json: the commands that wrote into the folder, in order."""

    runs: tuple[RunRecord, ...]


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `folder` holds what was written until then.

    `again` is true where runs before wrote into it, too.
    """

    def __init__(self, folder: Path, again: bool):
        super().__init__(str(folder))
        self.folder = folder
        self.again = again


class RunFolder:
    """A folder for one run, as a context: `with RunFolder("fit", out, ...) as run: ...`.

    Parameters
    ----------
    command : str
        Name of the command, such as "fit".
    out : path or None
        The folder; None makes runs/<command>-<date>. An existing run folder is added to by the same
        command with the same inputs, and by one that reads its own files.
    seed : int or None
        Seed of all random numbers of the run.
    settings : mapping
        Whatever else decides the outcome; must be JSON.
    inputs : sequence of paths
        Files that were read, recorded with their SHA-256.

    Raises
    ------
    InputError
        If `out` is a file, or a folder with other things in it or of another command or study, or
        cannot be written, or another command is writing into it; or if an input cannot be read.
    """

    def __init__(
        self,
        command: str,
        out: str | os.PathLike[str] | None = None,
        *,
        seed: int | None = None,
        settings: Mapping[str, JsonValue] | None = None,
        inputs: Sequence[str | os.PathLike[str]] = (),
    ):
        self.path = default_folder(command) if out is None else Path(out)
        # What is no run folder and what cannot be read is refused before anything is made
        earlier = _earlier_runs(self.path)
        hashes = {str(path): _hash_of(path) for path in inputs}
        _refuse_mixing(self.path, command, hashes, earlier)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.path}: the run folder cannot be made ({error.strerror}); "
                "choose another with --out"
            ) from error
        self._lock = _locked(self.path)
        self._earlier = _earlier_runs(self.path)
        self._run = RunRecord(
            command=command,
            started=_now(),
            seed=seed,
            settings=settings or {},
            tuning=Settings().to_dict(),
            inputs=hashes,
            versions=versions(),
        )
        try:
            self._save()
        except OSError as error:
            raise InputError(
                f"{self.path}: the run folder cannot be written to ({error.strerror}); make it "
                "writable or choose another with --out"
            ) from error
        if self._lock is None:
            warnings.warn(
                f"{self.path}: this file system knows no locks, so that nothing keeps a second "
                "command from writing into the folder meanwhile; let no other write there",
                SentenceWarning,
                stacklevel=2,
            )

    def __enter__(self) -> "RunFolder":
        """Return the folder itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Record how the run ended; Ctrl-C becomes RunInterrupted, which knows the folder."""
        if error is None:
            self.finish("done")
        elif isinstance(error, KeyboardInterrupt):
            self.finish("interrupted")
            raise RunInterrupted(self.path, bool(self._earlier)) from error
        else:
            self.finish(f"failed: {error}")

    def __truediv__(self, name: str) -> Path:
        """Path of a file in the folder."""
        return self.path / name

    def finish(self, outcome: str) -> None:
        """Record the outcome, unless one was recorded before."""
        if self._run.outcome == "running":
            self._run = self._run.changed(outcome=outcome, ended=_now())
            self._save()
            with suppress(OSError):  # Windows removes it when it is released
                (self.path / LOCK).unlink()
            if self._lock is not None:
                self._lock.release()

    def _save(self) -> None:
        RunsRecord(runs=(*self._earlier, self._run)).write(self.path / "run.json")


def sha256(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file as hexadecimal text."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _hash_of(path: str | os.PathLike[str]) -> str:
    try:
        return sha256(path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}), expected a file; check the path"
        ) from error


def versions() -> dict[str, str]:
    """Versions of Python, the machine's kind and the packages that decide a result."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    found["palpmap"] = __version__
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _earlier_runs(path: Path) -> tuple[RunRecord, ...]:
    if path.is_file():
        raise InputError(f"{path}: found a file, expected a folder; choose another with --out")
    if (path / "run.json").is_file():
        return RunsRecord.read(path / "run.json").runs
    if path.is_dir() and any(file.name != LOCK for file in path.iterdir()):
        raise InputError(
            f"{path}: found a folder with other things in it, expected a new, empty or earlier "
            "run folder; choose another with --out"
        )
    return ()


def _refuse_mixing(
    path: Path, command: str, inputs: Mapping[str, str], earlier: Sequence[RunRecord]
) -> None:
    """Refuse a folder whose files belong to another study, or whose report another one replaces."""
    ran = [run.inputs for run in earlier if run.command == command]
    # A path may be written in two ways, and a study may be edited and fitted once more
    again = any(set(run) == set(inputs) or set(run.values()) == set(inputs.values()) for run in ran)
    own = inputs and all(Path(name).resolve().parent == path.resolve() for name in inputs)
    replaces = not ran and command != "compare" and (path / "report.html").exists()
    if earlier and not again and (replaces or not own):
        made = " ".join(["palpmap", earlier[0].command, *list(earlier[0].inputs)[:1]])
        raise InputError(
            f"{path}: found the run folder of `{made}`, expected a new or empty one, as the files "
            "of both would be mixed; choose another with --out"
        )


def refuse_interrupted(path: Path) -> None:
    """Refuse a run folder whose study is of a run that did not end, and its fit of one before.

    Raises
    ------
    InputError
        Naming the folder, and the command to end it with.
    """
    runs = RunsRecord.read(path / "run.json").runs if (path / "run.json").is_file() else ()
    runs = [run for run in runs if run.command != "compare"]  # which reads both
    done = [run for run in runs if run.outcome == "done"]
    if not done or runs[-1] is done[-1]:
        return
    last, before = runs[-1], done[-1]
    same = (*last.inputs.values(), last.settings) == (*before.inputs.values(), before.settings)
    study, fit = (path / name for name in ("study.toml", "fit.json"))
    if same or fit.stat().st_mtime_ns >= study.stat().st_mtime_ns:  # written after its study
        return
    again = " ".join(["palpmap", last.command, *list(last.inputs)[:1], "--out", str(path)])
    raise InputError(
        f"{path}: its study.toml is of the `palpmap {last.command}` that began at {last.started} "
        f"and did not end, its fit.json of the run before; make the folder whole by `{again}`, or "
        "fit into a new one"
    )


def _locked(path: Path) -> FileLock | None:
    """Lock the folder for this process; the system lifts the lock of one that was killed.

    None where the file system has no locks, as some network drives, or cannot be written to, which
    is refused as run.json is saved.
    """
    lock = FileLock(path / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise InputError(
            f"{path}: another command is writing into this run folder; wait until it has ended "
            "or choose another with --out"
        ) from error
    except (OSError, NotImplementedError):
        return None
    return lock


def default_folder(command: str) -> Path:
    """Return the path of a new folder for a command, runs/<command>-<date>."""
    stamp = datetime.now().strftime("%Y-%m-%d-%H%M%S")
    folder = Path("runs") / f"{command}-{stamp}"
    number = 2
    while folder.exists():
        folder = Path("runs") / f"{command}-{stamp}-{number}"
        number += 1
    return folder


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def how_made(folder: Path) -> dict[str, str]:
    """Return commands, seeds, settings, input hashes and versions of a run folder as text."""
    path = folder / "run.json"
    runs = RunsRecord.read(path).runs if path.is_file() else ()
    how: dict[str, str] = {}
    for number, run in enumerate(runs, start=1):
        settings = ", ".join(f"{k} = {v}" for k, v in run.settings.items())
        seed = "" if run.seed is None else f", seed {run.seed}"
        how[f"{number}. palpmap {run.command}"] = (
            f"{run.started}{seed}{'; ' + settings if settings else ''}"
        )
        names = [Path(path).name for path in run.inputs]
        for path, digest in run.inputs.items():
            name = Path(path).name  # of two runs' files the folders tell which is which
            how[name if names.count(name) == 1 else path] = f"SHA-256 {digest}"
    if runs:
        how["Versions"] = ", ".join(f"{k} {v}" for k, v in runs[-1].versions.items())
    return how
