"""Compiled functions whose kept machine code is renewed when any file of this package changes.

numba keeps machine code beside a function's file and looks at that file alone: a change in another
one, whose function is called, would not be seen.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable)

MARK = "from sim.robot.compiled import"

STAMP = tuple(
    (str(file), file.stat().st_mtime_ns, file.stat().st_size)
    for file in sorted(Path(__file__).parent.parent.rglob("*.py"))
    if MARK in file.read_text(encoding="utf-8")
)


def compiled(function: Function) -> Function:
    """Compile a function when it is called first, and keep the machine code."""
    return _kept(function)


def part(function: Function) -> Function:
    """Compile a function that compiled ones alone call, which takes less time."""
    return _kept(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _kept(function: Function, **options: Any) -> Function:
    made: Any = numba.njit(cache=True, **options)(function)
    file = getattr(made._cache, "_cache_file", None)  # none where nothing can be written
    if file is not None:
        file._source_stamp = STAMP
    return made
