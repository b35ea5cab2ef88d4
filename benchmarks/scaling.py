"""How time and memory grow with the mesh: 81 presses with all derivatives, up to a million cells.

Four-node tetrahedra without near field, as on the paper's mesh, each size in a process of its own.
Part of `python benchmarks/run.py`.
"""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
from memory import peak_mb

from fem import Contacts, PalpationModel, block_mesh

SIZE_M = (0.096, 0.096, 0.048)
# hexahedra of six tetrahedra each: 12,288, 98,304, 292,008 and 1,002,000 of these
DIVISIONS = ((16, 16, 8), (32, 32, 16), (46, 46, 23), (70, 70, 34))
RADIUS_M = 0.005
NU = 0.45
MEMORY_GB = 12.0  # that the largest needs


def measure(divisions: tuple[int, int, int]) -> tuple[int, int, float, float, float, float]:
    """Cells, unknowns, seconds of set-up, evaluation and derivatives, GB at most."""
    warm = Contacts([(0.048, 0.048, 0.048)], (0, 0, -1), RADIUS_M)
    for options in ({}, {"iterative_from": 0}):  # loads libraries and compiled code of both ways
        mesh = block_mesh(SIZE_M, (8, 8, 4), order=1)
        small = PalpationModel(mesh, NU, warm, near_field=False, **options)
        _ = small.evaluate(6e3).sensitivity
    place = np.linspace(0.012, 0.084, 9)
    contacts = Contacts([(x, y, SIZE_M[2]) for x in place for y in place], (0, 0, -1), RADIUS_M)
    start = time.perf_counter()
    mesh = block_mesh(SIZE_M, divisions, order=1)
    model = PalpationModel(mesh, NU, contacts, near_field=False)
    body = model._bonded
    _ = body.iterative or body.loaded_pattern  # prepared
    built = time.perf_counter()
    distance = ((model.points_m - [0.030, 0.048, 0.036]) ** 2).sum(axis=1)
    response = model.evaluate(6e3 + 12e3 * np.exp(-distance / (2 * 0.010**2)))
    solved = time.perf_counter()
    sensitivity = response.sensitivity
    end = time.perf_counter()
    assert sensitivity.shape == (len(contacts), len(model.points_m))
    memory = peak_mb() / 1024
    return (len(mesh.cells), len(body.loads), built - start, solved - built, end - solved, memory)


def free_gb() -> float:
    """Memory that a new process can have, as far as the system tells."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            known = dict(line.split(":") for line in lines)
        return int(known["MemAvailable"].split()[0]) / 1024**2
    except (OSError, KeyError):
        return float("inf")


def table() -> list[str]:
    """Return the lines of the table."""
    rows, sizes, seconds, note = [], [], [], ""
    for divisions in DIVISIONS:
        if divisions == DIVISIONS[-1] and free_gb() < MEMORY_GB:
            note = f" The largest was left out: {free_gb():.0f} GB of memory were free."
            break
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            try:
                cells, unknowns, *times, memory = pool.submit(measure, divisions).result()
            except BrokenProcessPool:
                note = f" {divisions} was ended by the system: not enough memory."
                break
        sizes.append(cells)
        seconds.append(times[1] + times[2])
        growth = ""
        if len(sizes) > 1:
            growth = f"{np.log(seconds[-1] / seconds[-2]) / np.log(sizes[-1] / sizes[-2]):.2f}"
        rows.append(
            f"| {cells:,} | {unknowns:,} | "
            + " | ".join(f"{value:.2f}" for value in times)
            + f" | {memory:.1f} | {growth} |"
        )
    whole = ""
    if len(sizes) > 1:
        slope = np.log(seconds[-1] / seconds[0]) / np.log(sizes[-1] / sizes[0])
        whole = f" From the first to the last the time grows like n^{slope:.2f}."
    return [
        "81 presses and the derivative of each by every cell's modulus; growth: exponent of the "
        f"time without set-up against the row above.{whole}{note}",
        "",
        "| cells | unknowns | set-up s | forward s | derivatives s | memory GB | growth |",
        "|---:|---:|---:|---:|---:|---:|---:|",
        *rows,
    ]


if __name__ == "__main__":
    print("\n".join(table()))
