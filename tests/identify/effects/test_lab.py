"""Effects find their own parameters in scans of an independent solver that planted them.

The compliances are given (`truth.json`), so that only the effect is sought: what a sign, a unit or
a start of the clock gets wrong shows at once.
"""

import json

import numpy as np
import pytest
from scipy.optimize import least_squares

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.measurement.chain import Chain, OperatingPoint
from models.scan_file import read_scan
from tests.paths import LAB

DISPLACEMENT_NOISE_M, FORCE_NOISE_N = 2e-5, 5e-3


def found(case: str, name: str, start: tuple[float, ...]):
    """Values of an effect in a case, standard deviations, chi-square per reading, truth."""
    folder = LAB / case
    scan = read_scan(folder / "scan.csv")
    truth = json.loads((folder / "truth.json").read_text())
    readings = Readings.of(scan)
    compliance_j = np.array(truth["compliance_m_per_n"])
    compliance = compliance_j[readings.press]
    noise = np.hypot(DISPLACEMENT_NOISE_M, compliance * FORCE_NOISE_N)
    effect = CATALOGUE[name]
    scale = np.array([p.typical for p in effect.parameters])

    def residual(u):
        values = dict(zip((p.name for p in effect.parameters), scale * u, strict=True))
        chain = Chain(readings, [effect], np.zeros(len(compliance_j)), "flat", 0.49)
        own = {effect.name: values}
        predicted = chain.predict(OperatingPoint(compliance_j, compliance_j, readings.force_n, own))
        return (scan.used().displacement_m - predicted) / noise

    fit = least_squares(residual, np.array(start) / scale)
    deviation = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))) * scale
    return fit.x * scale, deviation, 2 * fit.cost / len(readings), truth["parameters"]


def agrees(value, deviation, true):
    return abs(value - true) < 3 * deviation


def test_creep_is_found():
    (g, tau), (sd_g, sd_tau), chi2, truth = found("case_b", "viscoelasticity", (0.05, 2.0))
    assert agrees(g, sd_g, truth["g"])
    assert agrees(tau, sd_tau, truth["tau"])
    assert chi2 < 1.15


@pytest.mark.parametrize(
    ("case", "name", "key"),
    [
        ("case_c", "tool_compliance", "c"),
        ("case_d", "force_drift", "rate"),
        ("case_g", "contact_offset", "offset"),
    ],
)
def test_an_effect_of_the_instrument_is_found_with_its_sign(case, name, key):
    (value,), (deviation,), chi2, truth = found(case, name, (0.0,))
    assert agrees(value, deviation, truth[key])
    assert chi2 < 1.15


def test_breathing_is_found_with_its_phase():
    (sine, cosine, frequency), deviation, chi2, truth = found(
        "case_h", "breathing", (1e-4, 0.0, 0.2498)
    )
    assert agrees(np.hypot(sine, cosine), deviation[0], truth["amp"])
    assert abs(frequency - truth["f"]) < 3 * deviation[2]
    # The scan's first reading, from which the effect counts, is not at t = 0.
    first = read_scan(LAB / "case_h" / "scan.csv").time_s[0]
    phase = truth["phase"] + 2 * np.pi * truth["f"] * first
    assert abs(np.arctan2(cosine, sine) - phase) < 3 * deviation[0] / truth["amp"]
    assert chi2 < 1.15
