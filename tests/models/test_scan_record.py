"""The Scan record: what it knows of its rows, and that files give back what was written."""

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from models.scan import Scan
from models.scan_file import read_scan, write_scan
from tests.paths import LAB, ROOT

CASE_A = LAB / "case_a" / "scan.csv"
REAL = Path(os.environ.get("PALPMAP_REAL_DATA", ROOT.parent / "shared" / "data" / "real"))


def small_scan(**changes) -> Scan:
    """Two presses, the second with approach and retract rows."""
    press = np.array([3, 3, 3, 7, 7, 7, 7])
    point = np.array([[0.01, 0.02, 0.03], [0.04, 0.05, 0.03]])[(press == 7).astype(int)]
    arrays = {
        "press": press,
        "time_s": np.arange(7.0),
        "phase": ["load", "hold", "unload", "approach", "load", "hold", "retract"],
        "point_m": point,
        "direction": np.tile([0.6, 0.0, -0.8], (7, 1)),
        "force_n": [0.1, 0.2, 0.1, 0.0, 0.15, 0.3, 0.0],
        "displacement_m": [1e-3, 2e-3, 1e-3, -0.01, 1.5e-3, 3e-3, -0.01],
        "probe_radius_m": np.where(press == 3, 0.003, 0.005),
    }
    return Scan(**(arrays | changes))


def assert_equal(a: Scan, b: Scan) -> None:
    for field in fields(Scan):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if x is None or y is None:
            assert x is y
        else:
            np.testing.assert_array_equal(x, y, err_msg=field.name)


def test_a_scan_knows_its_presses():
    scan = small_scan()
    assert scan.press_ids.tolist() == [3, 7]
    assert scan.press_index.tolist() == [0, 0, 0, 1, 1, 1, 1]
    np.testing.assert_array_equal(scan.contact_points, [[0.01, 0.02, 0.03], [0.04, 0.05, 0.03]])
    np.testing.assert_array_equal(scan.contact_directions, [[0.6, 0, -0.8]] * 2)
    assert scan.contact_radii.tolist() == [0.003, 0.005]
    assert scan.has_time
    assert not small_scan(time_s=np.full(7, np.nan)).has_time


def test_rows_that_models_ignore_are_counted_and_left_out_on_request():
    scan = small_scan()
    used = scan.used()
    assert scan.ignored_rows == 2
    assert used.ignored_rows == 0
    assert used.force_n.tolist() == [0.1, 0.2, 0.1, 0.15, 0.3]
    assert used.press_index.tolist() == [0, 0, 0, 1, 1]


