"""Scans that cannot determine a map are refused before anything is fitted to them."""

from pathlib import Path

import numpy as np
import pytest

from identify.measurement.experiment import different_presses
from models.errors import InputError
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.study.checks import refuse_unfit, too_few
from palpmap.study.placement import place_scan
from palpmap.study.study import About, Body, Map, Probe, Study, load_study
from tests.paths import ROOT

EXAMPLES = ROOT / "examples"

SIZE_M = (0.096, 0.096, 0.048)
SHARE = np.array([0.25, 0.5, 0.75, 1.0])


def study(**of_map) -> Study:
    return Study(
        study=About(name="small", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=SIZE_M, poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005),
        map=Map(**{"inclusions": 1, **of_map}),
    )


def scan(places: int, force=SHARE * 0.3, travel=SHARE * 3e-3, step_m=0.01) -> Scan:
    press = np.repeat(np.arange(places), 4)
    point = np.column_stack(
        [0.02 + step_m * press, np.full(len(press), 0.05), np.full(len(press), SIZE_M[2])]
    )
    return Scan(
        press=press,
        time_s=np.arange(len(press)) * 0.5,
        phase=np.full(len(press), "load"),
        point_m=point,
        direction=np.tile([0.0, 0.0, -1.0], (len(press), 1)),
        force_n=np.tile(force, places),
        displacement_m=np.tile(travel, places),
        probe_radius_m=np.full(len(press), 0.005),
    )


def refused(table: Scan, known: Study) -> str:
    with pytest.raises(InputError) as caught:
        refuse_unfit(place_scan(table, known), known)
    return str(caught.value)


def test_as_many_different_presses_are_needed_as_the_map_has_unknowns():
    assert "found 5 different presses" in refused(scan(5), study())
    assert "expected at least 6" in refused(scan(5), study())
    refuse_unfit(place_scan(scan(6), study()), study())
    assert "expected at least 11" in refused(scan(6), study(inclusions=2))
    held = study(fixed={"inclusion_1.z_m": 0.03})
    refuse_unfit(place_scan(scan(5), held), held)
    for few in (0, "auto"):
        refuse_unfit(place_scan(scan(2), study(inclusions=few)), study(inclusions=few))
        assert "expected at least 2; press at more" in refused(scan(1), study(inclusions=few))


def test_repeats_of_one_place_are_one_press():
    again = scan(6, step_m=1e-6)
    assert different_presses(again) == 1
    assert "found 1 different press (place" in refused(again, study())
    alone = study(inclusions=0)  # its background can be found from repeats
    assert too_few(place_scan(again, alone), alone) is None
    tips = again.replace(probe_radius_m=np.where(again.press % 2, 0.003, 0.005))
    assert different_presses(tips) == 2


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (scan(6, travel=SHARE * 0.06), "row 4 (press 0), column displacement_m: found 0.06 m"),
        (scan(6, travel=SHARE * 0.06), "less than the body's height of 0.048 m"),
        (scan(6, np.full(4, 0.2), np.array([0, 1, 2, 3e0]) * 1e-3), "force_n stays at 0.2 N while"),
    ],
)
def test_readings_that_contradict_themselves_are_said_to(table, says):
    message = refused(table, study())
    assert says in message
    assert message.startswith("scan.csv")


def test_a_height_that_is_only_assumed_refuses_no_travel():
    known = study()
    body = known.body.model_copy(update={"thickness_assumed": True})
    guessed = known.model_copy(update={"body": body})
    deep = scan(6, travel=SHARE * 0.06)
    assert "less than the body's height" in refused(deep, known)
    refuse_unfit(place_scan(deep, guessed), guessed)


def test_rows_are_counted_as_in_the_file():
    deep = scan(6, travel=SHARE * 0.06)
    phase = deep.phase.copy()
    phase[0] = "approach"
    assert "row 4 (press 0)" in refused(deep.replace(phase=phase), study())


def test_a_hold_at_constant_force_with_creep_is_a_scan():
    creep = scan(6, np.full(4, 0.2), np.array([2.0, 2.2, 2.3, 2.35]) * 1e-3)
    placement = place_scan(creep, study())
    refuse_unfit(placement, study())
    assert too_few(placement, study()) is None


def test_a_guess_outside_the_body_is_refused_in_the_scans_frame():
    inside = study(initial={"inclusion_1.x_m": 0.05, "inclusion_1.z_m": 0.03})
    refuse_unfit(place_scan(scan(6), inside), inside)
    for table in ("initial", "fixed"):
        out = study(**{table: {"inclusion_1.z_m": -0.068}})
        said = refused(scan(6), out)
        assert f"key map.{table}.inclusion_1.z_m: found -0.068 m, expected 0 to" in said
    near = study(initial={"inclusion_1.z_m": -0.004, "inclusion_1.radius_m": 0.005})
    refuse_unfit(place_scan(scan(6), near), near)


@pytest.mark.parametrize("tip", ["cone", "ring", "several"])
def test_a_tip_without_a_contact_model_is_refused(tip):
    known = study().model_copy(update={"probe": Probe(tip=tip, radius_m=0.005)})
    said = refused(scan(6), known)
    assert f'probe.tip = "{tip}", expected "flat" or "sphere"' in said
    assert "a scan by another tip cannot be fitted" in said


@pytest.mark.parametrize("table", ["initial", "fixed"])
def test_an_inclusion_wider_than_the_body_is_refused(table):
    wide, widest = (study(**{table: {"inclusion_1.radius_m": r}}) for r in (0.5, 0.096))
    said = refused(scan(6), wide)
    assert said.startswith(f"study, key map.{table}.inclusion_1.radius_m: found 0.5 m, expected")
    assert "at most 0.096 m, the body's longest edge" in said
    refuse_unfit(place_scan(scan(6), widest), widest)


def test_an_inclusion_beside_a_body_of_any_shape_is_refused():
    organ = load_study(EXAMPLES / "organ" / "study.toml")
    measured = read_scan(organ.scan)
    held = Map(inclusions=1, fixed={"inclusion_1.x_m": 0.9})
    known = organ.model_copy(update={"map": held})
    assert "key map.fixed.inclusion_1.x_m: found 0.9 m, expected" in refused(measured, known)
