"""A recording that ended badly is read as far as it goes, or refused in one sentence."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from numpy.testing import assert_allclose
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from models.errors import InputError
from palpmap.recording.integrity import examine, readable
from palpmap.recording.reader import read_summary, scalar_series
from palpmap.recording.recorder import Recording

VERTICES = np.array([[0, 0, 0], [0.09, 0, 0], [0, 0.06, 0], [0.01, 0.02, 0.04]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
PARTS = ("body", "presses", "events", "about")

KILLED = textwrap.dedent(
    """
    import os, signal, sys
    import numpy as np
    from palpmap.recording.recorder import Recording
    from palpmap.recording.frames import Frame
    from palpmap.recording.scene import LinkShape

    def frame(time, force):
        return Frame(time, np.eye(1, 7, 3), force, 1e-3 * force, np.zeros(3), np.zeros(3))

    recording = Recording(sys.argv[1], "killed", planned_presses=5)
    vertices = [[0, 0, 0], [0.09, 0, 0], [0, 0.06, 0], [0.01, 0.02, 0.04]]
    links = [LinkShape("arm", "sphere", (0.1, 0, 0), (0, 0, 0))]
    recording.scene(vertices, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], links=links)
    for press in range(3):
        for k in range(50):
            recording.frame(frame(press + 0.02 * k, 0.1 * k))
        recording.press_done(press, press + 0.9, (0, 0, 0.04), 0.3, 1e-3 * (press + 1))
    for k in range(20):
        recording.frame(frame(3 + 0.02 * k, 0.1 * k))
    os.kill(os.getpid(), signal.SIGKILL)
    """
)


@pytest.fixture
def recorded(tmp_path):
    """A closed recording of four presses."""
    path = tmp_path / "recording.rrd"
    with Recording(path, "four presses", seed=3, planned_presses=4, parts=PARTS) as recording:
        recording.scene(VERTICES, TRIANGLES)
        for press in range(4):
            recording.press_done(press, 2.0 * press, VERTICES[3], 0.3, 1e-3 * (press + 1))
    return path


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_a_killed_run_is_read_up_to_its_last_press(tmp_path):
    path = tmp_path / "recording.rrd"
    done = subprocess.run([sys.executable, "-c", KILLED, str(path)], timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL
    found = read_summary(path)
    assert not found.closed
    assert not found.whole
    assert (found.presses, found.last_press) == (3, 2)
    assert "ends after press 2, 3 of 5 presses" in found.ending()
    assert {"truth", "fit", "comparison"} <= set(found.missing)
    assert found.layout
    with readable(path, examine(path)) as file, pytest.warns(RerunWarning, match="no footer"):
        chunks = list(RrdReader(file).stream())
    measured = scalar_series(chunks, "presses/measured_mm", "press")
    assert_allclose(measured, [[0, 1], [1, 2], [2, 3]])
    assert len(scalar_series(chunks, "scan/force_n", "sim_time")) == 150


def test_a_whole_recording_says_so_with_its_spans_and_last_values(recorded):
    found = read_summary(recorded)
    assert found.whole
    assert found.ending() == "closed, 4 of 4 presses"
    assert (found.name, found.seed, found.missing) == ("four presses", 3, ())
    assert found.spans["sim_time"] == (0.0, 6.0)
    assert found.spans["press"] == (0, 3)
    assert found.last_values == {"presses/measured_mm": 4.0}
    assert found.entities["presses/measured_mm"].rows == 4
    assert found.bytes == recorded.stat().st_size


def test_parts_that_the_run_should_have_but_has_not_are_named(tmp_path):
    path = tmp_path / "recording.rrd"
    with Recording(path, "no fit", parts=("body", "presses", "fit", "truth")) as recording:
        recording.scene(VERTICES, TRIANGLES)
    assert read_summary(path).missing == ("presses", "fit", "truth")


def test_a_recording_cut_off_anywhere_is_read_as_far_as_it_is_whole(recorded):
    whole = recorded.read_bytes()
    presses = []
    for share in (0.4, 0.6, 0.8, 0.9):
        recorded.write_bytes(whole[: int(share * len(whole))])
        found = read_summary(recorded)
        assert not found.closed
        assert "cut off" in found.ending()
        presses.append(found.presses)
    assert presses == sorted(presses)
    assert 0 < presses[-1] <= 4


def test_what_cannot_be_read_is_refused_in_one_sentence(recorded, tmp_path):
    whole = recorded.read_bytes()
    middle = len(whole) // 2
    foreign = tmp_path / "foreign.rrd"
    stream = rr.RecordingStream("somebody_else")
    stream.save(foreign)
    stream.log("x", rr.Scalars(1.0))
    stream.disconnect()
    for content, sentence in (
        (b"", "is empty"),
        (b"press,force_n\n0,0.3\n", r"not a Rerun recording.*b'pres'"),
        (whole[:8], "cut off after 8 bytes"),
        (whole[:40], "cut off after 40 bytes"),
        (foreign.read_bytes(), "of somebody_else, not of palpmap"),
        (_scrambled(whole, middle), "is damaged"),
    ):
        recorded.write_bytes(content)
        with pytest.raises(InputError, match=sentence) as refused:
            read_summary(recorded)
        assert str(recorded) in str(refused.value)


def _scrambled(content: bytes, start: int) -> bytes:
    """Overwrite 300 bytes with zeros."""
    return content[:start] + bytes(300) + content[start + 300 :]


def test_an_error_in_the_run_is_in_the_log_of_a_closed_recording(tmp_path):
    path = tmp_path / "recording.rrd"

    def stopped_run():
        with Recording(path, "stopped") as recording:
            recording.scene(VERTICES, TRIANGLES)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped_run()
    assert examine(path).closed
    texts = [
        chunk.to_record_batch().column("TextLog:text").to_pylist()
        for chunk in RrdReader(path).stream()
        if chunk.entity_path == "/events"
    ]
    assert any("stopped by KeyboardInterrupt" in row[0] for rows in texts for row in rows)


@pytest.mark.slow
def test_recording_leaves_the_home_of_the_user_alone(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    places = {"HOME": str(home), "XDG_CONFIG_HOME": str(home), "XDG_DATA_HOME": str(home)}
    script = KILLED.replace("os.kill(os.getpid(), signal.SIGKILL)", "recording.close()")
    subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "r.rrd")],
        env={**os.environ, **places},
        timeout=120,
        check=True,
    )
    assert not [p for p in Path(home).rglob("*") if "rerun" in p.name.lower()]
