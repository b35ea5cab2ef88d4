"""Beside a structured residual an effect is offered only where the rest cannot be its cause."""

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.select.forward_selection import forward_selection
from identify.select.standing import Parts, effect_part
from tests.identify.select.loop_problem import TRUE, model
from tests.identify.select.test_forward_selection import planted

EFFECTS = [CATALOGUE[n] for n in ("hysteresis", "force_wander", "contact_offset", "force_bias")]


def warmer(d, f, t, phase, press):
    """A body that stiffens and softens again while the room cools and warms."""
    return d * (1 - 0.12 * np.sin(np.pi * (t - t.min()) / np.ptp(t)) ** 2), f


def loop(d, f, t, phase, press):
    """A loop of 8 % of the largest travel, the way back a parabola."""
    top = np.array([d[press == p].max() for p in range(press.max() + 1)])[press]
    return d + 0.3 * d * (1 - d / top) * (phase == "unload"), f


def both(d, f, t, phase, press):
    return loop(*warmer(d, f, t, phase, press), t, phase, press)


@pytest.fixture(scope="module")
def found():
    table = planted(12, both)
    return forward_selection(model(table), TRUE, table, EFFECTS)


def test_an_imitation_of_the_unknown_cause_is_not_offered(found):
    assert found.verdict == "unexplained"
    assert "force_wander" in [a.name for a in found.accepted]
    # The loop lies within the presses, where the rest is noise; the wander between them
    assert found.added == ("hysteresis",)


def test_the_parts_of_a_reading_add_up_and_are_orthogonal(found):
    fit = found.final.fit
    parts, values = Parts.of(fit), np.random.default_rng(1).standard_normal(len(fit.residual_m))
    between = parts.between(values)
    assert between @ (values - between) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(parts.between(between), between, atol=1e-12)
    press, sigma = fit.model.readings.press, fit.at.sigma_m
    gains = np.random.default_rng(2).standard_normal(fit.model.readings.presses)[press]
    own = (gains + gains**2 * fit.at.latent_force_n) / sigma
    np.testing.assert_allclose(parts.between(own), own, atol=1e-9 * np.abs(own).max())


def test_the_part_of_an_effect_is_what_its_removal_would_leave(found):
    fit = found.final.fit
    name = fit.effect_names[0]
    part = effect_part(fit, name)
    own = [i for i, unknown in enumerate(fit.model.names) if not unknown.startswith(f"{name}.")]
    assert np.abs(fit.at.jacobian[:, own].T @ part).max() < 1e-6 * np.linalg.norm(part) * max(
        np.linalg.norm(fit.at.jacobian[:, own], axis=0)
    )
    removed = float(np.sum((fit.at.residual + part) ** 2))
    assert removed > fit.chi2 + 50
