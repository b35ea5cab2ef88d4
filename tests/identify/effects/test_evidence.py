"""The numbers in what a reader is told are those of the law."""

import math

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.effects import units as words
from identify.effects.conformance.example_scan import trial
from identify.effects.conformance.worked_example import Inputs


def number_before(unit: str, sentence: str) -> float:
    return float(sentence.split(f" {unit}")[0].split()[-1])


def test_creep_says_by_how_much_the_tip_sinks_during_a_hold():
    # A ramp of 1 s, held from 1.25 to 3 s: z / u = 1 - tau (exp(1 / tau) - 1) exp(-t / tau)
    times = [*(np.arange(1, 9) / 8), *(1 + np.arange(1, 9) / 4)]
    own = Inputs(
        {
            "time_s": tuple(times),
            "force_n": tuple(0.3 * min(t, 1.0) for t in times),
            "phase": ("load",) * 8 + ("hold",) * 8,
        }
    ).readings()
    g, tau = 0.2, 0.8
    z = [1 - tau * math.expm1(1 / tau) * math.exp(-t / tau) for t in (1.25, 3.0)]
    sentence = CATALOGUE["viscoelasticity"].evidence({"g": g, "tau_s": tau}, own)
    assert number_before("%", sentence) == pytest.approx(100 * g * (z[1] - z[0]), rel=0.01)
    assert "time constant of 0.8 s" in sentence
    assert "would add 20 %" in sentence


def test_creep_without_holds_is_told_by_its_limit():
    own = Inputs({"time_s": (1.0, 2.0), "force_n": (0.1, 0.2)}).readings()
    sentence = CATALOGUE["viscoelasticity"].evidence({"g": 0.06, "tau_s": 150.0}, own)
    assert "by 6 % with a time constant of 2.5 min" in sentence


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("contact_offset", {"offset_m": -1.5e-4}, "0.15 mm too small"),
        ("contact_offset", {"offset_m": -1.5e-4}, "declared too late"),
        ("force_bias", {"bias_n": 0.02}, "20 mN too much"),
        ("tool_compliance", {"c_m_per_n": 5e-5}, "0.05 mm of travel"),
        ("tool_compliance", {"c_m_per_n": 5e-5}, "a tool of 20 N/mm"),
        ("breathing", {"sine_m": 3e-4, "cosine_m": 4e-4, "frequency_hz": 0.25}, "0.5 mm every 4 s"),
        ("hysteresis", {"h": 0.03}, "by 3 % of its largest travel"),
        ("skin_layer", {"stiffening": 4.0, "thickness_m": 0.001}, "5 times as stiff"),
        ("stiffness_gradient", {"gradient": -0.3}, "softer at its top than at its base, by 30 %"),
        ("anisotropy", {"fibre_share": 0.5, "angle_rad": -math.pi / 4}, "135 degrees"),
        ("base_compliance", {"normal_m_per_pa": 1e-7}, "0.1 mm for each kPa"),
        ("base_compliance", {"normal_m_per_pa": 1e-7}, "is 2 mm thick"),
    ],
)
def test_evidence_speaks_in_units_of_a_reader(name, values, says):
    assert says in CATALOGUE[name].evidence(values, trial().readings)


def test_drift_and_preconditioning_are_told_over_the_whole_scan():
    own = trial().readings
    drift = CATALOGUE["force_drift"].evidence({"rate_n_per_s": -1e-4}, own)
    assert f"falls steadily by {words.force(1e-4 * own.elapsed_s[-1])} over" in drift
    gain = CATALOGUE["sensitivity_drift"]
    gain = gain.evidence({"rate_per_s": -0.05 / own.elapsed_s[-1]}, own)
    assert "5 % less after the" in gain
    assert "or the body softens" in gain
    growth = CATALOGUE["displacement_drift"]
    growth = growth.evidence({"rate_m_per_s": 2e-4 / own.elapsed_s[-1]}, own)
    assert "grow steadily, by 0.2 mm over" in growth
    soft = CATALOGUE["preconditioning"].evidence({"p": 0.1, "k0": 24.0}, own)
    assert number_before("%", soft) == pytest.approx(10 * (1 - math.exp(-1)), rel=0.01)


def test_a_tilt_is_told_by_its_angle_and_its_ends():
    # 72 mm along x at 1 %: 0.36 mm up and down of the middle; atan(0.01) = 0.57 degrees
    values = {"offset_m": 0.0, "slope_x": 0.01, "slope_y": 0.0}
    sentence = CATALOGUE["surface_tilt"].evidence(values, trial().readings)
    assert "off by -0.36 mm on one side" in sentence
    assert "by 0.36 mm on the other" in sentence
    assert "tilted by 0.57 degrees" in sentence


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (words.percent(0.0634), "6.3 %"),
        (words.percent(1.0), "100 %"),
        (words.percent(12.0), "1200 %"),
        (words.length(1.5e-4), "0.15 mm"),
        (words.length(-4.2e-5), "-42 µm"),
        (words.force(0.0205), "20 mN"),
        (words.force(0.3), "0.3 N"),
        (words.pressure(21500.0), "22 kPa"),
        (words.seconds(119.0), "119 s"),
        (words.seconds(360.0), "6 min"),
    ],
)
def test_numbers_are_short_and_without_exponents(said, expected):
    assert said == expected


@pytest.mark.parametrize(("height_m", "shape"), [(1e-4, "dent"), (-2e-4, "hill")])
def test_a_bump_says_whether_it_is_met_late_or_early(height_m, shape):
    values = {"height_m": height_m, "x_m": 0.031, "y_m": 0.018, "radius_m": 0.02}
    sentence = CATALOGUE["surface_bump"].evidence(values, trial().readings)
    assert f"has a {shape} there" in sentence
    assert "x = 31 mm, y = 18 mm" in sentence
    assert "up to 20 mm from there" in sentence


def test_a_rhythm_that_bends_says_how_often_the_body_moves_at_the_end():
    own = Inputs({"time_s": (0.0, 50.0, 100.0), "press": (0.0, 1.0, 2.0)}).readings()
    values = {"sine_m": 3e-4, "cosine_m": 4e-4, "frequency_hz": 0.25, "drift_hz_per_s": 2e-3}
    sentence = CATALOGUE["breathing_drifting"].evidence({**values, "bend_hz_per_s2": -5e-5}, own)
    assert "by 0.5 mm, every 4 s at first and every 5 s at the end" in sentence
