"""A scan that is stopped leaves a folder that can be read up to the last press."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from typer.testing import CliRunner

from models.scan import Scan
from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.recording.integrity import examine, readable
from palpmap.recording.reader import scalar_series

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has other signals")

PRESSES = 3

# A process started in the background of a shell ignores Ctrl-C, and so do its children; a user's
# terminal gives the command the handler that is set here.
COMMAND = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from palpmap.__main__ import main
main()
"""


def stopped_scan(folder: Path, by: signal.Signals) -> subprocess.CompletedProcess[str]:
    """Start a scan of nine presses and stop it once `PRESSES` of them are in scan.csv."""
    words = ["scan", "--presses-per-side", "3", "--seed", "3", "--quiet", "--out", str(folder)]
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 300
    while process.poll() is None and presses_in(folder / "scan.csv") < PRESSES:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(by)
    stdout, stderr = process.communicate(timeout=60)
    return subprocess.CompletedProcess(words, process.returncode, stdout, stderr)


def presses_in(path: Path) -> int:
    if not path.is_file():
        return 0
    return len({line.split(",")[0] for line in path.read_text().splitlines()[1:]})


def deepest_mm(scan: Scan) -> np.ndarray:
    """Mean displacement of each press within 10 % of its largest force."""
    means = []
    for press in scan.press_ids:
        rows = np.isin(scan.phase, ("load", "hold", "unload")) & (scan.press == press)
        near = rows & (scan.force_n >= 0.9 * scan.force_n[rows].max())
        means.append(1e3 * scan.displacement_m[near].mean())
    return np.array(means)


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("killed") / "run"
    return stopped_scan(folder, signal.SIGKILL), folder


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("interrupted") / "run"
    return stopped_scan(folder, signal.SIGINT), folder


def test_a_killed_scan_is_read_up_to_its_last_press(killed):
    done, folder = killed
    assert done.returncode == -signal.SIGKILL
    scan = read_scan(folder / "scan.csv")
    presses = len(scan.press_ids)
    assert PRESSES <= presses < 9
    assert np.bincount(scan.press_index).tolist() == [22] * presses


def test_the_recording_of_a_killed_scan_is_read_up_to_its_last_press(killed, run_review):
    _, folder = killed
    code, said = run_review(folder)
    assert code == 1
    scan = read_scan(folder / "scan.csv")
    # A press goes into scan.csv first; the kill may come between the two.
    assert said["presses"] in (len(scan.press_ids), len(scan.press_ids) - 1)
    assert said["planned_presses"] == 9
    assert not said["closed"]
    assert f"ends after press {said['last_press']}" in said["ending"]
    assert said["layout"]
    path = folder / "recording.rrd"
    with readable(path, examine(path)) as file, pytest.warns(RerunWarning, match="no footer"):
        chunks = list(RrdReader(file).stream())
    series = scalar_series(chunks, "presses/measured_mm", "press")
    assert_allclose(series[:, 1], deepest_mm(scan)[: said["presses"]], rtol=1e-6)


def test_the_folder_of_a_killed_scan_says_that_the_run_did_not_end(killed):
    _, folder = killed
    (entry,) = json.loads((folder / "run.json").read_text())["runs"]
    assert (entry["command"], entry["outcome"], entry["ended"]) == ("scan", "running", None)


def test_ctrl_c_ends_a_scan_with_130_and_one_sentence_that_names_the_folder(interrupted):
    done, folder = interrupted
    assert done.returncode == 130
    (sentence,) = done.stderr.strip().splitlines()
    assert re.fullmatch(r"palpmap: interrupted, .*", sentence)
    assert str(folder) in sentence
    assert done.stdout == ""


def test_the_folder_of_an_interrupted_scan_is_readable(interrupted, run_review):
    _, folder = interrupted
    (entry,) = json.loads((folder / "run.json").read_text())["runs"]
    assert entry["outcome"] == "interrupted"
    assert entry["ended"] >= entry["started"]
    scan = read_scan(folder / "scan.csv")
    code, said = run_review(folder)
    # In order though not all presses: closed, and nothing missing of what a scan records.
    assert (code, said["closed"], said["missing"]) == (0, True, [])
    assert PRESSES <= len(scan.press_ids) < said["planned_presses"] == 9
    assert said["presses"] in (len(scan.press_ids), len(scan.press_ids) - 1)
    checked = CliRunner().invoke(app, ["check", str(folder / "study.toml"), "--json"])
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["presses"] == len(scan.press_ids)


def test_the_recording_of_an_interrupted_scan_tells_of_it(interrupted):
    _, folder = interrupted
    texts = [
        row[0]
        for chunk in RrdReader(folder / "recording.rrd").stream()
        if chunk.entity_path == "/events"
        for row in chunk.to_record_batch().column("TextLog:text").to_pylist()
    ]
    assert any("stopped by KeyboardInterrupt" in text for text in texts)


def test_two_scans_of_one_seed_agree_as_far_as_they_both_got(killed, interrupted):
    first, second = (read_scan(folder / "scan.csv") for _, folder in (killed, interrupted))
    rows = min(len(first), len(second))
    assert rows >= 22 * PRESSES
    for name in ("press", "time_s", "phase", "point_m", "force_n", "displacement_m"):
        one, other = getattr(first, name)[:rows], getattr(second, name)[:rows]
        np.testing.assert_array_equal(one, other)
