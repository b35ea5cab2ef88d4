"""The Rerun viewer as a process: in a window, or headless for a picture."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from models import InputError
from palpmap.recording.entities import PRESS, SIM_TIME

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

PICTURE_SIZE = (1800, 1100)
LIVE_PORT = 9876
_HOST = "127.0.0.1"
_LAST_WORDS_S = 3.0
_PAUSE_S = 0.7  # between looks at a picture that still moves
_DRAWS = "wgpu adapter backend"  # it says so once it has found a driver
INSTALL_DRIVER = (
    "rendering a recording needs a Vulkan driver, and none works here; on Debian or Ubuntu: "
    "apt-get install --no-install-recommends mesa-vulkan-drivers libvulkan1 "
    "(on Fedora: dnf install mesa-vulkan-drivers vulkan-loader), then run the command again"
)


class ViewerError(RuntimeError):
    """The viewer could not do its work; the message says why, and the remedy."""


def viewer_program() -> str:
    """Path of the `rerun` program that belongs to this Python."""
    beside = Path(sysconfig.get_path("scripts")) / ("rerun.exe" if os.name == "nt" else "rerun")
    program = str(beside) if beside.exists() else shutil.which("rerun")
    if program is None:
        raise InputError("the program 'rerun' is not installed; run: pip install rerun-sdk")
    return program


def has_display() -> bool:
    """Return True if a window can be opened."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_window(recording: Path) -> int:
    """Show a recording until the window is closed, and return the exit code of the viewer."""
    with private_settings() as environment:
        command = [viewer_program(), str(recording), "--bind", _HOST, "--port", "auto"]
        return subprocess.run(command, env=environment, check=False).returncode


def live_viewer(port: int = LIVE_PORT, time_limit_s: float = 30.0) -> str:
    """Return the address of a viewer that listens on this machine; without one open a window.

    Raises
    ------
    ViewerError
        There is none, and no window can be opened.
    """
    address = f"rerun+http://{_HOST}:{port}/proxy"
    if _listens(port):
        return address
    if not has_display():
        raise ViewerError(
            f"no viewer listens on {_HOST}:{port} and there is no display for a window; run "
            f"`rerun` on the machine with the display and forward the port to it (ssh -R "
            f"{port}:localhost:{port}), or look at the recording afterwards"
        )
    with private_settings() as environment:
        command = [viewer_program(), "--bind", _HOST, "--port", str(port), "--hide-welcome-screen"]
        quiet = subprocess.DEVNULL
        viewer = subprocess.Popen(
            command, env=environment, stdout=quiet, stderr=quiet, start_new_session=True
        )
        _wait_for_port(viewer, port, time.monotonic() + time_limit_s)
    return address


@dataclass(frozen=True)
class Instant:
    """A place on a recording's timelines: a time of the scan in s, or a press."""

    time_s: float | None = None
    press: int | None = None


def render(
    recording: Path, picture: Path, at: Instant | None = None, time_limit_s: float = 90.0
) -> None:
    """Render the layout of a recording into a PNG file.

    Parameters
    ----------
    at : what is shown; None is the end of the run

    Raises
    ------
    ViewerError
        If there is no Vulkan driver, or the viewer does not finish in time.
    """
    deadline = time.monotonic() + time_limit_s
    with private_settings() as environment, tempfile.TemporaryFile() as words:
        port = _free_port()
        command = [viewer_program(), "--headless", "--hide-welcome-screen", "--bind", _HOST]
        command += ["--port", str(port), "--window-size", "{}x{}".format(*PICTURE_SIZE)]
        viewer = subprocess.Popen(
            command, env=environment, stdout=words, stderr=words, start_new_session=True
        )
        try:
            _wait_for_port(viewer, port, deadline)
            picture.write_bytes(_picture(recording, port, deadline, at))
        except (RuntimeError, ConnectionError) as error:
            with suppress(subprocess.TimeoutExpired):
                viewer.wait(timeout=_LAST_WORDS_S)  # the port answers until it has panicked
            words.seek(0)
            reason = _reason(viewer, words.read().decode(errors="replace"), error)
            raise ViewerError(reason) from error
        finally:
            _stop(viewer)


