"""Whole commands that are killed at any moment, or meet a full disk, leave no half-written file."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from models import read_scan
from palpmap.recording.integrity import examine
from tests.palpmap.importing import raw_scan
from tests.paths import LAB, TWELVE

WRITES = {"import": "study", "join": "both.csv"}  # once; a second run would be refused
KILLS = {"import": 11, "join": 10, "add": 8, "fit": 9, "scan": 8, "explain": 4}  # 50 in all

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="Windows has other signals"),
]


def words_of(command: str, folder: Path) -> list[str]:
    """A cheap command that writes into the folder, and its input there."""
    if command == "import":
        scan = read_scan(LAB / "case_c" / "scan.csv")
        raw_scan.write_mcap(scan.rows(scan.press < 12), folder / "session")
        proposed = subprocess.run(
            [sys.executable, "-m", "palpmap", "import", str(folder / "session"), "--propose"],
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
        rig = proposed[: proposed.index("[probe]")] + raw_scan.RIG
        (folder / "rig.toml").write_text(rig, encoding="utf-8")
        return ["session", "--rig", "rig.toml", "--out", "study"]
    if command == "join":
        scans = [str(LAB / name / "scan.csv") for name in ("case_a", "case_b")]
        return [*scans, "--pause", "60", "--out", "both.csv"]
    if command == "scan":
        return ["--presses", "2", "--force", "0.2", "--seed", "3", "--out", "run"]
    shutil.copytree(TWELVE, folder / "study")
    more = ["contact_offset"] if command == "add" else ["--out", "run"]
    return ["study/study.toml", *more]


def start(command: str, words: list[str], folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "palpmap", command, *words],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def half_written(folder: Path) -> list[str]:
    """Files under a final name that are not whole; a stopped run's recording is one readable."""
    return [
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.is_file() and ".part" not in path.name and path.name != ".lock" and not whole(path)
    ]


def whole(path: Path) -> bool:
    data = path.read_bytes()
    if path.suffix == ".json":
        json.loads(data)
    elif path.suffix == ".toml":
        tomllib.loads(data.decode())
    elif path.suffix == ".csv":
        columns = {line.count(b",") for line in data.splitlines()}
        return data.endswith(b"\n") and len(columns) == 1
    elif path.suffix == ".html":
        return data.rstrip().endswith(b"</html>")
    elif path.suffix == ".png":
        Image.open(path).load()
    elif path.suffix == ".rrd":
        return not data or examine(path).whole_bytes > 0
    elif path.suffix in (".md", ".py"):
        return data.endswith(b"\n")
    return True


@pytest.mark.parametrize("command", KILLS)
def test_a_killed_command_leaves_whole_files_and_runs_again(command, tmp_path):
    rng = np.random.default_rng([9, list(KILLS).index(command)])
    (tmp_path / "first").mkdir()
    words = words_of(command, tmp_path / "first")
    begin = time.monotonic()
    with start(command, words, tmp_path / "first") as process:
        process.communicate(timeout=600)
    assert process.returncode in (0, 1)
    duration = time.monotonic() - begin
    assert half_written(tmp_path / "first") == []

    folder = tmp_path / "killed"
    folder.mkdir()
    words_of(command, folder)
    killed = 0
    for share in rng.uniform(0.2, 1.0, KILLS[command]):  # of the time, the first fifth imports
        with start(command, words, folder) as process:
            try:
                process.wait(share * duration)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                killed += 1
        assert half_written(folder) == []
        if command in WRITES and (folder / WRITES[command]).exists():
            done = folder / WRITES[command]
            if done.is_file():
                done.unlink()
            elif (done / "study.toml").exists():
                assert (done / "scan.csv").exists()
                assert (done / "import.md").exists()
                shutil.rmtree(done)
    assert killed > 0
    with start(command, words, folder) as process:
        said = process.communicate(timeout=600)[1]
    assert process.returncode in (0, 1), said
    assert half_written(folder) == []
    assert not list(folder.rglob("*.part*"))


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
from palpmap.__main__ import app
app(sys.argv[2:])
"""


@pytest.mark.parametrize("limit", [20_000, 200_000])
def test_a_full_disk_ends_a_scan_in_a_sentence_and_its_recording_is_readable(limit, tmp_path):
    words = words_of("scan", tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(limit), "scan", *words],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("palpmap: ") == 1
    assert half_written(tmp_path) == []
    assert not list(tmp_path.rglob("*.part*"))
