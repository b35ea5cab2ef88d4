"""`palpmap compare` on the demo's run, and on the same run with a fault laid into its readings."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from identify.fit.files import read_fit, write_fit
from models.scan_file import read_scan, write_scan
from palpmap.__main__ import app
from palpmap.run_folder import sha256


@pytest.fixture(scope="module")
def compared(demo, tmp_path_factory):
    """What the command said of the demo's run, and its folder, another one."""
    folder = tmp_path_factory.mktemp("compared")
    return CliRunner().invoke(app, ["compare", str(demo.folder), "--out", str(folder)]), folder


@pytest.fixture(scope="module")
def drifting(demo, run_here, tmp_path_factory):
    """The demo's run with a drift of the displacement over the whole scan, compared in place."""
    folder = tmp_path_factory.mktemp("drifting") / "run"
    shutil.copytree(demo.folder, folder)
    scan, fit = read_scan(folder / "scan.csv"), read_fit(folder / "fit.json")
    drift = 3e-4 * (scan.time_s / scan.time_s[-1] - 0.5)
    write_scan(scan.replace(displacement_m=scan.displacement_m + drift), folder / "scan.csv")
    study = (folder / "study.toml").read_text()
    (folder / "study.toml").write_text(study.replace(str(demo.folder), str(folder)))
    write_fit(
        replace(fit, displacement_m=fit.displacement_m + drift, residual_m=fit.residual_m + drift),
        folder / "fit.json",
    )
    return run_here("compare", folder, folder=folder)


def test_the_terminal_shows_the_truth_beside_the_found_map(compared):
    done, _ = compared
    assert done.exit_code == 0, done.output  # the residual is noise
    table = done.stdout.splitlines()
    assert any(re.search(r"Found +95 % interval +True +Off", line) for line in table)
    (background,) = (line for line in table if line.lstrip().startswith("background"))
    assert re.search(r" 6(\.0+)? kPa +[+-]?\d\.\d s\.e\.", background)


def test_the_run_compared_again_gives_the_demos_own_comparison(compared, demo):
    folders = demo.folder, compared[1]
    first, again = (json.loads((f / "comparison.json").read_text()) for f in folders)
    assert again == first
    assert again["is_noise"]


def test_report_and_figures_are_written_beside_it(compared):
    _, folder = compared
    statement = json.loads((folder / "comparison.json").read_text())["statement"]
    assert statement in (folder / "report.html").read_text()
    figures = {path.name for path in (folder / "figures").iterdir()}
    assert {"map.png", "residual_place.png", "residual_along.png", "presses.png"} <= figures


def test_run_json_holds_the_hashes_of_what_was_compared(compared, demo):
    (entry,) = json.loads((compared[1] / "run.json").read_text())["runs"]
    assert (entry["command"], entry["outcome"]) == ("compare", "done")
    assert entry["inputs"] == {
        str(demo.folder / name): sha256(demo.folder / name) for name in ("fit.json", "study.toml")
    }


def test_a_drift_is_found_with_exit_code_1(drifting):
    assert drifting.exit_code == 1, drifting.stderr
    said = drifting.record
    kept = json.loads((drifting.folder / "comparison.json").read_text())
    assert {key: said[key] for key in kept} == kept
    assert not said["is_noise"]
    assert said["chi2_per_dof"] > 1.5
    # 0.3 mm from end to end adds its own rms, 87 um.
    assert said["rms_m"] == pytest.approx(np.hypot(said["expected_rms_m"], 8.7e-5), rel=0.1)


def test_a_drift_is_named_as_what_the_residual_varies_with(drifting):
    said = drifting.record
    assert said["varies_with"] in {"time", "order"} | {
        name for name in said["confused_with"] if name in {"time", "order"}
    }


def test_a_comparison_in_place_is_added_to_the_run(drifting):
    runs = json.loads((drifting.folder / "run.json").read_text())["runs"]
    assert [entry["command"] for entry in runs] == ["demo", "compare"]
