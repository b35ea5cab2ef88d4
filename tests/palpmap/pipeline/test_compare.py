"""`palpmap compare` on the demo's run, and on the same run with a fault laid into its readings."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from identify.fit.files import read_fit, write_fit
from models.scan_file import read_scan, write_scan
from palpmap.run_folder import sha256


@pytest.fixture(scope="module")
def compared(demo, run_here, tmp_path_factory):
    """A comparison of the demo's run, into a folder of its own."""
    return run_here("compare", demo.folder, folder=tmp_path_factory.mktemp("compared"))


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


@pytest.mark.slow
def test_the_demos_residual_is_noise_and_the_exit_code_says_so(compared):
    assert compared.record["is_noise"]
    assert compared.exit_code == 0, compared.stderr


def test_the_run_compared_again_gives_the_demos_own_comparison(compared, demo):
    first = json.loads((demo.folder / "comparison.json").read_text())
    again = json.loads((compared.folder / "comparison.json").read_text())
    assert again == first
    assert {key: compared.record[key] for key in first} == first


def test_report_and_figures_are_written_beside_it(compared):
    page = (compared.folder / "report.html").read_text()
    assert compared.record["statement"] in page
    figures = {path.name for path in (compared.folder / "figures").iterdir()}
    assert {"map.png", "residual_place.png", "residual_along.png", "presses.png"} <= figures


def test_run_json_holds_the_hashes_of_what_was_compared(compared, demo):
    (entry,) = json.loads((compared.folder / "run.json").read_text())["runs"]
    assert (entry["command"], entry["outcome"]) == ("compare", "done")
    assert entry["inputs"] == {
        str(demo.folder / name): sha256(demo.folder / name) for name in ("fit.json", "study.toml")
    }


def test_a_drift_is_found_with_exit_code_1(drifting):
    assert drifting.exit_code == 1, drifting.stderr
    said = drifting.record
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
