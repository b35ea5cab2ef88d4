"""Every public call refuses what it cannot take, in one sentence that names the argument."""

import inspect
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpmap as pm
from models import InputError, kinds_checked
from tests.paths import ROOT

TWELVE = ROOT / "tests" / "data" / "twelve_presses"
UNFIT: Any = object()
NOT_CALLED = ("Comparison", "Diagnosis", "Explanation", "FitResult", "Imported", "Limits",
              "MapChange", "Prediction", "Run", "InputError", "Effect", "Advice")  # fmt: skip
"""What the library alone makes, and what has no arguments."""


@pytest.mark.parametrize(
    "name",
    [name for name in pm.__all__ if callable(getattr(pm, name)) and name not in NOT_CALLED],
)
def test_a_public_call_names_the_first_argument_that_it_cannot_take(name):
    call = getattr(pm, name)
    parameters = inspect.signature(call).parameters
    first = next(iter(parameters))
    with pytest.raises(pm.InputError, match=rf"^{first}(: found <object|\b.*expected)") as caught:
        call(**dict.fromkeys(parameters, UNFIT))
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def scan() -> pm.Scan:
    return pm.read_scan(TWELVE / "scan.csv")


NOTHING: Any = None
WRONG: Any = "x"
FILE: Any = "cable_drag.py"
POINT: Any = (0.03, 0.03, 0.02)
CLASS: Any = type(pm.CATALOGUE[0])


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda scan: pm.join_scans(scan), "scans: found this Scan, expected a list, each a Scan"),
        (lambda scan: pm.join_scans([]), "found 0 scans and 0 names, expected one scan or more"),
        (lambda scan: pm.join_scans([scan], ["a", "b"]), "found 1 scans and 2 names"),
        (lambda scan: pm.assert_force_kept(scan), "made: found this Scan, expected a Presses or"),
        (lambda scan: pm.assert_path_clear(scan), "path: found this Scan, expected a PathResult"),
        (lambda scan: pm.read_study(NOTHING), "path: found None, expected a path"),
        (lambda scan: pm.read_scan(NOTHING), "path: found None, expected a path"),
        (lambda scan: pm.read_run(NOTHING), "folder: found None, expected a path"),
        (lambda scan: pm.write_scan(WRONG, "scan.csv"), "scan: found 'x', expected a Scan: give"),
        (lambda scan: pm.write_scan(scan, "nowhere/a.csv"), "nowhere/a.csv: there is no folder n"),
        (lambda scan: pm.ScanSettings(force_noise_n=WRONG), "force_noise_n: found 'x', expected a"),
        (lambda scan: pm.ScanSettings(hold_s=math.inf), "hold_s: found inf, expected a finite n"),
        (lambda scan: pm.ScanSettings(pause_s=WRONG), "pause_s: found 'x', expected 2 values, eac"),
        (lambda scan: pm.scan(seed=WRONG), "seed: found 'x', expected a whole number from 0 on"),
        (lambda scan: pm.grid_program(seed=-1), "seed: found -1, expected a whole number from 0"),
        (lambda scan: pm.grid_program(radii_m=(0.005, WRONG)), "radii_m: found 'x', expected a f"),
        (lambda scan: pm.check_effect(WRONG), "effect: found 'x', expected an Effect: give pm.CA"),
        (lambda scan: pm.check_effect(FILE), "or type `palpmap check-effect cable_drag.py`"),
        (lambda scan: pm.check_effect(CLASS), "an instance of the class, Ex"),
        (lambda scan: pm.Inclusion(WRONG, 0, 0, 0, 1), "weight_pa: found 'x', expected a finite"),
        (
            lambda scan: scan.replace(force_n=WRONG),
            "force_n: found 'x', expected numbers, one a",
        ),
        (lambda scan: scan.replace(force_n=["x"] * 264), "force_n: found ['x', 'x', "),
        (lambda scan: scan.replace(press=3), "press has shape (), expected (m,)"),
        (lambda scan: scan.replace(phase=3), "phase: found 3, expected texts, one a row"),
        (lambda scan: scan.replace(point_m=[[0], [0, 1]]), "point_m: found [[0], [0, 1]], expec"),
        (lambda scan: scan.replace(travel_from=WRONG), "travel_from: found 'x', expected '', 'to"),
        (lambda scan: scan.replace(frame_m=(0.0, 0.0)), "frame_m: found (0.0, 0.0), expected 3 v"),
        (lambda scan: scan.moved(np.zeros(2)), "by_m: found array([0., 0.]), expected 3 numbers"),
        (lambda scan: pm.GaussianMap(5e3).modulus(POINT), "points: found (0.03, 0.03, 0.02), ex"),
        (lambda scan: pm.GaussianMap(5e3).gradient(WRONG), "points: found 'x', expected rows of"),
        (lambda scan: pm.grid_program().then(WRONG, 0.0), "further: found 'x', expected a PressP"),
        (lambda scan: scan.at_largest_force(POINT), "found (0.03, 0.03, 0.02), expected 264, one"),
        (lambda scan: scan.rows(1.5), "which: found 1.5, expected a mask or indices"),
    ],
)
def test_what_a_call_cannot_take_is_refused_in_a_sentence(ask, said, scan):
    with pytest.raises(pm.InputError) as caught:
        ask(scan)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_scans_joined_without_names_are_numbered(scan):
    with pytest.raises(pm.InputError, match=r"scan 2, press 0: holds .* as scan 1, press 0"):
        pm.join_scans([scan, scan], pause_s=1.0)


def test_a_scan_is_not_written_in_place_of_a_folder(scan, tmp_path):
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(pm.InputError, match=r"a\.csv: found a folder, expected a file's name"):
        pm.write_scan(scan, tmp_path / "a.csv")


def test_numbers_lists_and_paths_of_every_kind_are_taken():
    @kinds_checked
    def take(number: float, count: int, row: tuple[float, float], path: str | Path) -> bool:
        return True

    whole: Any = np.int64(3)
    for number in (1, 1.0, np.float32(1), np.array(1.0)):
        for row in ((0, 1), [0.0, 1.0], np.ones(2)):
            given: Any = (number, whole, row, Path("a"))
            assert take(*given)


def test_python_itself_tells_of_a_missing_argument():
    call: Any = pm.read_scan
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'path'"):
        call()


def test_a_number_in_a_nested_list_is_found():
    @kinds_checked
    def take(boxes: tuple[tuple[float, ...], ...]) -> None: ...

    given: Any = ((1.0, 2.0), (3.0, "x"))
    with pytest.raises(InputError, match="boxes: found 'x', expected a finite number"):
        take(given)
