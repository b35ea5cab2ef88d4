"""`palpmap check` as a user runs it."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from models.scan_file import read_scan, write_scan
from palpmap.__main__ import app
from palpmap.run_folder import sha256
from tests.paths import LAB, ROOT, TWELVE

REAL = Path(os.environ.get("PALPMAP_REAL_DATA", ROOT.parent / "shared" / "data" / "real"))


def check(*arguments: object):
    return CliRunner().invoke(app, ["check", *map(str, arguments)])


def checked(study: Path) -> dict:
    result = check(study, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_a_good_study_is_summed_up_for_a_person():
    result = check(LAB / "case_a" / "study.toml")
    assert result.exit_code == 0
    for text in (
        "81",
        "648 load, 648 hold, 486 unload",
        "0 ignored",
        "-0.01258 to 0.3166 N",
        "5.705 mm",
        "displacement 20 µm, force 5 mN",
        "can be used",
    ):
        assert text in result.stdout


@pytest.mark.parametrize("case", ["case_a", "case_k"])
def test_a_good_study_is_summed_up_as_json(case):
    found = checked(LAB / case / "study.toml")
    assert found["presses"] == 81
    assert found["samples"] == {"load": 648, "hold": 648, "unload": 486}
    assert found["noise"] == {
        "displacement_m": 2e-5,
        "force_n": 5e-3,
        "touch_m": None,
        "lag_s": None,
    }
    assert found["placement"]["largest_distance_m"] < 1e-12
    assert found["sha256"]["scan"] == sha256(LAB / case / "scan.csv")


def test_quiet_says_nothing_of_a_good_study():
    result = check(LAB / "case_a" / "study.toml", "--quiet")
    assert (result.exit_code, result.output) == (0, "")


def copied(folder: Path) -> Path:
    shutil.copytree(LAB / "case_a", folder)
    return folder / "study.toml"


def test_what_is_ignored_assumed_or_unknown_is_said(tmp_path):
    study = copied(tmp_path / "a folder with spaces")
    scan = read_scan(study.parent / "scan.csv")
    phase = scan.phase.copy()
    phase[scan.phase == "unload"] = "retract"
    write_scan(
        scan.replace(phase=phase, time_s=scan.time_s * float("nan")), study.parent / "scan.csv"
    )
    text = study.read_text().replace("force_n = 5.0e-3", "")
    study.write_text(text.replace("[probe]", "thickness_assumed = true\n[probe]"))
    found = checked(study)
    assert found["ignored_rows"] == 486
    notes = "\n".join(found["notes"])
    assert "486 approach and retract rows" in notes
    assert "48 mm is assumed" in notes
    assert "No times" in notes
    assert "Noise not given for force_n" in notes


def test_a_scan_of_too_few_presses_is_not_said_to_be_usable(tmp_path):
    study = copied(tmp_path / "run")
    scan = read_scan(study.parent / "scan.csv")
    write_scan(scan.rows(scan.press < 2), study.parent / "scan.csv")
    result = check(study)
    assert "found 2 different presses" in result.stdout
    assert "the map cannot be fitted yet" in result.stdout
    assert "can be used" not in result.stdout
    assert checked(study)["can_be_fitted"] is False


def test_noise_finer_than_the_readings_is_said(tmp_path):
    study = copied(tmp_path / "run")
    study.write_text(study.read_text().replace("2.0e-5", "2.0e-12"))
    notes = " ".join(checked(study)["notes"])
    assert "noise.displacement_m is 2e-12 m, far below the smallest step" in notes
    assert "noise.force_n" not in notes
    assert "far below" not in " ".join(checked(LAB / "case_a" / "study.toml")["notes"])


def test_the_depth_of_a_doubtful_reading_is_not_held_against_the_model(tmp_path):
    study = copied(tmp_path / "run")
    csv = study.parent / "scan.csv"
    scan = read_scan(csv)
    deep = scan.displacement_m.copy()
    deep[np.flatnonzero(scan.in_contact)[100]] = 0.03
    for wrong, said in ((deep, False), (deep + 0.01, False), (4 * scan.displacement_m, True)):
        write_scan(scan.replace(displacement_m=wrong), csv)
        assert ("of the body's thickness" in " ".join(checked(study)["notes"])) == said


def test_slanted_presses_are_said(tmp_path):
    study = copied(tmp_path / "run")
    csv = study.parent / "scan.csv"
    scan = read_scan(csv)
    direction = scan.direction.copy()
    direction[scan.press < 3] = [0.6, 0.0, -0.8]
    write_scan(scan.replace(direction=direction), csv)
    notes = " ".join(checked(study)["notes"])
    assert "3 presses are 30 degrees or more off the surface's normal (up to 37)" in notes


def test_cells_larger_than_half_the_body_are_refused(tmp_path):
    study = copied(tmp_path / "run")
    text = study.read_text()
    study.write_text(text.replace("[probe]", "cell_size_m = 0.03\n[probe]"))
    result = check(study)
    assert result.exit_code == 2
    assert f"{study}, key body.cell_size_m: found 0.03 m, expected at most 0.024 m" in result.stderr
    study.write_text(text.replace("[probe]", "cell_size_m = 0.024\n[probe]"))
    assert checked(study)["cell_size_m"] == 0.024


@pytest.mark.parametrize(
    ("effect", "says"),
    [
        ('name = "breathing"', "'breathing' cannot be fitted to this scan: the scan has no time"),
        (
            'name = "contact_offset"\ninitial = { ofset_m = 1e-4 }',
            "study.toml, key effects.0: expected values of offset_m under initial of "
            "'contact_offset', not of 'ofset_m'; the nearest right name is 'offset_m'",
        ),
        (
            'name = "viscoelasticity"\ninitial = { g = 0.1 }',
            "under initial of 'viscoelasticity'; tau_s is missing",
        ),
        (
            'name = "contact_offset"\ninitial = { offset_m = 99 }',
            "effects.0: expected initial.offset_m of 'contact_offset' from -0.01 to 0.01 m, not 99",
        ),
    ],
)
def test_an_effect_that_no_fit_would_take_is_refused(effect, says, tmp_path):
    study = shutil.copytree(TWELVE, tmp_path / "run") / "study.toml"
    csv = study.parent / "scan.csv"
    scan = read_scan(csv)
    write_scan(scan.replace(time_s=scan.time_s * float("nan")), csv)
    study.write_text(study.read_text() + f"\n[[effects]]\n{effect}\n")
    result = check(study)
    assert result.exit_code == 2
    assert says in result.stderr
    for command in ("fit", "diagnose", "explain", "limits"):
        arguments = [command, str(study), "--out", str(tmp_path / command)]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2, result.output
        assert says in result.stderr


def test_a_bad_study_gives_one_sentence_and_exit_code_2(tmp_path):
    study = copied(tmp_path / "run")
    study.write_text(study.read_text().replace("poisson_ratio", "poison_ratio"))
    result = check(study)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert "key body.poison_ratio: unknown key; the nearest right name is" in result.stderr


def test_a_bad_scan_gives_one_sentence_and_exit_code_2(tmp_path):
    study = copied(tmp_path / "run")
    csv = study.parent / "scan.csv"
    csv.write_text(csv.read_text().replace("0.042772", "NaN"))
    result = check(study, "--json")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "row 1 (line 2), column force_n: found 'NaN'" in result.stderr


def test_a_press_off_the_body_gives_exit_code_2(tmp_path):
    study = copied(tmp_path / "run")
    study.write_text(study.read_text().replace("0.048]", "0.058]"))
    result = check(study)
    assert result.exit_code == 2
    assert "row 1 (press 0), column z_m" in result.stderr
    assert "10 mm off the body's top (81 of 81 presses)" in result.stderr


def test_a_study_whose_scan_is_missing_gives_exit_code_2(tmp_path):
    study = copied(tmp_path / "run")
    (study.parent / "scan.csv").unlink()
    result = check(study)
    assert result.exit_code == 2
    assert "scan.csv: no such file" in result.stderr


@pytest.mark.parametrize(
    ("name", "example", "presses", "farthest_m", "steepest_deg"),
    [
        ("arma_two_stiff", "arma_two_stiff", 589, (0.003, 0.005), (30, 31)),
        ("arma_straight_2mm", "arma_straight", 727, (0.011, 0.012), (67, 68)),
    ],
)
def test_the_example_studies_fit_the_measured_scans(
    name, example, presses, farthest_m, steepest_deg, tmp_path
):
    source = REAL / name / "scan.csv"
    if not source.is_file():
        pytest.skip(f"the measured data are not there: {source} (set PALPMAP_REAL_DATA)")
    shutil.copy(ROOT / "examples" / example / "study.toml", tmp_path)
    (tmp_path / "scan.csv").symlink_to(source)
    found = checked(tmp_path / "study.toml")
    assert found["presses"] == presses
    assert found["placement"]["projected"]
    assert farthest_m[0] < found["placement"]["largest_distance_m"] < farthest_m[1]
    assert steepest_deg[0] < found["placement"]["largest_angle_deg"] < steepest_deg[1]
    assert "A block stands in for the body" in " ".join(found["notes"])
    assert "30 mm is assumed" in " ".join(found["notes"])
