"""A joint fit is carried to the finer model's minimum from wherever its correction was made."""

from dataclasses import replace

import numpy as np
import pytest

from fem import SolverError
from identify.fit.joint_fit import fit_jointly, found_again
from identify.fit.search import Search
from identify.fit.settings import SEARCH
from identify.map.parameters import parameter_space
from tests.identify.select.loop_problem import TRUE, model, scan, timing, true_compliance


@pytest.fixture(scope="module")
def own():
    press, _, _, force = timing(7)
    return model(scan(true_compliance()[press] * force, force, 7))


@pytest.fixture(scope="module")
def found(own):
    return fit_jointly(own, TRUE)


@pytest.mark.parametrize(
    ("weight_pa", "z_m"), [(400e3, 0.0225), pytest.param(1e6, 0.02, marks=pytest.mark.slow)]
)
def test_a_fit_that_ended_under_a_stale_correction_is_carried_on(own, found, weight_pa, z_m):
    far = TRUE.changed({"inclusion_1.weight_pa": weight_pa, "inclusion_1.z_m": z_m})
    stale = fit_jointly(own.corrected(own.start(far)), TRUE, rounds=0)
    away = np.abs(stale.u - found.u) / np.sqrt(np.diag(found.solution.noise_covariance))
    assert away.max() > 5
    again = fit_jointly(stale.model, stale.map)
    assert again.chi2 == pytest.approx(found.chi2, abs=0.1)
    assert again.success is True  # json has no other


def test_a_map_that_the_finer_mesh_cannot_resolve_is_approached_by_shorter_steps(
    monkeypatch, own, found
):
    corrected, refused = Search.corrected, []

    def sometimes(self, model, u):
        if not refused:
            refused.append(u)
            raise SolverError("the map is finer than the mesh around a tip resolves")
        return corrected(self, model, u)

    monkeypatch.setattr(Search, "corrected", sometimes)
    again = fit_jointly(own, TRUE.changed({"background_pa": 4000.0}))
    assert len(refused) == 1
    assert again.chi2 == pytest.approx(found.chi2, abs=0.1)


@pytest.mark.slow
def test_a_hard_grain_is_left_for_an_inclusion_of_ordinary_size(own, found):
    grain = {"inclusion_1.weight_pa": own.space.parameters[1].upper, "inclusion_1.radius_m": 2.5e-3}
    stuck = fit_jointly(own, TRUE.changed(grain), rounds=0, max_evaluations=1)
    assert stuck.at_bound == ("inclusion_1.weight_pa",)
    assert found_again(stuck).chi2 == pytest.approx(found.chi2, abs=0.1)
    assert found_again(found) is found


@pytest.mark.slow
def test_a_void_is_left_for_a_soft_inclusion_of_ordinary_size():
    # A soft ball of a blind trial ended as a void, "not found", 39 above the best chi-square
    soft = TRUE.changed({"inclusion_1.weight_pa": -3000.0})
    press, _, _, force = timing(7)
    own = model(scan(true_compliance(soft.modulus)[press] * force, force, 7))
    own = replace(own, space=parameter_space(soft, own.mechanics.coarse.mesh.box_m))
    found = fit_jointly(own, soft)
    void = soft.changed(
        {"inclusion_1.weight_pa": own.space.parameters[1].lower, "inclusion_1.z_m": 0.012}
    )
    # Where its own correction holds it
    stuck = fit_jointly(own.corrected(own.start(void)), void, rounds=0, max_evaluations=1)
    assert stuck.map.inclusions[0].weight_pa < -0.9 * stuck.map.background_pa
    assert stuck.chi2 > found.chi2 + 100
    assert found_again(stuck).chi2 == pytest.approx(found.chi2, abs=0.5)
    assert found_again(found) is found


def test_a_valley_that_a_mesh_cannot_resolve_ends_an_interval_and_not_the_run(monkeypatch, found):
    def never(self, model, u, carried=True):
        raise SolverError("the map is finer than the mesh around a tip resolves")

    monkeypatch.setattr(Search, "corrected", never)
    plain, curved = found.intervals(curved=False), found.intervals(curved=True)
    for name in TRUE.names:
        assert curved[name].lower95 <= plain[name].value <= curved[name].upper95


def test_a_rough_valley_takes_no_more_than_its_evaluations(monkeypatch, own):
    corrected, made = Search.corrected, []

    def restless(self, model, u):
        """A correction that never agrees with the one before."""
        made.append(self.spent)
        other = corrected(self, model, u)
        scale = 1.3 if len(made) % 2 else 1 / 1.3
        own = other.mechanics.correction
        mechanics = replace(other.mechanics, correction=replace(own, ratio=scale * own.ratio))
        return replace(other, mechanics=mechanics)

    monkeypatch.setattr(Search, "corrected", restless)
    fit_jointly(own, TRUE, max_evaluations=2)
    begun = [spent for spent in made if spent > replace(SEARCH, max_evaluations=2).most_spent]
    assert len(begun) <= 2  # the correction of the record, and that of a round begun before
