"""Arguments from Python: what is of another kind than the annotation is refused in a sentence."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass
from functools import cache, wraps
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from models.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])
LONGEST = 80
_SINGLE = (str, bytes, os.PathLike)  # things that are no list, whatever Python can do with them
_PLAIN = {
    float: "a finite number",
    int: "a whole number",
    bool: "True or False",
    str: "a text",
    Path: "a path",
    os.PathLike: "a path",
    NoneType: "None",
    np.ndarray: "numbers",
}


def shortened(found: object) -> str:
    """Return a value as written in a file or in Python, on one line and cut where it is long.

    >>> shortened("a" * 200)[-8:]
    'aaaaa...'
    """
    text = " ".join(repr(found).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def path_or(found: object, name: str) -> str:
    """Return a path as an argument of a call that would read it, another thing by a name for it.

    >>> path_or("scan.csv", "path"), path_or(3, "path")
    ("'scan.csv'", 'path')
    """
    return repr(str(found)) if isinstance(found, str | os.PathLike) else name


@dataclass(frozen=True)
class AtLeast:
    """Smallest value of a number, as a note in its annotation: `Annotated[int, AtLeast(0)]`."""

    value: float


Seed = Annotated[int, AtLeast(0)]


def kinds_checked(taker: F) -> F:
    """Let a function, or a class by its fields, refuse arguments of another kind than annotated.

    Kinds are those of a person, not of a type checker: whole numbers are numbers, numpy's are
    numbers, too, arrays and tuples are lists, a text is no list, and a number is finite. What no
    annotation tells, such as the arguments of a callback, is not asked. A class may say in
    `made_from(found)` how one of it is made, for the sentence.

    Raises
    ------
    InputError
        When called: the argument, what was found and what is expected.

    Examples
    --------
    >>> @kinds_checked
    ... def wait(time_s: float) -> None: ...
    >>> try:
    ...     wait("long")
    ... except InputError as error:
    ...     print(error)
    time_s: found 'long', expected a finite number
    """
    if isinstance(taker, type):
        kind: Any = taker
        kind.__init__ = kinds_checked(kind.__init__)
        return kind
    defaults = {name: p.default for name, p in inspect.signature(taker).parameters.items()}

    @wraps(taker)
    def checked(*args, **kwargs):
        hints = _hints(taker)
        for name, value in (*zip(defaults, args, strict=False), *kwargs.items()):
            if name in hints and value is not defaults[name]:
                refuse_other_kind(name, value, hints[name])
        return taker(*args, **kwargs)  # which tells itself of missing and of unknown arguments

    return checked  # pyright: ignore[reportReturnType]


def points_of(points: object, name: str = "points") -> np.ndarray:
    """Return points as an array (p, 3).

    Raises
    ------
    InputError
        They are of another shape, or no numbers.
    """
    try:
        found = np.asarray(points, float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.ndim != 2 or found.shape[-1] != 3:
        raise InputError(
            f"{name}: found {shortened(points)}, expected rows of 3 numbers, (p, 3) in m; one "
            "point is [[x, y, z]]"
        )
    return found


def refuse_other_kind(name: str, value: object, kind: Any) -> None:
    """Refuse one argument of another kind; in a list, the item is named.

    Raises
    ------
    InputError
        The argument, what was found and what is expected.
    """
    quick = kind is float and type(value) is float and isfinite(value)
    if not (quick or _fits(value, kind)):
        item, wanted = _culprit(value, kind)
        raise InputError(f"{name}: found {_found(item)}, expected {_told(wanted, item)}")


@cache
def _hints(taker: Callable) -> dict[str, Any]:
    """Return the annotations; names that only a type checker imports stand for themselves."""
    scope = vars(sys.modules[taker.__module__])
    found = {}
    for name, hint in taker.__annotations__.items():
        known = dict(scope)
        while isinstance(hint, str):
            try:
                hint = eval(hint, known)
            except NameError as error:
                known[str(error.name)] = type(str(error.name), (), {"only_name": True})
        if name != "return":
            found[name] = hint
    return found


def _fits(value: Any, kind: Any) -> bool:
    origin, parts = get_origin(kind), get_args(kind)
    if _is_array_like(kind):
        return True  # whose shape the taker asks for
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Annotated:
        least = [note.value for note in parts[1:] if isinstance(note, AtLeast)]
        return _fits(value, parts[0]) and all(value >= low for low in least)
    if origin is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if kind is Callable or (origin is not None and origin is get_origin(Callable[..., Any])):
        return callable(value)
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return _fits_list(value, origin, parts)
    kind = origin or kind
    if not isinstance(kind, type) or kind is object or getattr(kind, "_is_protocol", False):
        return True
    return _fits_class(value, kind)


def _fits_class(value: Any, kind: type) -> bool:
    if kind in (float, int):
        value = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
        if isinstance(value, Integral):
            return True
        return kind is float and isinstance(value, Real) and bool(np.isfinite(float(value)))
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is np.ndarray:
        return _numeric(value)
    if getattr(kind, "only_name", False):
        return kind.__name__ in [one.__name__ for one in type(value).__mro__]
    return isinstance(value, kind)


def _fits_list(value: object, origin: type, parts: tuple) -> bool:
    if issubclass(origin, Mapping) or isinstance(value, Mapping):
        return isinstance(value, Mapping) and issubclass(origin, Mapping)
    if not (isinstance(value, Iterable) and isinstance(value, Sized)):
        return False
    if isinstance(value, _SINGLE) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return False
    kinds = _item_kinds(origin, parts, len(value))
    return len(kinds) == len(value) and all(map(_fits, value, kinds))


def _item_kinds(origin: type, parts: tuple, count: int) -> tuple:
    """Return the kind of each of so many items; fewer or more where a tuple has its own number."""
    own_number = issubclass(origin, tuple) and parts[-1:] != (...,)
    return parts if own_number and parts else (parts or (Any,))[:1] * count


def _is_array_like(kind: Any) -> bool:
    return get_origin(kind) in (Union, UnionType) and any(
        "_SupportsArray" in str(part) for part in get_args(kind)
    )


def _numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except ValueError:  # rows of different lengths
        return False


def _culprit(value: Any, kind: Any) -> tuple[Any, Any]:
    """Return the item of a list that does not fit, with its kind, or the value itself."""
    wanted = [part for part in (kind, *get_args(kind)) if _is_list(part)]
    if wanted and isinstance(value, list | tuple):
        kinds = _item_kinds(get_origin(wanted[0]), get_args(wanted[0]), len(value))
        for item, item_kind in zip(value, kinds, strict=False):
            if len(kinds) == len(value) and not _fits(item, item_kind):
                return _culprit(item, item_kind)
    return value, kind


def _is_list(kind: Any) -> bool:
    origin = get_origin(kind)
    return isinstance(origin, type) and issubclass(origin, Iterable) and not _is_array_like(kind)


def _found(value: object) -> str:
    known = isinstance(value, str | Path | int | float | list | tuple | dict | np.ndarray | None)
    text = shortened(value)
    return text if known or len(text) < LONGEST else f"this {type(value).__name__}"


def _told(kind: Any, found: object) -> str:
    """Return a kind in words, with how one is made where its class says so."""
    made = dict.fromkeys(kind.made_from(found) for kind in _classes(kind))
    return _words(kind) + (f": give {_one_of(list(made))}" if made else "")


def _classes(kind: Any) -> list[Any]:
    """Return the classes of an annotation that say how they are made."""
    if get_origin(kind) is None:
        return [kind] if hasattr(kind, "made_from") else []
    return [one for part in get_args(kind) for one in _classes(part)]


def _words(kind: Any) -> str:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        told = {_words(part): _is_list(part) for part in parts if part is not NoneType}
        if _PLAIN[Path] in told:  # a text is one, too
            told.pop(_PLAIN[str], None)
        return _one_of(sorted(told, key=lambda words: told[words]))
    if origin is Annotated:
        least = [f" from {note.value:g} on" for note in parts[1:] if isinstance(note, AtLeast)]
        return _words(parts[0]) + "".join(least)
    if origin is Literal:
        return _one_of([repr(part) for part in parts])
    if kind is Callable or (origin is not None and origin is get_origin(Callable[..., Any])):
        return "a function"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a dict"
    if _is_list(kind):
        return _told_list(parts)
    kind = origin or kind
    name = kind.__name__
    return _PLAIN.get(kind, f"{'an' if name[0] in 'AEIOU' else 'a'} {name}")


def _told_list(parts: tuple) -> str:
    told = [_words(part) for part in parts if part is not ...]
    if len(told) < 2:  # of any number
        return "a list" + "".join(f", each {one}" for one in told)
    if len(set(told)) == 1:
        return f"{len(told)} values, each {told[0]}"
    return f"{len(told)} values: {', '.join(told)}"


def _one_of(these: list[str]) -> str:
    *first, last = these
    return f"{', '.join(first)} or {last}" if first else last
