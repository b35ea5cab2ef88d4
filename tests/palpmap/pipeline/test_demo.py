"""The demo as a user runs it: what it promises, what it says, what it leaves behind."""

import json
import re
from html import unescape

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.run_folder import sha256
from palpmap.study.study import load_study
from tests.palpmap.pipeline.truths import TOLERANCES, deviation, true_values


@pytest.fixture(scope="module")
def truth(demo) -> dict[str, float]:
    return true_values(demo.folder)


def test_the_demo_passes(demo):
    assert demo.exit_code == 0, demo.stderr
    assert demo.record["passed"]
    assert demo.record["success"]


def test_every_press_keeps_force_place_and_coupling(demo):
    scan = demo.record["scan"]
    assert (scan["presses"], scan["presses_kept"]) == (81, 81)
    assert scan["largest"]["force_error"] < 0.01
    assert scan["largest"]["overshoot"] < 0.05
    assert scan["largest"]["contact_error_m"] < 2e-4
    assert scan["largest"]["coupling_error"] < 1e-3


@pytest.mark.parametrize("name", TOLERANCES)
def test_each_parameter_is_found_within_its_tolerance(demo, truth, name):
    found = demo.record["parameters"][name]["value"]
    off = deviation(name, found, truth[name])
    assert abs(off) <= TOLERANCES[name]
    # The demo's own verdict rests on the same figures.
    said = demo.record["deviations"][name]
    assert said["deviation"] == pytest.approx(off, rel=1e-9)
    assert said["tolerance"] == TOLERANCES[name]


@pytest.mark.parametrize("name", TOLERANCES)
def test_the_truth_lies_inside_the_95_percent_interval(demo, truth, name):
    estimate = demo.record["parameters"][name]
    assert estimate["lower95"] <= truth[name] <= estimate["upper95"]
    # An interval that holds everything says nothing.
    assert estimate["upper95"] - estimate["lower95"] < 0.6 * estimate["value"]


def test_the_residual_is_noise(demo):
    said = json.loads((demo.folder / "comparison.json").read_text())
    assert said["is_noise"]
    assert said["readings"] == 81 * 22
    # Five standard deviations of chi-square per degree of freedom.
    assert said["chi2_per_dof"] == pytest.approx(1, abs=5 * np.sqrt(2 / said["dof"]))
    assert said["rms_m"] == pytest.approx(said["expected_rms_m"], rel=0.1)
    assert said["statement"] == demo.record["residual"]
    assert said["statement"].startswith("The residual is noise")


def test_the_demo_keeps_to_its_memory_and_its_scan_outruns_real_time(demo):
    assert demo.peak_bytes < 1.85e9
    scan = demo.record["scan"]
    # 20 is promised on a core that is free; others may be at work here.
    assert scan["real_time_factor"] > 8
    assert scan["real_time_factor"] == pytest.approx(scan["simulated_s"] / scan["wall_s"])
    assert scan["simulated_s"] > 81 * 4.0  # ramp, hold and unloading of each press


def test_the_time_of_each_stage_is_told(demo):
    seconds = demo.record["seconds"]
    assert list(seconds) == [
        "solving the body",
        "scanning",
        "building the model",
        "fitting the map",
        "comparing and drawing",
    ]
    assert all(0 < s < 600 for s in seconds.values())
    assert seconds["scanning"] >= demo.record["scan"]["wall_s"]
    page = (demo.folder / "report.html").read_text()
    for stage in list(seconds)[:-1]:
        assert stage in page


def test_progress_and_nothing_else_is_on_stderr(demo):
    lines = demo.stderr.splitlines()
    told = re.compile(r" *\d+\.\d s +\d+ %  [a-z ]+( \(about \d+ (s|min) left\))?")
    assert [line for line in lines if not told.fullmatch(line)] == []
    words = [line.split("%  ")[1].split(" (")[0] for line in lines]
    assert list(dict.fromkeys(words)) == [*demo.record["seconds"], "done"]


def test_the_report_stands_alone_and_names_what_was_found(demo):
    page = (demo.folder / "report.html").read_text()
    sources = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]*)""", page)
    assert len(sources) >= 6
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not re.search(r"https?:|<script|<link|@import|url\(", page)
    text = unescape(re.sub(r"<[^>]*>", " ", re.sub(r"data:[^\"]*", "", page)))
    for name, found in demo.record["parameters"].items():
        factor, unit = (1e-3, "kPa") if name.endswith("_pa") else (1e3, "mm")
        size, power = f"{factor * found['std']:.2e}".split("e")
        places = max(0, (float(size) < 3.55) - int(power))
        assert f"{factor * found['value']:.{places}f} {unit}" in text, name
    assert demo.record["residual"] in text


def test_fit_json_says_what_the_command_said(demo):
    kept = json.loads((demo.folder / "fit.json").read_text())
    assert kept["parameters"] == demo.record["parameters"]
    assert len(kept["compliance_m_per_n"]) == 81
    assert len(kept["residual_m"]) == 81 * 22


def test_run_json_says_how_the_run_was_made(demo):
    (entry,) = json.loads((demo.folder / "run.json").read_text())["runs"]
    assert (entry["command"], entry["seed"], entry["outcome"]) == ("demo", 2, "done")
    assert entry["settings"]["force_n"] == demo.record["scan"]["force_n"]
    assert entry["versions"]["mujoco"].startswith("4.")
    assert "not installed" not in {entry["versions"][p] for p in ("numpy", "pin", "rerun-sdk")}
    assert entry["ended"] > entry["started"]


def test_check_accepts_the_scan_and_study_that_the_demo_wrote(demo):
    result = CliRunner().invoke(app, ["check", str(demo.folder / "study.toml"), "--json"])
    assert result.exit_code == 0, result.output
    checked = json.loads(result.stdout)
    assert checked["presses"] == 81
    assert checked["samples"] == {"load": 648, "hold": 648, "unload": 486}
    assert checked["sha256"]["scan"] == sha256(demo.folder / "scan.csv")
    assert checked["noise"] == {
        "displacement_m": 2e-5,
        "force_n": 5e-3,
        "touch_m": None,
        "lag_s": None,
    }
    assert checked["placement"]["largest_distance_m"] < 5e-4


def test_the_scan_is_a_9_by_9_grid_from_12_to_84_mm(demo):
    study = load_study(demo.folder / "study.toml")
    scan = read_scan(study.scan)
    grid = np.linspace(0.012, 0.084, 9)
    planned = {(round(x, 3), round(y, 3)) for x in grid for y in grid}
    points = scan.contact_points
    assert {(round(x, 3), round(y, 3)) for x, y in points[:, :2]} == planned
    nearest = np.abs(points[:, :2, None] - grid).min(axis=2)
    assert nearest.max() < 2e-4
    held = scan.force_n[scan.phase == "hold"]
    assert held.mean() == pytest.approx(demo.record["scan"]["force_n"], rel=0.002)
    assert held.std() == pytest.approx(5e-3, rel=0.1)
    assert_allclose(scan.contact_directions, np.tile([0.0, 0.0, -1.0], (81, 1)), atol=1e-3)
