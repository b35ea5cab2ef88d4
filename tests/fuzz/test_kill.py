"""A program that is killed while it writes leaves the old file or the new one."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from models import read_scan, write_scan
from palpmap.study.study import load_study, write_study
from tests.paths import LAB

KILLS = 50

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")


def killed(write, seconds: float) -> None:
    """Call `write(k)`, k = 0, 1, ..., in a process that is killed after some seconds."""
    child = os.fork()
    if not child:
        k = 0
        while True:
            write(k)
            k += 1
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["scan", "study"])
def test_fifty_kills_leave_no_lost_or_half_written_file(kind, tmp_path):
    rng = np.random.default_rng(9)
    scan = read_scan(LAB / "case_c" / "scan.csv")
    scan = scan.rows(scan.press < 20)
    study = load_study(LAB / "case_c" / "study.toml")
    path: Path = tmp_path / ("scan.csv" if kind == "scan" else "study.toml")

    def write(k: int) -> None:
        if kind == "scan":
            write_scan(scan.replace(force_n=scan.force_n + k % 10), path)
        else:
            about = study.study.model_copy(update={"name": f"version {k}"})
            write_study(study.model_copy(update={"study": about}), path)

    write(0)
    whole = beside = 0
    for _ in range(KILLS):
        killed(write, float(rng.uniform(0.0, 0.04)))
        beside += len(list(tmp_path.glob("*.part")))
        if kind == "scan":
            off = read_scan(path).force_n - scan.force_n
            whole += bool(np.ptp(off) < 1e-9)
        else:
            whole += load_study(path).study.name.startswith("version ")
    assert whole == KILLS
    if kind == "scan":  # a study is small: a kill seldom falls into its write
        assert beside > 0
