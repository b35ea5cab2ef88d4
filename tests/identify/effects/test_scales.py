"""A law that was found on one scan is the same on other presses, of whatever force and depth."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.force_saturation import ForceSaturation
from identify.effects.base import Effect, changes_body
from identify.effects.readings import Readings
from identify.effects.unknown_course import COURSES
from identify.measurement.chain import Chain, OperatingPoint
from tests.identify.select.loop_problem import NU, scan, timing

OTHER_PRESSES = ("preconditioning_nearby", "creep_recovery")  # act on the later ones
LAWS = [e for e in (*CATALOGUE, *COURSES) if not changes_body(e) and e.name not in OTHER_PRESSES]


@pytest.fixture(scope="module")
def whole() -> Readings:
    """25 presses, the later ones three times as hard."""
    press, _, _, force = timing(0)
    force = force * np.where(press < 12, 0.5, 1.5)
    return Readings.of(scan(3e-3 * force, force, 0))


def travel(effect: Effect, readings: Readings, compliance: np.ndarray) -> np.ndarray:
    values = {
        p.name: p.typical if p.null is None else 0.5 * p.typical + (p.null or 0.0)
        for p in effect.parameters
    }
    chain = Chain(readings, [effect], np.full(readings.presses, 0.004), "flat", NU)
    at = OperatingPoint(compliance, np.full_like(compliance, 5e3), readings.force_n,
                        {effect.name: values})  # fmt: skip
    return chain.predict(at)


@pytest.mark.parametrize("effect", LAWS, ids=lambda effect: effect.name)
def test_some_presses_follow_the_law_of_all(effect, whole):
    compliance = 3e-3 * (1 + 0.3 * np.sin(np.arange(25)))
    few = np.arange(10)
    alone = travel(effect, whole.some(few), compliance[few])
    assert_allclose(alone, travel(effect, whole, compliance)[whole.press < 10], rtol=1e-9, atol=0)


def test_a_scan_with_the_scales_of_another_has_its_law(whole):
    """A sensor that loses a tenth of 0.45 N loses it on presses that go to 0.15 N no more."""
    values = {"loss": 0.1, "sharpness": 2.0}
    few = whole.some(np.arange(10))
    own = replace(few, stated=None)
    at = float(few.force_n.max())
    lost = [ForceSaturation().force(r, np.array([at]), **values)[0] / at - 1 for r in (few, own)]
    assert lost[0] == pytest.approx(0.1 * (at / whole.largest_force_n) ** 2)
    assert lost[1] > 5 * lost[0]
