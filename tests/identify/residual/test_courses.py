"""What no effect explains is described: along what it goes, in which quantity, how far."""

import numpy as np
import pytest

from identify.residual.compare import compare_residual
from tests.identify.residual.test_decision import bump, scan_of, since_touch


def wave(scan):
    """A course of the session from 0 to 1 and back, (m,)."""
    t = scan.time_s - scan.time_s.min()
    return np.sin(np.pi * t / t.max()) ** 2


def uneven(scan, seed=3):
    """A level of its own for each press, (m,)."""
    return np.random.default_rng(seed).standard_normal(81)[scan.press_index]


@pytest.mark.parametrize(
    ("plant", "along", "quantity", "size", "says"),
    [
        (lambda s, c: -0.028 * c * wave(s), "session", "force", 0.028, "as a force, up to 28 mN"),
        (lambda s, c: 2e-4 * wave(s), "session", "travel", 2e-4, "as a length"),
        (lambda s, c: 0.12 * c * s.force_n * wave(s), "session", "share", 0.12,
         "as a share of the travel"),
        (lambda s, c: 0.1 * c * s.force_n * np.sin(2 * since_touch(s)), "within", "share", 0.2,
         "the time within a press"),
        (lambda s, c: 0.1 * c * s.force_n * bump(s, 0.06, 0.04, 0.05), "place", "share", 0.1,
         "whenever it is pressed"),
        (lambda s, c: 1.5e-4 * uneven(s), "press", "travel", 7.5e-4, "without a course"),
    ],
)  # fmt: skip
def test_the_course_of_a_residual_is_told(plant, along, quantity, size, says):
    comparison = compare_residual(scan_of(5, plant))
    found = comparison.course
    assert found is not None
    assert (found.along, found.quantity) == (along, quantity)
    # A level of each press's own is a length as well as a force
    assert found.as_good == (("force",) if along == "press" else ())
    if along != "place":  # of which the map takes a part
        assert found.size == pytest.approx(size, rel=0.3)
    assert found.share > 0.7
    assert says in found.words
    if comparison.law is None:
        assert f"{100 * found.share:.0f} % of it goes with {found.words}." in comparison.statement


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_a_mixture_have_no_course(seed):
    def mixture(scan, c):
        creep = 0.12 * c * scan.force_n * (1 - np.exp(-3 * since_touch(scan)))
        return creep + 2.8e-5 * uneven(scan, seed)

    assert compare_residual(scan_of(seed)).course is None
    mixed = compare_residual(scan_of(seed, mixture))
    assert not mixed.is_noise
    assert mixed.course is None
