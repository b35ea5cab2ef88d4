"""Effects by other laws than those of the catalogue: the family is found, and no false name."""

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.select.forward_selection import forward_selection
from tests.identify.select.loop_problem import TRUE, model, points
from tests.identify.select.test_forward_selection import planted

LIKE = [CATALOGUE[name] for name in (
    "strain_stiffening", "viscoelasticity", "two_time_creep", "power_law_creep", "local_creep",
    "creep_recovery", "side_creep", "preconditioning", "preconditioning_nearby",
    "free_preconditioning", "hysteresis", "force_drift", "sensitivity_drift", "sensitivity_wander",
    "contact_offset",
)]  # fmt: skip
"""Creep and softening, and what looks like them."""


def crept(d, t, own, share, taus):
    """Travel of one press with creep after a step to each force, added step by step."""
    out, rises = d[own].copy(), np.diff(d[own], prepend=0.0)
    # each rise is spread over its step in time: its middle
    begin = t[own] - 0.5 * np.diff(t[own], prepend=t[own][0] - (t[own][1] - t[own][0]))
    for i, row in enumerate(own):
        age = np.maximum(t[row] - begin[: i + 1], 0)
        out[i] += share * np.sum(rises[: i + 1] * sum(1 - np.exp(-age / tau) for tau in taus))
    return out


def three_times(d, f, t, phase, press):
    """Creep with 0.08, 0.5 and 3 s."""
    out = d.copy()
    for j in np.unique(press):
        own = np.flatnonzero(press == j)
        out[own] = crept(d, t, own, 0.05, (0.08, 0.5, 3.0))
    return out, f


def one_side(d, f, t, phase, press):
    """Creep of 30 % with 0.6 s where x + y / 2 exceeds 40 mm, and none elsewhere."""
    place, out = points()[press], d.copy()
    for j in np.unique(press[place[:, 0] + place[:, 1] / 2 > 0.04]):
        own = np.flatnonzero(press == j)
        out[own] = crept(d, t, own, 0.3, (0.6,))
    return out, f


def logarithmic_zero(d, f, t, phase, press):
    since = (t - t.min()) / np.ptp(t)
    return d, f + 0.03 * np.log1p(15 * since) / np.log(16)


def several_plays(d, f, t, phase, press):
    out = d.copy()
    for j in np.unique(press):
        own = np.flatnonzero(press == j)
        for width in (0.03, 0.06, 0.12):
            half, state = width * d[own].max(), 0.0
            for row in own:
                state = min(max(state, d[row] - half), d[row] + half)
                out[row] += 0.15 * (state - d[row])
    return out, f


def straightening(d, f, t, phase, press):
    """Depth y tips wide of y + y^3 / 2 = u: hardly stiffer at first, and then ever more."""
    x = d / 4e-3
    return 4e-3 * np.array([np.roots([0.5, 0, 1, -one])[-1].real for one in x]), f


def yielding(d, f, t, phase, press):
    """A sensor that reads 85 % of what exceeds 60 % of the largest force."""
    return d, f - 0.15 * np.maximum(f - 0.6 * f.max(), 0)


def settling(d, f, t, phase, press):
    """Softening by the same step a press, for eight presses, and then none."""
    return d * (1 + 0.15 * np.minimum(press / 8, 1)), f


def test_softening_that_ends_at_once_is_no_wander_of_the_sensor():
    table = planted(8, settling)
    found = forward_selection(model(table), TRUE, table, LIKE)
    groups = [[name] for name in found.added] + list(found.ambiguous)
    assert len(groups) == 1
    assert "preconditioning" in {CATALOGUE[name].family for name in groups[0]}
    assert found.final.fit.chi2_per_dof < 1.2


@pytest.mark.parametrize(
    ("change", "family"),
    [
        (three_times, "viscoelasticity"),
        pytest.param(straightening, "strain_stiffening", marks=pytest.mark.slow),
        pytest.param(yielding, "force_saturation", marks=pytest.mark.slow),
        pytest.param(logarithmic_zero, "force_drift", marks=pytest.mark.slow),
    ],
)
def test_a_foreign_form_is_named_by_its_family(change, family):
    table = planted(8, change)
    found = forward_selection(model(table), TRUE, table, list(CATALOGUE))
    assert {CATALOGUE[name].family for name in found.added} == {family}
    assert found.verdict == "explained"
    assert all(effect.decided for effect in found.accepted)


@pytest.mark.slow
def test_creep_on_one_side_is_named_with_its_side():
    table = planted(8, one_side)
    found = forward_selection(model(table), TRUE, table, LIKE)
    assert (found.verdict, found.added) == ("explained", ("side_creep",))
    values = found.final.fit.at.values["side_creep"]
    towards = np.array([np.cos(values["angle_rad"]), np.sin(values["angle_rad"])])
    creeps = (points()[:, :2] - 0.03) @ towards > values["edge_m"]
    assert np.mean(creeps == (points()[:, :2] @ (1, 0.5) > 0.04)) >= 0.95


@pytest.mark.slow
def test_plays_of_other_widths_are_named_beside_friction_that_does_the_same():
    table = planted(8, several_plays)
    found = forward_selection(model(table), TRUE, table, list(CATALOGUE))
    assert found.verdict == "ambiguous"
    ((*group,),) = found.ambiguous
    assert set(group) == {"guide_friction", "play", "several_plays"}
    assert found.final.fit.chi2_per_dof < 1.1