def test_arrays_of_a_scan_cannot_be_changed():
    scan = small_scan()
    with pytest.raises(ValueError, match="read-only"):
        scan.force_n[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        scan.press_index[0] = 1


def test_a_scan_keeps_its_own_copy_of_the_arrays():
    force = np.ones(7)
    scan = small_scan(force_n=force)
    force[0] = 5.0
    assert scan.force_n[0] == 1.0


def test_arrays_of_unequal_length_make_no_scan():
    with pytest.raises(ValueError, match=r"force_n has shape \(6,\), expected \(7,\)"):
        small_scan(force_n=np.ones(6))
    with pytest.raises(ValueError, match=r"point_m has shape \(7, 2\), expected \(7, 3\)"):
        small_scan(point_m=np.ones((7, 2)))
    with pytest.raises(ValueError, match=r"phase holds \{'wait'\}, expected"):
        small_scan(phase=["load"] * 6 + ["wait"])
    with pytest.raises(ValueError, match="press ids fall"):
        small_scan(press=[7, 7, 7, 3, 3, 3, 3])


def numbers(low: float, high: float):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


@st.composite
def scans(draw) -> Scan:
    """Scans of one to four presses with odd numbers in every column, that pass the checks."""
    sizes = draw(st.lists(st.integers(2, 5), min_size=1, max_size=4))
    gaps = draw(st.lists(st.integers(1, 3), min_size=len(sizes), max_size=len(sizes)))
    press = np.repeat(np.cumsum(gaps) - 1, sizes)
    m = len(press)
    owner = np.repeat(np.arange(len(sizes)), sizes)

    def column(low, high, count=m):
        return np.array(draw(st.lists(numbers(low, high), min_size=count, max_size=count)))

    depth = np.concatenate([np.arange(1, size + 1) for size in sizes]) * 1e-4
    angle = column(-1.5, 1.5, len(sizes))
    direction = np.column_stack([np.sin(angle), np.zeros(len(sizes)), -np.cos(angle)])
    half_turn = column(-3, 3)
    nothing = np.zeros(m)
    pose = [*(column(-1, 1) for _ in range(3)), np.cos(half_turn), np.sin(half_turn)]
    return Scan(
        press=press,
        time_s=np.cumsum(column(1e-3, 10)) if draw(st.booleans()) else np.full(m, np.nan),
        phase=draw(st.lists(st.sampled_from(["load", "hold", "unload"]), min_size=m, max_size=m)),
        point_m=np.column_stack([column(-2, 2, len(sizes)) for _ in range(3)])[owner],
        direction=direction[owner],
        force_n=depth * draw(numbers(1, 100)),
        displacement_m=depth + column(-1e-6, 1e-6),
        probe_radius_m=column(1e-3, 0.04, len(sizes))[owner],
        force_vector_n=np.column_stack([column(-9, 9) for _ in range(3)]),
        tip_pose=np.column_stack([*pose, nothing, nothing]) if draw(st.booleans()) else None,
    )


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(scan=scans())
def test_a_scan_that_was_written_is_read_back_bit_for_bit(ending, scan, tmp_path):
    path = tmp_path / f"scan.{ending}"
    write_scan(scan, path)
    first = read_scan(path)
    np.testing.assert_allclose(first.direction, scan.direction, atol=1e-15)
    assert_equal(first, scan)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_writing_leaves_one_file_and_nothing_beside_it(ending, tmp_path):
    write_scan(small_scan(), tmp_path / f"scan.{ending}")
    assert [path.name for path in tmp_path.iterdir()] == [f"scan.{ending}"]


def test_the_laboratory_scan_is_read_as_it_stands_in_the_file():
    scan = read_scan(CASE_A)
    assert len(scan) == 1782
    assert len(scan.press_ids) == 81
    assert scan.has_time
    assert (scan.force_n[0], scan.displacement_m[0]) == (0.042772, 0.00067324)
    np.testing.assert_array_equal(
        scan.contact_points[[0, 80]], [[0.012] * 2 + [0.048], [0.084] * 2 + [0.048]]
    )


def test_text_forms_of_other_programs_are_read_too(tmp_path):
    lines = CASE_A.read_text().splitlines()[:23]
    quoted = [",".join(f'" {cell}"' for cell in line.split(",")) for line in lines[1:]]
    path = tmp_path / "scan.CSV"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([lines[0], *quoted]).encode())
    plain = tmp_path / "plain.csv"
    plain.write_text("\n".join(lines))
    assert_equal(read_scan(path), read_scan(plain))


def test_directions_rounded_by_a_file_are_unit_after_reading(tmp_path):
    lines = CASE_A.read_text().splitlines()[:23]
    path = tmp_path / "scan.csv"
    path.write_text(
        "\n".join(line.replace(",0,0,-1,", ",0.3333,0.6667,-0.6667,") for line in lines)
    )
    length = np.linalg.norm(read_scan(path).direction, axis=1)
    np.testing.assert_allclose(length, 1, rtol=1e-14)


@pytest.mark.parametrize(("name", "presses"), [("arma_two_stiff", 589), ("arma_straight_2mm", 727)])
def test_measured_scans_of_a_real_robot_are_read(name, presses):
    path = REAL / name / "scan.csv"
    if not path.is_file():
        pytest.skip(f"the measured data are not there: {path} (set PALPMAP_REAL_DATA)")
    scan = read_scan(path)
    assert len(scan.press_ids) == presses
    assert not scan.has_time
    assert scan.force_vector_n is not None
