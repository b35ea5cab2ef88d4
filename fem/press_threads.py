"""Presses shared out over threads, each with its own single-threaded factors.

Small sparse factorisations gain little from two threads inside, and two of them side by side gain
all. MKL's and numba's number of threads is therefore set to one in each of these threads, and only
there.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from queue import SimpleQueue
from typing import Any, TypeVar

import numba

from fem.solver import PardisoSolver, Solver

Worker = TypeVar("Worker")
Result = TypeVar("Result")


def available_cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def solver_for_threads(solver: Solver) -> Solver:
    """Return the solver, made so that analysing in a thread leaves the process's setting alone."""
    if not isinstance(solver, PardisoSolver) or solver.threads:
        return solver
    return replace(solver, threads=_mkl().MKL_Get_Max_Threads())


def share_out(
    workers: Sequence[Worker], task: Callable[[Worker, int], Result], count: int
) -> list[Result]:
    """Results of `task(worker, i)` for i < count; no worker is used by two threads at a time."""
    free: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        free.put(worker)

    def run(i: int) -> Result:
        worker = free.get()
        try:
            return task(worker, i)
        finally:
            free.put(worker)

    with ThreadPoolExecutor(len(workers), initializer=_one_thread_inside) as pool:
        return list(pool.map(run, range(count)))


def _mkl() -> Any:
    """MKL's library, as `fem.solver` finds it; an error where there is none."""
    from pypardiso import ps

    return ps.libmkl


def _one_thread_inside() -> None:
    """Tell numba and MKL, where it is there, to take one thread when called from this one."""
    numba.set_num_threads(1)
    try:
        _mkl().MKL_Set_Num_Threads_Local(ctypes.c_int(1))
    except (ImportError, OSError, AttributeError):
        return  # no MKL