def _picture(recording: Path, port: int, deadline: float, at: Instant | None) -> bytes:
    from rerun.experimental import ViewerClient

    client = ViewerClient.connect(f"rerun+http://{_HOST}:{port}/proxy")
    client.open(str(recording.resolve()))
    _wait_for_views(client, deadline)
    if at is not None and at.time_s is not None:
        client.set_time(SIM_TIME, duration=at.time_s, play_state="paused")
    elif at is not None and at.press is not None:
        client.set_time(PRESS, sequence=at.press, play_state="paused")
    before, now = b"", b"not yet"
    while now != before and time.monotonic() < deadline:  # plots glide to their ranges
        time.sleep(_PAUSE_S)
        before, now = now, client.take_screenshot(max_size=max(PICTURE_SIZE) // 2)
    return client.take_screenshot()


def _wait_for_views(client: "ViewerClient", deadline: float) -> None:
    """Wait until the recording is loaded and its layout is on screen."""
    while time.monotonic() < deadline:
        state = client.get_state()
        if state.recordings and state.views and not state.loading:
            return
        time.sleep(0.2)
    raise ViewerError("the viewer did not load the recording in time; try again, or open it")


def _wait_for_port(viewer: subprocess.Popen[bytes], port: int, deadline: float) -> None:
    while time.monotonic() < deadline:
        if viewer.poll() is not None:
            raise ViewerError(f"the viewer stopped with exit code {viewer.returncode}")
        if _listens(port):
            return
        time.sleep(0.1)
    raise ViewerError("the viewer did not start in time; try again on an idle machine")


def _listens(port: int) -> bool:
    try:
        socket.create_connection((_HOST, port), timeout=1).close()
    except OSError:
        return False
    return True


def _reason(viewer: subprocess.Popen[bytes], words: str, error: Exception) -> str:
    """Say in a sentence why the viewer failed; if it found no graphics, there is no driver."""
    graphics = any(sign in words for sign in ("graphics adapter", "render context", "wgpu"))
    if graphics and _DRAWS not in words and viewer.poll() is not None:
        return INSTALL_DRIVER
    panic = re.search(r"panicked at '?(.+)", words)
    why = panic.group(1) if panic else str(error).splitlines()[0]
    return f"the viewer could not render the recording: {why.rstrip(chr(39))}"


def _stop(viewer: subprocess.Popen[bytes]) -> None:
    """End the viewer and its children: the `rerun` script runs the real program as a child."""
    if os.name == "posix":
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, signal.SIGKILL)
    else:
        subprocess.run(["taskkill", "/T", "/F", "/PID", str(viewer.pid)], check=False)
    viewer.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_HOST, 0))
        return probe.getsockname()[1]


@contextmanager
def private_settings() -> Iterator[dict[str, str]]:
    """Environment in which the viewer sends no usage data and leaves the user's home alone."""
    with tempfile.TemporaryDirectory(prefix="palpmap-viewer-") as folder:
        home = Path(folder)
        settings = json.dumps(
            {
                "analytics_enabled": False,
                "analytics_id": "",
                "metadata": {},
                "config_file_path": str(home / "rerun" / "analytics.json"),
                "data_dir_path": str(home / "rerun" / "analytics"),
            }
        )
        places = [home / "rerun"]
        if sys.platform == "darwin":
            places = [home / "Library" / "Application Support" / "rerun"]
        for place in places:
            place.mkdir(parents=True)
            (place / "analytics.json").write_text(settings)
        private = {"TELEMETRY_ENABLED": "false"}
        match sys.platform:
            case "darwin":
                private["HOME"] = folder
            case "win32":
                private |= {"APPDATA": folder}
            case _:
                private |= {"XDG_CONFIG_HOME": folder, "XDG_DATA_HOME": folder}
                if "XDG_RUNTIME_DIR" not in os.environ:
                    private["XDG_RUNTIME_DIR"] = folder
        yield os.environ | private
