"""A viewer that follows a run: it gets what the file gets, and the file outlives it."""

import signal
import socket
import subprocess
import time
from contextlib import contextmanager

import numpy as np
import pytest

from palpmap.recording import viewer as viewers
from palpmap.recording.reader import read_summary
from palpmap.recording.recorder import Recording

VERTICES = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@contextmanager
def listening(received):
    """Rerun's own server, which writes what it receives into a file."""
    with viewers.private_settings() as environment, socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        command = [viewers.viewer_program(), "--save", str(received), "--bind", "127.0.0.1"]
        server = subprocess.Popen(
            [*command, "--port", str(port)],
            env=environment,
            start_new_session=True,
            # A shell's background job, and so its children, would ignore the interrupt of `end`
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        try:
            viewers._wait_for_port(server, port, time.monotonic() + 30)
            yield server, port
        finally:
            viewers._stop(server)


def end(server):
    server.send_signal(signal.SIGINT)
    server.wait(timeout=20)


def press(recording, number):
    recording.press_done(number, 1.0 + number, VERTICES[number], 0.3, 0.002)


def test_a_viewer_gets_what_the_file_gets(tmp_path):
    with listening(tmp_path / "seen.rrd") as (server, port):
        address = viewers.live_viewer(port)
        with Recording(tmp_path / "file.rrd", "a scan", live=address) as recording:
            recording.scene(VERTICES, TRIANGLES)
            for number in range(3):
                press(recording, number)
        end(server)
    kept, seen = (read_summary(tmp_path / name) for name in ("file.rrd", "seen.rrd"))
    assert seen.entities == kept.entities
    assert any(entity.rows for entity in seen.entities.values())


def test_a_recording_outlives_its_viewer(tmp_path):
    with (
        listening(tmp_path / "seen.rrd") as (server, port),
        Recording(tmp_path / "file.rrd", "a scan", live=viewers.live_viewer(port)) as recording,
    ):
        recording.scene(VERTICES, TRIANGLES)
        press(recording, 0)
        viewers._stop(server)
        press(recording, 1)
        press(recording, 2)
    with Recording(tmp_path / "alone.rrd", "a scan") as recording:
        recording.scene(VERTICES, TRIANGLES)
        for number in range(3):
            press(recording, number)
    kept, alone = (read_summary(tmp_path / name) for name in ("file.rrd", "alone.rrd"))
    assert kept.entities == alone.entities


def test_without_viewer_and_display_a_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setattr(viewers, "has_display", lambda: False)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(viewers.ViewerError, match=f"no viewer listens on 127.0.0.1:{port} and"):
        viewers.live_viewer(port)
