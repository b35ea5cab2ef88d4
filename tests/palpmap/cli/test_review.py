"""`palpmap review`: what it finds, prints, renders and refuses."""

import json
import subprocess
import sys

import numpy as np
import pytest

from models.errors import InputError
from palpmap.commands.review import find_recording, run_review
from palpmap.console import Output
from palpmap.recording import viewer as rerun_viewer
from palpmap.recording.recorder import Recording

VERTICES = np.array([[0, 0, 0], [0.09, 0, 0], [0, 0.06, 0], [0.01, 0.02, 0.04]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
PARTS = ("body", "presses", "events", "about")


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "a run"
    folder.mkdir()
    path = folder / "recording.rrd"
    with Recording(path, "two presses", planned_presses=2, parts=PARTS) as recording:
        recording.scene(VERTICES, TRIANGLES)
        for press in range(2):
            recording.press_done(press, 2.0 * press, VERTICES[3], 0.3, 1e-3 * (press + 1))
    return folder


def review(run, png=False, summary=False, **speech):
    return run_review(run=run, png=png, summary=summary, output=Output(**speech))


def test_a_run_folder_and_its_recording_are_the_same_to_review(run):
    assert find_recording(run) == find_recording(run / "recording.rrd") == run / "recording.rrd"


def test_a_missing_run_and_a_folder_without_recording_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"there is no .*nowhere; give a run folder"):
        review(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no recording\.rrd in"):
        review(tmp_path, summary=True)


def test_a_press_or_a_time_beyond_the_recording_is_refused(run):
    for at, said in (
        (rerun_viewer.Instant(press=2), "--press: found 2, expected 0 to 1, as"),
        (rerun_viewer.Instant(time_s=1e9), r"--time: found 1e\+09 s, expected 0 to 2 s, as"),
    ):
        with pytest.raises(InputError, match=said):
            run_review(run=run, png=True, summary=False, output=Output(), at=at)


def test_the_summary_as_json_is_one_object_with_the_numbers(run, capsys):
    assert review(run, summary=True, json=True)
    record = json.loads(capsys.readouterr().out)
    assert record["schema"] == 1
    assert record["whole"] is True
    assert (record["presses"], record["planned_presses"], record["last_press"]) == (2, 2, 1)
    assert record["last_values"] == {"presses/measured_mm": 2.0}
    assert record["entities"]["presses/measured_mm"]["rows"] == 2


def test_the_summary_for_people_says_how_the_recording_ends(run, capsys):
    assert review(run, summary=True)
    said = capsys.readouterr().out
    assert "closed, 2 of 2 presses" in said
    assert "missing: nothing" in said
    assert "presses/measured_mm" in said


def test_the_summary_of_a_cut_recording_fails_and_says_where_it_ends(run, capsys):
    path = run / "recording.rrd"
    path.write_bytes(path.read_bytes()[:-2000])
    assert not review(run, summary=True, json=True)
    printed = capsys.readouterr()
    assert json.loads(printed.out)["closed"] is False
    assert "not closed" in printed.err


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="has a display elsewhere")
def test_without_a_display_the_command_to_use_elsewhere_is_printed(run, capsys, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert review(run)
    said = " ".join(capsys.readouterr().out.split())
    assert "no display here" in said
    assert "--png" in said


def test_where_no_graphics_driver_works_the_package_to_install_is_named(run, capsys, monkeypatch):
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nonexistent.json")
    assert not review(run, png=True)
    said = capsys.readouterr().err
    assert "mesa-vulkan-drivers" in said
    assert "panic" not in said
    assert not (run / "recording.png").exists()


@pytest.mark.slow
def test_the_layout_is_rendered_to_a_picture(run, capsys):
    if not review(run, png=True, json=True):
        pytest.skip("no Vulkan driver here: " + capsys.readouterr().err)
    from matplotlib.image import imread

    picture = imread(json.loads(capsys.readouterr().out)["picture"])
    assert picture.shape[:2] == rerun_viewer.PICTURE_SIZE[::-1]
    assert picture[..., :3].std() > 0.02  # something is drawn


def test_the_viewer_is_started_without_usage_data_and_away_from_the_home():
    with rerun_viewer.private_settings() as environment:
        said = subprocess.run(
            [rerun_viewer.viewer_program(), "analytics", "config"],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
    assert json.loads(said.stdout)["analytics_enabled"] is False
