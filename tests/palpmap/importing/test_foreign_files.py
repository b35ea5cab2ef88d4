"""Thirteen foreign files of one scan give that scan again."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import palpmap as pm
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.experiment import Experiment
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.readers.read import read_recording
from palpmap.importing.readings import scan_of_readings
from palpmap.study.study import Study, load_study
from tests.palpmap.importing.foreign_files import BODY, FORMS
from tests.paths import LAB, TESTS


@pytest.fixture(scope="module")
def scan():
    return read_scan(LAB / "case_c" / "scan.csv")


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_a_foreign_file_gives_the_same_scan(form, scan, tmp_path):
    foreign = form(scan, tmp_path)
    rig = parse_rig(foreign.rig + BODY, Path("rig.toml"))
    assert rig.needed() == ()
    found, _ = scan_of_readings(read_recording(foreign.files), rig)
    np.testing.assert_array_equal(found.press - found.press[0], scan.press)
    np.testing.assert_array_equal(found.phase, scan.phase)
    np.testing.assert_allclose(
        found.time_s - found.time_s[0], scan.time_s - scan.time_s[0], atol=5e-7, rtol=0
    )
    for name in ("point_m", "direction", "force_n", "displacement_m", "probe_radius_m"):
        scale = np.abs(getattr(scan, name)).max()
        np.testing.assert_allclose(
            getattr(found, name), getattr(scan, name), rtol=0, atol=1e-12 * scale, err_msg=name
        )


def test_presses_with_numbers_of_their_places_stay_in_the_order_of_time(scan, tmp_path):
    """A grid pressed in random order: sorted by its numbers, the clock would go back."""
    shuffled = (scan.press * 50) % 81
    foreign = FORMS[0](scan.replace(press=np.zeros_like(scan.press)), tmp_path)
    path = foreign.files[0]
    lines = path.read_bytes().decode("cp1252").split("\r\n")
    head = len(lines) - len(scan)
    for i, number in enumerate(shuffled):
        lines[head + i] = f"{number};{lines[head + i].partition(';')[2]}"
    path.write_bytes("\r\n".join(lines).encode("cp1252"))
    found, said = scan_of_readings(
        read_recording(foreign.files), parse_rig(foreign.rig + BODY, Path("rig.toml"))
    )
    np.testing.assert_array_equal(found.press, scan.press_index)
    np.testing.assert_allclose(found.time_s, scan.time_s, atol=1e-9)
    assert "numbered anew, from 0 in the order of time" in said[0]
    assert "them 0, 50, 19, 69, 38 and so on." in said[0]


SMALL = BODY.replace("0.096, 0.096, 0.048", "0.06, 0.06, 0.03")
SMALL = SMALL.replace("poisson_ratio = 0.49", "poisson_ratio = 0.45\ncell_size_m = 0.01")


def decided(scan: Scan, study: Study) -> tuple[str, tuple[str, ...], np.ndarray]:
    """Verdict of `explain`, the effects named, and all values of the answer."""
    why = pm.explain(Experiment.of(scan, study))
    return why.verdict, why.added, np.array([p.value for p in why.fit.parameters.values()])


@pytest.mark.slow
def test_every_foreign_file_leads_to_the_verdict_of_the_scan_itself(tmp_path):
    """Thirteen files of twelve presses through `palpmap import` and `explain`."""
    path = TESTS / "data" / "twelve_presses" / "study.toml"
    scan, study = read_scan(path.parent / "scan.csv"), load_study(path)
    verdict, names, values = decided(scan, study)
    assert verdict == "explained"
    for form in FORMS:
        folder = tmp_path / form.__name__
        folder.mkdir()
        foreign = form(scan, folder)
        rig = foreign.rig + SMALL.replace("radius_m = 0.005", "radius_m = 0.004")
        (folder / "rig.toml").write_text(rig, encoding="utf-8")
        words = ["import", *map(str, foreign.files), "--rig", str(folder / "rig.toml")]
        result = CliRunner().invoke(app, [*words, "--out", str(folder / "study")])
        assert result.exit_code == 0, result.output
        imported = load_study(folder / "study" / "study.toml")
        for section in ("body", "probe", "noise"):
            assert getattr(imported, section) == getattr(study, section)
        found = decided(
            read_scan(folder / "study" / "scan.csv"), imported.model_copy(update={"map": study.map})
        )
        assert found[:2] == (verdict, names), form.__name__
        np.testing.assert_allclose(found[2], values, rtol=1e-5, err_msg=form.__name__)
