"""The paper's six tests by both optimisers, and one evaluation on the paper's mesh.

Part of `python benchmarks/run.py`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from identify.optimize.optimizers import OPTIMIZERS
from palpmap.paper.identical_twin import paper_model, paper_tests, solve_test

METHODS = ("bfgs", "gauss-newton")


def table() -> list[str]:
    """Return the lines of the table."""
    model = paper_model()
    modulus = paper_tests()[0].correct.modulus(model.points_m)
    _ = model.evaluate(modulus).sensitivity  # loads libraries
    times = np.empty((5, 2))
    for row in times:
        start = time.perf_counter()
        response = model.evaluate(modulus)
        middle = time.perf_counter()
        _ = response.sensitivity
        row[:] = middle - start, time.perf_counter() - middle
    evaluate, derive = np.median(times, axis=0)
    lines = [
        f"One evaluation on the paper's mesh (2,601 nodes, 12,288 four-node tetrahedra, 81 "
        f"presses): {1e3 * evaluate:.0f} ms, and {1e3 * derive:.0f} ms for the derivative by every "
        "modulus.",
        "",
        "| test | sought | " + " | ".join(f"{m}: evaluations | s | error" for m in METHODS) + " |",
        "|---|---|" + "---:|" * 6,
    ]
    for test in paper_tests():
        cells = []
        for method in METHODS:
            result = solve_test(test, model, OPTIMIZERS[method])
            largest = result.relative_error.max()
            cells.append(f"{result.evaluations} | {result.seconds:.1f} | {largest:.0e}")
        lines.append(f"| {test.name} | {', '.join(test.theta)} | " + " | ".join(cells) + " |")
    whole = ", ".join(f"{command(method):.1f} s with {method}" for method in METHODS)
    return [
        *lines,
        "",
        "Error: the largest relative error of the parameters found. All of `palpmap paper`, start "
        f"and figures included, the tests side by side: {whole}.",
    ]


def command(method: str) -> float:
    """Seconds of the whole command."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["paper", "--optimizer", method, "--out", str(Path(folder) / "paper")]
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "palpmap", *words], check=True, capture_output=True)
        return time.perf_counter() - start
