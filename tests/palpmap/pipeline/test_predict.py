"""`palpmap predict`: the same body pressed again, a harder one, another body's study."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import palpmap as pm
from models import InputError
from palpmap.__main__ import app
from palpmap.prediction_results import PredictionRecord
from palpmap.report.prediction_report import worst_table
from palpmap.schemas import schemas
from tests.paths import TWELVE


def study(folder: Path, share: float = 1.0, **changes: str) -> Path:
    """Another session on the twelve presses' body: the travel times a share."""
    scan = pm.read_scan(TWELVE / "scan.csv")
    kept = scan.rows(scan.press_index % 2 == 0)
    folder.mkdir(exist_ok=True)
    pm.write_scan(kept.replace(displacement_m=share * kept.displacement_m), folder / "scan.csv")
    text = (TWELVE / "study.toml").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def run(*words: object, code: int):
    done = CliRunner().invoke(app, ["predict", *map(str, words)])
    assert done.exit_code == code, done.output
    return done


def test_a_softer_body_fails_with_exit_code_1_and_a_report_that_says_so(tmp_path):
    other, out = study(tmp_path / "other", share=1.25), tmp_path / "run"
    record = json.loads(run(TWELVE, other, "--out", out, "--json", code=1).stdout)
    assert record["verdict"] == "too narrow"
    assert record["force_error_median"] == pytest.approx(0.25, abs=0.04)
    written = PredictionRecord.read(out / "prediction.json")
    assert written.chi2_per_press == record["chi2_per_press"] > 1
    assert written.p_value < 0.01
    assert len(written.presses) == 6
    assert set(schemas()["prediction"]["required"]) <= set(record)
    table = np.loadtxt(out / "prediction.csv", delimiter=",", skiprows=1)
    assert table.shape[1] == 6
    page = (out / "report.html").read_text()
    assert "The errors exceed the bands" in page
    assert 0 < page.index("<img") < page.index("What the bands hold")
    assert (out / "prediction.png").stat().st_size > 20_000


@pytest.mark.parametrize(("width", "verdict"), [(1.0, "calibrated"), (10.0, "too wide")])
def test_bands_ten_times_the_errors_are_a_cautious_prediction_and_no_calibrated_one(width, verdict):
    """Errors of the presses' own noise, in bands that are mostly one error of all presses."""
    fit = pm.read_run(TWELVE).fit
    found = pm.predict(fit, fit.experiment)
    error_m = np.where(np.arange(found.presses) % 2, 1e-5, -1e-5)
    sd_m = np.full(found.presses, 1e-5 * width)
    wide = replace(found, press_error_m=error_m, press_sd_m=sd_m, chi2=float(found.presses))
    assert (wide.verdict, wide.holds) == (verdict, True)
    assert ("too wide, 10 times what these errors ask for" in wide.statement) == (width > 1)
    assert wide.record.band_over_error == pytest.approx(width)


def test_the_same_body_holds_from_python_and_shows_itself(tmp_path):
    other = pm.read_study(study(tmp_path / "other"))
    found = pm.predict(pm.read_run(TWELVE).fit, other)
    assert found.holds
    assert found.to_dict()["verdict"] in ("calibrated", "too wide")
    assert "6 of 6 presses lie in their 95 % bands" in found.summary()
    heads = [column.heading for column in worst_table(found, np.zeros(3)).columns]
    assert "Measured less predicted travel" in heads  # and not the error of a force
    folder = found.write(tmp_path / "run")
    assert {"report.html", "prediction.json", "run.json"} <= {p.name for p in folder.iterdir()}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "poisson_ratio = 0.45",
            "poisson_ratio = 0.3",
            r"body.poisson_ratio = 0.3, the fitted one",
        ),
        ('tip = "flat"', 'tip = "sphere"', r'probe.tip = "sphere", the fitted one "flat"'),
        ('support = "base-bonded"', 'support = "base-sliding"', "body.support"),
    ],
)
def test_a_study_of_another_body_is_refused(tmp_path, old, new, said):
    other = pm.read_study(study(tmp_path / "other", **{old: new}))
    with pytest.raises(InputError, match=said):
        pm.predict(pm.read_run(TWELVE).fit, other)


def test_a_folder_without_a_fit_is_refused(tmp_path):
    shutil.copy(TWELVE / "study.toml", tmp_path / "study.toml")
    assert "found no fit.json" in run(tmp_path, TWELVE / "study.toml", code=2).stderr


def test_two_runs_are_compared_with_a_report(tmp_path):
    again = shutil.copytree(TWELVE, tmp_path / "again")
    done = CliRunner().invoke(
        app, ["compare", str(TWELVE), str(again), "--out", str(tmp_path / "run"), "--json"]
    )
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    assert (record["maps_differ"], record["ratio"]) == (False, 1.0)
    assert set(schemas()["difference"]["required"]) <= set(record)
    assert "is smaller than its error, 0.0 of it" in record["statement"]
    report = (tmp_path / "run" / "report.html").read_text()
    assert "The maps agree" in report
    assert "264 of 264 readings of the other run were fitted in the one, too" in report
    assert record["notes"]
    assert all(str(source / "fit.json") in report for source in (TWELVE, again))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "poisson_ratio = 0.45", "poisson_ratio = 0.3",
            "body.poisson_ratio is 0.45 in the one and 0.3 in the other",
        ),
        ("    0.03,", "    0.04,", "body.size_m is (0.06, 0.06, 0.03) in the one"),
    ],
)  # fmt: skip
def test_runs_of_studies_that_state_different_bodies_are_refused(tmp_path, old, new, said):
    other = shutil.copytree(TWELVE, tmp_path / "other") / "study.toml"
    text = other.read_text()
    assert old in text
    other.write_text(text.replace(old, new))
    done = CliRunner().invoke(app, ["compare", str(TWELVE), str(other.parent)])
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())


def test_nothing_to_compare_is_said_with_all_that_can_be_compared(tmp_path):
    done = CliRunner().invoke(app, ["compare", str(tmp_path / "nowhere")])
    assert done.exit_code == 2
    assert "no such file or folder, expected a run folder or a study file" in done.stderr


def test_what_python_compares_writes_itself(tmp_path):
    fit = pm.read_run(TWELVE).fit
    for found, name in ((pm.compare(fit), "comparison"), (pm.compare_runs(fit, fit), "difference")):
        folder = found.write(tmp_path / name)
        files = {path.name for path in folder.iterdir()}
        assert {f"{name}.json", "report.html", "run.json"} <= files
    found = pm.diagnose(fit.experiment, [pm.CATALOGUE["contact_offset"]])
    assert (found.write(tmp_path / "diagnosis") / "diagnosis.json").is_file()
    with pytest.raises(InputError, match="read from a file, without its model: fit the scan again"):
        fit.sample(1000)


def test_readings_that_the_fit_has_seen_are_said():
    fit = pm.read_run(TWELVE).fit
    again = pm.predict(fit, fit.experiment)
    assert any("readings were in the fit's own scan" in note for note in again.notes)
