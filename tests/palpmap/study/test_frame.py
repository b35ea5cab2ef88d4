"""One frame: what is said and listed of places is in the frame of the scan."""

import re

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.conformance.example_scan import trial
from identify.fit import fit_jointly
from models import read_scan, write_scan
from palpmap.experiment import read_study
from palpmap.result.evidence import axes_of
from palpmap.study.frame import evidence, frame_shift_m
from palpmap.study.study import load_study
from palpmap.study.versions import version_of

ORIGIN_M = np.array([0.2, -0.1, 0.05])


def places(sentence: str) -> list[float]:
    """Numbers of the first two places in mm that a sentence names."""
    pair = re.search(r"\(([-\d.]+), ([-\d.]+)\) mm|x = ([-\d.]+) mm, y = ([-\d.]+) mm", sentence)
    assert pair, sentence
    return [float(number) for number in pair.groups() if number]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("local_creep", {"g": 0.1, "tau_s": 1.0, "x_m": 0.03, "y_m": 0.02, "radius_m": 0.01}),
        ("side_creep", {"g": 0.1, "tau_s": 1.0, "angle_rad": 0.6, "edge_m": 0.004,
                        "width_m": 0.005}),
        ("surface_bump", {"height_m": 1e-4, "x_m": 0.03, "y_m": 0.02, "radius_m": 0.02}),
        ("extra_inclusion", {"weight_pa": 5e3, "x_m": 0.03, "y_m": 0.02, "z_m": 0.03,
                             "radius_m": 0.01}),
    ],
)  # fmt: skip
def test_evidence_names_places_in_the_frame_of_the_scan(name, values):
    effect, readings = CATALOGUE[name], trial().readings
    own = effect.evidence(values, readings)
    said = evidence(effect, values, readings, ORIGIN_M)
    moved = np.subtract(places(said), places(own))
    np.testing.assert_allclose(moved, 1e3 * ORIGIN_M[:2], atol=1.0)
    rest = [re.sub(r"\([-\d.]+, [-\d.]+\)|[xy] = [-\d.]+", "", text) for text in (own, said)]
    assert rest[0] == rest[1]  # sizes, depths and directions are the same


def test_a_shift_of_the_body_is_no_place():
    assert frame_shift_m("body_shift.x_m", ORIGIN_M) == 0.0
    assert frame_shift_m("local_creep.x_m", ORIGIN_M) == 0.2


def test_pictures_of_the_evidence_have_the_frame_of_the_scan(explained_case):
    step = explained_case.explained.ladder[0]
    own, there = (axes_of(step, {}, origin) for origin in (np.zeros(3), ORIGIN_M))
    for name, shift in (("x", 200.0), ("y", -100.0)):
        (one,), (other,) = ([a for a in axes if a.name == name] for axes in (own, there))
        np.testing.assert_allclose(other.at - one.at, shift)
        assert other.label == f"{name}, mm"


def test_a_study_states_places_of_effects_in_the_frame_of_the_scan(explained_case, tmp_path):
    problem = explained_case.problem
    study, effect = problem.study, CATALOGUE["local_creep"]
    body = study.body.model_copy(update={"origin_m": tuple(ORIGIN_M.tolist())})
    there = study.model_copy(update={"body": body, "scan": tmp_path / "scan.csv"})
    write_scan(read_scan(study.scan).moved(ORIGIN_M), there.scan)
    values = {"g": 0.1, "tau_s": 1.0, "x_m": 0.03, "y_m": 0.02, "radius_m": 0.02}
    model = problem.model.with_effect(effect, values, problem.model.mechanics.state())
    fit = fit_jointly(model, problem.start, rounds=0, max_evaluations=1)
    version_of(there, fit, tmp_path / "study.toml")
    (entry,) = load_study(tmp_path / "study.toml").effects
    found = fit.at.values["local_creep"]
    away = {name: entry.initial[name] - found[name] for name in values}
    assert away == pytest.approx({"g": 0, "tau_s": 0, "x_m": 0.2, "y_m": -0.1, "radius_m": 0})
    ((_, initial),) = read_study(tmp_path / "study.toml").opened().effects
    assert initial == pytest.approx(found)
