"""Thirteen foreign files of one scan give that scan again."""

from pathlib import Path

import numpy as np
import pytest

from models.scan_file import read_scan
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.readers.read import read_recording
from palpmap.importing.readings import scan_of_readings
from tests.palpmap.importing.foreign_files import BODY, FORMS
from tests.paths import LAB


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
