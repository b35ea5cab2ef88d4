"""Runs the benchmarks and writes their tables into docs/benchmarks.md, between its markers.

`make bench` runs all, `python benchmarks/run.py accuracy` one. About twenty minutes on two cores.
Other programs take part where they are installed: `pip install -e ".[bench]"`, and `ccx`.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import sys
from importlib.metadata import version
from pathlib import Path

from palpmap import __version__ as ours  # first: it says how many threads numpy may have

import accuracy  # isort: skip
import demo_run  # isort: skip
import explain  # isort: skip
import finite_strain  # isort: skip
import paper_tests  # isort: skip
import peers  # isort: skip
import reduced  # isort: skip
import robot_loop  # isort: skip
import scaling  # isort: skip
import solver  # isort: skip
from fem import default_solver  # isort: skip

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
BENCHMARKS = {
    "demo": demo_run.table,
    "robot": robot_loop.table,
    "explain": explain.table,
    "reduced": reduced.table,
    "reduced_ratio": reduced.ratio_table,
    "solver": solver.table,
    "accuracy": accuracy.table,
    "paper": paper_tests.table,
    "peers": peers.table,
    "scaling": scaling.table,
    "finite_strain": finite_strain.table,
}


def machine() -> str:
    """Kind of machine and versions, for a table's caption."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return (
        f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"palpmap {ours}, {packages}, {default_solver().name}"
    )


def processor() -> str:
    """Architecture, with the processor's name where the system tells it (Linux)."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    return platform.machine() + (f" ({found[1].strip()})" if found else "")


def put(text: str, name: str, lines: list[str]) -> str:
    """Return the text with the lines between the two markers of that name.

    Raises
    ------
    ValueError
        The text has not exactly one such pair of markers.
    """
    first, last = f"<!-- bench:{name} -->", f"<!-- /bench:{name} -->"
    if text.count(first) != 1 or text.count(last) != 1 or text.index(first) > text.index(last):
        raise ValueError(f"{PAGE.name} needs {first} and, below it, {last}, each once")
    before, rest = text.split(first)
    return f"{before}{first}\n{chr(10).join(lines)}\n{last}{rest.split(last)[1]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="|".join(BENCHMARKS), help="default: all")
    names = parser.parse_args().names or list(BENCHMARKS)
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"no benchmark '{unknown[0]}'; there are {', '.join(BENCHMARKS)}")
    for name in names:
        lines = [*BENCHMARKS[name](), "", f"Measured on {machine()}."]
        print("\n".join(lines), end="\n\n", flush=True)
        # read afresh each time, so that an edit made during the run is kept
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(put(text, name, lines), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
