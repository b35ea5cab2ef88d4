"""Messages of a command, and the meaning of its exit code.

Results go to stdout, progress and errors to stderr, so that `palpmap ... --json | jq` works.
"""

import errno
import functools
import json
import os
import shlex
import shutil
import sys
import sysconfig
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

    from palpmap.progress import ShownTask, Stage

FAILED_CRITERION = 1
BAD_INPUT = 2
INTERRUPTED = 130


@dataclass(frozen=True)
class Output:
    """Where a command speaks.

    Attributes
    ----------
    quiet : bool
        Nothing but results asked for by `json`, and errors.
    json : bool
        The result as one JSON object on stdout; tables and texts are left out.
    """

    quiet: bool = False
    json: bool = False

    def say(self, *renderables: "RenderableType") -> None:
        """Print text or rich renderables for a person, unless quiet or json."""
        if not self.quiet and not self.json:
            from palpmap.lasting_console import LastingConsole

            console = LastingConsole(highlight=False)
            for renderable in renderables:  # a line each; a path is not broken in two
                console.print(renderable, soft_wrap=isinstance(renderable, str))

    def result(self, record: Mapping[str, object], *renderables: "RenderableType") -> None:
        """Print a result: the record if json, else the renderables."""
        if self.json:
            sys.stdout.write(json.dumps(record, indent=1, allow_nan=False) + "\n")
        else:
            self.say(*renderables)

    def task(self, stages: "Sequence[Stage]" = ()) -> "ShownTask":
        """Show a task on stderr (a context), silent if quiet; see `palpmap.progress.ShownTask`."""
        from palpmap.progress import ShownTask

        return ShownTask(stages, quiet=self.quiet)


def to_type(*words: object) -> str:
    """Return a palpmap command as it can be typed here, with palpmap on the path or not."""
    program = "palpmap"
    if shutil.which(program) is None:
        installed = Path(sysconfig.get_path("scripts")) / program
        here = Path.cwd()
        program = os.fspath(installed.relative_to(here) if here in installed.parents else installed)
    return shlex.join([program, *map(str, words)])


def plain(sentences: Sequence[str]) -> list[str]:
    """Return sentences for the console: brackets in a path are no markup."""
    from rich.markup import escape

    return [escape(text) for text in sentences]


def complain(sentence: str) -> None:
    """Print one red sentence to stderr, unwrapped."""
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True).print(Text(f"palpmap: {sentence}", style="red"), soft_wrap=True)


class SentenceWarning(UserWarning):
    """A warning that is a sentence for the user: what, and what to do."""


@contextmanager
def _sentences() -> Iterator[None]:
    """Print warnings that are sentences as such, others as Python does."""
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(message, category, *where, **more) -> None:
            if issubclass(category, SentenceWarning):
                complain(str(message))
            else:
                others(message, category, *where, **more)

        warnings.showwarning = show
        yield


def answers(command: Callable[..., bool | None]) -> Callable[..., None]:
    """Wrap a command: what it returns or raises becomes sentence and exit code.

    True or None: 0. False (a criterion failed): 1. Bad input, mesh or solver errors, a full or
    read-only disk, too little memory: one sentence, 2. Ctrl-C: 130. Anything else is a fault of the
    program and keeps its traceback. A `SentenceWarning` is a sentence, too.
    """

    @functools.wraps(command)
    def answered(*args, **kwargs) -> None:
        import typer

        try:
            with _sentences():
                passed = command(*args, **kwargs)
        except ValueError as error:
            if not is_for_the_user(error):
                raise
            complain(str(error))
            raise typer.Exit(BAD_INPUT) from error
        except OSError as error:
            if error.errno == errno.EPIPE:  # `palpmap ... | head`
                raise
            complain(_of_the_disk(error))
            raise typer.Exit(BAD_INPUT) from error
        except MemoryError as error:
            complain(
                "the memory is used up; make the body smaller (body.size_m), the cells larger "
                "(body.cell_size_m), or use fewer presses"
            )
            raise typer.Exit(BAD_INPUT) from error
        except KeyboardInterrupt as error:
            folder = getattr(error, "folder", None)
            where = f", run folder is readable: {folder}" if folder else ""
            if getattr(error, "again", False):
                where += "; files that it had not yet replaced are of the run before"
            complain(f"interrupted{where}")
            raise typer.Exit(INTERRUPTED) from error
        if passed is False:
            raise typer.Exit(FAILED_CRITERION)

    return answered


_CURES = {
    errno.ENOSPC: "free some space, or write to another disk",
    errno.EDQUOT: "free some space, or write to another disk",
    errno.EFBIG: "free some space, or write to another disk",
    errno.EROFS: "choose another place for the files that are written",
    errno.EACCES: "change its permissions, or choose another file or folder",
    errno.EPERM: "change its permissions, or choose another file or folder",
    errno.ENAMETOOLONG: "choose a shorter name",
}


def _of_the_disk(error: OSError) -> str:
    """Return the system's words about a file as a sentence with a cure."""
    path = "" if error.filename is None else f"{error.filename}: "
    reason = error.strerror or str(error)
    cure = _CURES.get(error.errno or 0, "check the path and the disk")
    return f"{path}cannot be read or written ({reason}); {cure}"


def is_for_the_user(error: ValueError) -> bool:
    """Tell whether an error is about the input: InputError, or of mesh, solver or start."""
    from models import InputError  # here, as `palpmap --help` loads no numpy

    if isinstance(error, InputError):
        return True
    if "fem" not in sys.modules:
        return False
    from fem import MeshError, SolverError

    if "identify.optimize.result" in sys.modules:
        from identify.optimize import InadmissibleError

        if isinstance(error, InadmissibleError):
            return True
    return isinstance(error, (MeshError, SolverError))
