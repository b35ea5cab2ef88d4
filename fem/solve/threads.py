"""Presses shared out over threads, each with its own single-threaded factors.

Small sparse factorisations gain little from two threads inside, and two of them side by side gain
all. A solver for these threads therefore has one thread inside (`solver_for_threads`), as numba has
in each of them, and only there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from queue import SimpleQueue
from typing import TypeVar

import numba

from fem.solve.direct import PardisoSolver, Solver

Worker = TypeVar("Worker")
Result = TypeVar("Result")


def available_cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def solver_for_threads(solver: Solver) -> Solver:
    """Return the solver, made to take one thread inside."""
    return replace(solver, threads=1) if isinstance(solver, PardisoSolver) else solver


def map_over_workers(
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

    with ThreadPoolExecutor(len(workers), initializer=numba.set_num_threads, initargs=(1,)) as pool:
        return list(pool.map(run, range(count)))
