"""A body given by its closed surface goes through check, fit and compare, and its map is found."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpmap.__main__ import app
from tests.paths import ROOT

ORGAN = ROOT / "examples" / "organ"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run folder of the example's fit, with the truth beside it."""
    here = shutil.copytree(ORGAN, tmp_path_factory.mktemp("organ") / "example")
    folder = here.with_name("run")
    result = CliRunner().invoke(
        app, ["fit", str(here / "study.toml"), "--out", str(folder), "--json"]
    )
    assert result.exit_code == 0, result.output
    shutil.copy(ORGAN / "truth.json", folder)
    return folder


def test_the_example_can_be_used():
    result = CliRunner().invoke(app, ["check", str(ORGAN / "study.toml"), "--json"])
    assert result.exit_code == 0
    record = json.loads(result.stdout)
    assert record["presses"] == 35
    assert record["placement"]["largest_distance_m"] < 1e-6


@pytest.mark.slow
def test_the_hidden_inclusion_of_the_organ_is_found(run):
    parameters = json.loads((run / "fit.json").read_text())["parameters"]
    truth = json.loads((run / "truth.json").read_text())["body"]
    wanted = {"background_pa": truth["background_pa"]}
    wanted |= {f"inclusion_1.{k}": v for k, v in truth["inclusions"][0].items()}
    bounds = {
        "background_pa": 120, "inclusion_1.weight_pa": 5400, "inclusion_1.x_m": 7e-4,
        "inclusion_1.y_m": 7e-4, "inclusion_1.z_m": 3e-3, "inclusion_1.radius_m": 8e-4,
    }  # fmt: skip
    for name, bound in bounds.items():
        estimate = parameters[name]
        assert abs(estimate["value"] - wanted[name]) < min(bound, 3.5 * estimate["std"]), name


@pytest.mark.slow
def test_what_the_organ_leaves_unexplained_is_noise_and_its_report_shows_the_truth(run):
    result = CliRunner().invoke(app, ["compare", str(run), "--json"])
    assert result.exit_code == 0, result.output
    assert 0.7 < json.loads(result.stdout)["chi2_per_dof"] < 1.3
    report = (run / "report.html").read_text(encoding="utf-8")
    assert "18 kPa" in report
    assert "s height." in report
