"""`palpmap import` from the command line: proposal, mapping, study, and what it asks for."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.commands.check import check_study
from palpmap.importing.importing import import_recording
from palpmap.importing.propose import propose_rig
from palpmap.importing.readers.read import read_recording
from tests.palpmap.importing import raw_scan
from tests.palpmap.importing.foreign_files import BODY, FORMS, csv_german, mcap_file
from tests.paths import LAB


def run(*words: object, code: int = 0):
    result = CliRunner().invoke(app, ["import", *map(str, words)])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def scan():
    scan = read_scan(LAB / "case_c" / "scan.csv")
    return scan.rows(scan.press < 12)


@pytest.mark.parametrize("form", [form for form in FORMS if form.__name__ not in
                                  ("csv_no_header", "hdf5_group_a_press")],
                         ids=lambda form: form.__name__)  # fmt: skip
def test_a_proposal_gives_the_same_scan_once_body_and_tip_are_added(form, scan, tmp_path):
    foreign = form(scan, tmp_path)
    proposed = propose_rig(read_recording(foreign.files))
    rig = tmp_path / "rig.toml"
    rig.write_text(proposed[: proposed.index("[probe]")] + BODY, encoding="utf-8")
    study = import_recording(foreign.files, rig).write(tmp_path / "study")
    found = read_scan(study.parent / "scan.csv")
    np.testing.assert_array_equal(found.press_index, scan.press_index)
    np.testing.assert_array_equal(found.phase, scan.phase)
    for name in ("point_m", "direction", "force_n", "displacement_m"):
        scale = np.abs(getattr(scan, name)).max()
        np.testing.assert_allclose(
            getattr(found, name), getattr(scan, name), rtol=0, atol=1e-9 * scale
        )


def test_the_study_loads_and_the_page_says_what_was_assumed(scan, tmp_path):
    foreign = csv_german(scan, tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(foreign.rig + BODY, encoding="utf-8")
    result = run(*foreign.files, "--rig", rig, "--out", tmp_path / "study", "--json")
    record = json.loads(result.stdout)
    assert (record["presses"], record["rows"]) == (12, len(scan))
    found = check_study(tmp_path / "study" / "study.toml")
    assert found.can_be_fitted
    assert (found.noise.displacement_m, found.noise.force_n) == (2.0e-5, 5.0e-3)
    text = (tmp_path / "study" / "study.toml").read_text()
    assert "# Made by palpmap import from german.csv" in text
    page = (tmp_path / "study" / "import.md").read_text()
    assert "| Presses | 12 |" in page
    assert "';' between cells and decimal commas" in page


def test_parquet_and_a_folder_that_is_taken(scan, tmp_path):
    foreign = mcap_file(scan, tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(foreign.rig + BODY, encoding="utf-8")
    words = (*foreign.files, "--rig", rig, "--out", tmp_path / "study", "--form", "parquet")
    run(*words)
    assert len(read_scan(tmp_path / "study" / "scan.parquet")) == len(scan)
    assert "already there" in run(*words, code=2).stderr


def test_what_a_recording_does_not_tell_is_asked_for_by_its_key(scan, tmp_path):
    files = csv_german(scan, tmp_path).files
    said = run(*files, "--out", tmp_path / "study", code=2).stderr
    assert "probe.tip and probe.radius_m" in said
    assert "body.shape" in said
    assert "--rig" in said
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('unit = "N"', 'unit = "V"'), "key force.unit: found the unit 'V'"),
        (("Kraft [N]", "Kraft [kN]"), "the nearest right name is 'Kraft [N]'"),
        (('phase = "Phase"', 'phase = "Weg [µm]"'), "found the phase"),
        (("direction = [0, 0, -1]", "direction = [0, 0]"), "press.direction"),
        (("[press]", "[pres]"), "the nearest right name is 'press'"),
        (('kind = "readings"', "kind = readings"), "not TOML"),
        (("size_m = [0.096", "size_m = [96"), "body.size_m"),
        (('number = "Kontakt"', 'number = "Kraft [N]"'), "expected whole numbers"),
        (("Kraft [N]", "Kraft"), "rig.toml, key force.column: the recording has no 'Kraft'"),
        (("size_m = [0.096", "size_m = [96.0"), "mapping, key body.size_m: found 96 m"),
        (('unit = "N"', 'unit = "kN"'), "scan of german.csv, row"),
        (('unit = "N"', 'unit = "N", sign = -1'), "rig.toml, key force.sign: found -1"),
        (('unit = "um"', 'unit = "um", sign = -1'), "rig.toml, key travel.sign: found -1"),
    ],
)
def test_a_wrong_mapping_is_answered_in_one_sentence(change, said, scan, tmp_path):
    foreign = csv_german(scan, tmp_path)
    rig = tmp_path / "rig.toml"
    text = foreign.rig + BODY
    assert change[0] in text
    rig.write_text(text.replace(*change), encoding="utf-8")
    result = run(*foreign.files, "--rig", rig, "--out", tmp_path / "study", "--quiet", code=2)
    assert said in result.stderr
    assert result.stderr.count("\n") == 1
    assert "units_checked" not in result.stderr
    assert not (tmp_path / "study").exists()


def test_a_press_in_the_air_is_imported_and_named_by_check(scan, tmp_path):
    """Its forces are the sensor's zero, slightly below 0."""
    air = scan.press == 5
    foreign = csv_german(scan.replace(force_n=np.where(air, -0.001, scan.force_n)), tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(foreign.rig.replace('phase = "Phase"', "") + BODY, encoding="utf-8")
    made = import_recording(foreign.files, rig).write(tmp_path / "study")
    assert ("no_contact", (6,)) in [(d.kind, d.presses) for d in check_study(made).doubts]


@pytest.fixture(scope="module")
def bag(tmp_path_factory, scan):
    path = tmp_path_factory.mktemp("raw") / "session_1"
    raw_scan.write_mcap(scan, path)
    return path


@pytest.mark.slow
def test_a_bag_on_disk_becomes_a_study(bag, scan, tmp_path):
    proposed = run(bag, "--propose").stdout
    assert 'kind = "stream"' in proposed
    assert 'columns = ["wrench.force.x", "wrench.force.y", "wrench.force.z"]' in proposed
    rig = tmp_path / "rig.toml"
    rig.write_text(proposed[: proposed.index("[probe]")] + raw_scan.RIG, encoding="utf-8")
    run(bag, "--rig", rig, "--out", tmp_path / "study")
    found = read_scan(tmp_path / "study" / "scan.csv")
    np.testing.assert_allclose(
        found.contact_points - raw_scan.BASE_M, scan.contact_points, atol=2e-5
    )
    for press, one in zip(found.press_ids, scan.press_ids, strict=True):
        here, there = found.press == press, scan.press == one
        travel = found.displacement_m[here].max() - scan.displacement_m[there].max()
        assert abs(travel) < 2e-4
        assert abs(found.force_n[here].max() / scan.force_n[there].max() - 1) < 0.05
    assert check_study(tmp_path / "study" / "study.toml").doubts == ()


@pytest.mark.slow
def test_a_wrong_sign_and_a_wrong_height_are_said(bag, tmp_path):
    proposed = propose_rig(read_recording([bag]))
    text = proposed[: proposed.index("[probe]")] + raw_scan.RIG
    rig = tmp_path / "rig.toml"
    rig.write_text(re.sub(r"sign = 1 ", "sign = -1", text), encoding="utf-8")
    said = run(bag, "--rig", rig, "--out", tmp_path / "study", code=2).stderr
    assert "key force.sign: found -1" in said
    rig.write_text(text.replace("-0.10, 0.02]", "-0.10, 0.05]"), encoding="utf-8")
    said = run(bag, "--rig", rig, "--out", tmp_path / "study", code=2).stderr
    assert "mm off the block's top" in said
    assert "body.origin_m" in said


def test_a_quiet_proposal_is_printed(scan, tmp_path):
    assert (
        'kind = "readings"' in run(*csv_german(scan, tmp_path).files, "--propose", "--quiet").stdout
    )


def test_propose_goes_alone_and_something_must_be_asked_for(tmp_path):
    assert run("x.csv", "--propose", "--out", tmp_path, code=2)
    assert run("x.csv", code=2)
