"""A user's own code under guard: its errors and its endless loops become one sentence."""

import functools
import inspect
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fem import MeshError, SolverError
from identify.body import BodyState
from identify.effects import Advice, Effect
from identify.effects.base import LINKS
from identify.optimize import InadmissibleError
from models import InputError

LONGEST_CALL_S = 30.0  # a call takes milliseconds, that of a body effect up to seconds
_OURS = (InputError, InadmissibleError, MeshError, SolverError)
_CALLED = (*LINKS, *(n for kind in (Effect, Advice) for n, m in vars(kind).items()
                     if inspect.isfunction(m) and not n.startswith("_")))  # fmt: skip


class _TooLong(BaseException):
    """Raised inside code that takes too long; no `except Exception` of that code stops it."""


@contextmanager
def guarded(path: Path, what: str) -> Iterator[None]:
    """Turn what a user's code raises into a sentence with file and line.

    Code that takes longer than `LONGEST_CALL_S` is stopped (in the main thread, on systems with
    interval timers).

    Parameters
    ----------
    path : the user's file
    what : the part of it that runs, in words

    Raises
    ------
    InputError
        The code raises, calls sys.exit, or does not end.
    """
    try:
        with _time_limit():
            yield
    except _OURS:
        raise
    except _TooLong as error:
        raise InputError(
            f"{path}{_line(error, path)}: {what} has not ended after {LONGEST_CALL_S:g} s; look "
            "for a loop that does not end there, then run `palpmap check-effect`"
        ) from error
    except SystemExit as error:
        raise InputError(
            f"{path}{_line(error, path)}: {what} calls sys.exit (SystemExit), expected a "
            "result; remove the call"
        ) from error
    except Exception as error:
        raise InputError(
            f"{path}{_line(error, path)}: {type(error).__name__}: {error}, raised by {what}"
        ) from error


def guard_methods(kind: type[Effect], path: Path) -> None:
    """Put the methods of a user's effect that the program calls under guard."""
    for name in _CALLED:
        method = vars(kind).get(name)
        if inspect.isfunction(method):
            setattr(kind, name, _guarded_method(method, path, f"{kind.__name__}.{name}()"))


def _guarded_method(method: Callable, path: Path, what: str) -> Callable:
    @functools.wraps(method)
    def called(*args, **kwargs):
        with guarded(path, what):
            result = method(*args, **kwargs)
        _check_result(method.__name__, result, args, path, what)
        return result

    return called


def _check_result(name: str, result: object, args: tuple, path: Path, what: str) -> None:
    """Refuse the result of a hook that is no number, or not one for each reading."""
    if name not in LINKS:
        return
    if name == "body":
        if not isinstance(result, BodyState):
            raise InputError(f"{path}: {what} returns {type(result).__name__}, expected BodyState")
        return
    shape = (len(args[1]),) if name != "touch" else ()  # args: self, readings, ...
    try:
        found = np.asarray(result, dtype=np.float64).shape
    except (TypeError, ValueError):
        found = type(result).__name__
    if found != shape:
        wanted = f"an array of shape {shape}, a number a reading" if shape else "a number"
        raise InputError(f"{path}: {what} returns {found}, expected {wanted}")


@contextmanager
def _time_limit() -> Iterator[None]:
    """Raise `_TooLong` in the block after `LONGEST_CALL_S`; the inner one of two blocks counts."""
    main = threading.current_thread() is threading.main_thread()
    if not main or not hasattr(signal, "setitimer") or signal.getitimer(signal.ITIMER_REAL)[0]:
        yield
        return

    def stop(*_: object) -> None:
        raise _TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_CALL_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _line(error: BaseException, path: Path) -> str:
    """Return the last line of the user's file on the way to an error, or nothing."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename) == path]
    return f", line {lines[-1]}" if lines else ""
