"""Computing time and memory of whole commands: from a scan to its diagnosis, explanation, limits.

Part of `python benchmarks/run.py`. Each command runs by itself in one thread, once before it is
measured so that compiled code is there. Time is that of the processor (user and system), which
other work on the machine changes little.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
LAB = ROOT / "tests" / "data" / "lab"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
COMMANDS = (("diagnose", "case_g"), ("explain", "case_g"), ("explain", "case_i"),
            ("limits", "case_g"))  # fmt: skip


class Run(NamedTuple):
    """A command that has ended: its answer, seconds of CPU and of time, peak memory in GB."""

    answer: str
    cpu_s: float
    wall_s: float
    peak_gb: float


def run(command: str, study: Path) -> Run:
    """Run a command on a study as a process of its own."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as said:
        words = [sys.executable, "-m", "palpmap", command, str(study), "--json"]
        if command == "explain":
            words += ["--out", str(Path(folder, "run"))]
        begin = time.perf_counter()
        process = subprocess.Popen(words, stdout=said, stderr=subprocess.DEVNULL, cwd=ROOT,
                                   env=os.environ | ONE_THREAD)  # fmt: skip
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        if process.returncode not in (0, 1):
            raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}")
        record = json.loads(said.read())
    names = record.get("added") or record.get("significant") or ()
    answer = ", ".join([*([record["verdict"]] if "verdict" in record else []), *names])
    unit = 1e9 if sys.platform == "darwin" else 1e9 / 1024
    return Run(answer, used.ru_utime + used.ru_stime, wall, used.ru_maxrss / unit)


def table() -> list[str]:
    """Return the table, a row for each command."""
    run("diagnose", LAB / "case_g" / "study.toml")  # compiles
    rows = ["| command | scan | answer | CPU s | time s | peak memory GB |",
            "|---|---|---|---:|---:|---:|"]  # fmt: skip
    for command, case in COMMANDS:
        ended = run(command, LAB / case / "study.toml")
        rows.append(
            f"| `{command}` | `{case}` | {ended.answer} | {ended.cpu_s:.0f} | {ended.wall_s:.0f} "
            f"| {ended.peak_gb:.1f} |"
        )
    return [
        "81 presses, 1,782 readings; meshes of 8 x 8 x 4 and 12 x 12 x 6; one thread.",
        "",
        *rows,
    ]


if __name__ == "__main__":
    print("\n".join(table()))
