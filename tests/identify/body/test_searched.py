"""What a search takes in place of full solutions, against full solutions of the same meshes."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.palpation import Response
from identify.body.mechanics import BodyMechanics
from identify.map.gaussian_map import GaussianMap, Inclusion, Shape

SIZE = (0.06, 0.06, 0.03)
MAP = GaussianMap(5000.0, (Inclusion(15000.0, 0.024, 0.032, 0.021, 0.008),))
STEPS = np.array([250.0, 1500.0, 1e-3, 1e-3, 1e-3, 4e-4])


def moved(amount: float, seed: int = 1) -> GaussianMap:
    steps = amount * STEPS * np.random.default_rng(seed).uniform(-1, 1, 6)
    return GaussianMap.from_values(MAP.values + steps)


@pytest.fixture(scope="module")
def models():
    points = [(x, y, 0.03) for x in (0.018, 0.042) for y in (0.018, 0.040)]
    contacts = Contacts(np.array(points), np.array([0, 0, -1.0]), np.array(0.005))
    coarse, fine = (
        PalpationModel(block_mesh(SIZE, cells), 0.45, contacts) for cells in ((4, 4, 2), (6, 6, 3))
    )
    return coarse, RefinedModel(coarse, fine)


@pytest.fixture
def mechanics(models):
    """Mechanics that know no solution yet."""
    return BodyMechanics.of(*models)


def counted(monkeypatch, model: PalpationModel) -> list[int]:
    """Return a list that grows with every full solution of a model."""
    solved, evaluate = [], model.evaluate
    monkeypatch.setattr(
        model, "evaluate", lambda *a, **k: solved.append(1) or evaluate(*a, **k), raising=True
    )
    return solved


@pytest.mark.slow
def test_a_base_that_gives_way_is_that_of_the_finer_mesh(models):
    contacts = models[0].contacts
    meshes = [(4, 4, 2), (6, 6, 3), (8, 8, 4), (12, 12, 6)]
    coarse, fine, *finer = (PalpationModel(block_mesh(SIZE, n), 0.49, contacts) for n in meshes)
    own, reference = BodyMechanics.of(coarse, RefinedModel(coarse, fine)), RefinedModel(*finer)
    state = own.state().changed(base_tangential_m_per_pa=4e-6)
    true = reference.evaluate(MAP.modulus(reference.points_m), (0.0, 4e-6)).compliance
    of_firm = own.corrected(MAP, own.state())
    firm = of_firm.evaluate(MAP, state).compliance
    exact = own.corrected(MAP, state)
    assert of_firm.counts_support(own.state())
    assert not of_firm.counts_support(state)
    assert exact.counts_support(state)
    assert np.abs(firm / true - 1).max() > 0.015
    assert np.abs(exact.evaluate(MAP, state).compliance / true - 1).max() < 0.004
    # Nearby the error follows the base's effect, and so does the derivative
    near, beside = (state.changed(base_tangential_m_per_pa=b) for b in (4.6e-6, 4.01e-6))
    assert own.corrected(MAP, near, slack=1.0).correction.support is exact.correction.support
    carried, finer_there = (
        m.evaluate(MAP, near).compliance for m in (exact, own.corrected(MAP, near))
    )
    assert carried == pytest.approx(finer_there, rel=1e-3, abs=0)
    here, there = (exact.evaluate(MAP, s) for s in (state, beside))
    by_base = here.change(beside)[0]
    assert by_base == pytest.approx(there.compliance - here.compliance, rel=0.01)
    assert exact.evaluate(MAP, own.state()).compliance == pytest.approx(
        own.corrected(MAP, own.state()).evaluate(MAP, own.state()).compliance, rel=1e-12
    )


def test_a_search_takes_the_reduced_basis_within_its_tolerance(mechanics, monkeypatch):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    solved = counted(monkeypatch, mechanics.coarse)
    state = mechanics.state().changed(inclusion_shape=Shape(edge=0.01))
    for stiffness, body in ((moved(0.02), mechanics.state()), (MAP, state)):
        near = mechanics.evaluate(stiffness, body, slack=1.0)
        by_map, (change, _) = near.by_map, near.change(state)
        assert not solved
        full = mechanics.evaluate(stiffness, body)
        assert len(solved) == 1
        solved.clear()
        tolerance = mechanics.settings.reduced_error
        assert near.compliance == pytest.approx(full.compliance, rel=tolerance, abs=0)
        assert near.compliance.tolist() != full.compliance.tolist()
        largest = np.abs(full.by_map).max(axis=0)
        assert by_map / largest == pytest.approx(full.by_map / largest, abs=0.02)
        assert change == pytest.approx(full.change(state)[0], rel=0.02, abs=1e-9)


def test_a_far_map_is_solved_in_full_and_joins(mechanics, monkeypatch):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    solved = counted(monkeypatch, mechanics.coarse)
    for _ in range(2):
        far = mechanics.evaluate(moved(1.0), mechanics.state(), slack=1.0)
        mechanics._solutions.clear()
    assert len(solved) == 1
    full = mechanics.evaluate(moved(1.0), mechanics.state()).compliance
    assert far.compliance == pytest.approx(full, rel=3e-6)


LAWS = [
    {"skin_thickness_m": 1e-3, "skin_factor": 2.0},
    {"base_normal_m_per_pa": 1e-6},
    {"base_tangential_m_per_pa": 1e-6},
]


@pytest.mark.parametrize("law", LAWS)
def test_springs_and_skins_have_bases_too(mechanics, monkeypatch, law):
    plain = mechanics.state()
    mechanics.evaluate(MAP, plain)
    for size in (0.5, 1.0):
        mechanics.evaluate(MAP, scaled(plain, law, size), slack=10.0)
    solved = counted(monkeypatch, mechanics.coarse)
    state = scaled(plain, law, 0.8)
    near = mechanics.evaluate(moved(0.02), state, slack=10.0)
    changes = [near.change(other)[0] for other in (plain, scaled(plain, law, 0.81))]
    assert not solved
    full = mechanics.evaluate(moved(0.02), state)
    tolerance = 10 * mechanics.settings.reduced_error
    assert near.compliance == pytest.approx(full.compliance, rel=tolerance, abs=0)
    assert near.compliance.tolist() != full.compliance.tolist()
    for change, other in zip(changes, (plain, scaled(plain, law, 0.81)), strict=True):
        assert change == pytest.approx(full.change(other)[0], rel=0.03)


@pytest.mark.parametrize("law", LAWS)
def test_at_the_null_springs_and_skins_need_no_solution(mechanics, monkeypatch, law):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    state = scaled(mechanics.state(), law, 0.01)
    null = mechanics.evaluate(moved(0.01), mechanics.state(), slack=1.0)
    solved = counted(monkeypatch, mechanics.coarse)
    change = null.change(state)[0]
    assert not solved
    full = mechanics.evaluate(moved(0.01), mechanics.state())
    assert change == pytest.approx(full.change(state)[0], rel=2e-3)


def test_fibres_are_solved_in_full(mechanics):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    state = mechanics.state().changed(fibre_share=0.1)
    near = mechanics.evaluate(MAP, state, slack=1.0).compliance
    assert near.tolist() == mechanics.evaluate(MAP, state).compliance.tolist()
    null = mechanics.evaluate(moved(0.01), mechanics.state(), slack=1.0)
    full = mechanics.evaluate(moved(0.01), mechanics.state())
    assert null.change(state)[0] == pytest.approx(full.change(state)[0], rel=1e-3)


def scaled(state, law: dict[str, float], size: float):
    """Return a state with a law of that size; a skin keeps its thickness."""
    null = {"skin_factor": 1.0}
    sized = {
        key: value if key == "skin_thickness_m" else null.get(key, 0.0) * (1 - size) + size * value
        for key, value in law.items()
    }
    return state.changed(**sized)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_correction_is_carried_only_where_it_is_sure(mechanics, monkeypatch, seed):
    state = mechanics.state()
    assert not mechanics.corrected(MAP, state, slack=1.0).correction.carried
    solved = counted(monkeypatch, mechanics.fine.fine)
    near = mechanics.corrected(moved(0.1, seed), state, slack=1.0).correction
    assert near.carried
    assert not solved
    exact = mechanics.corrected(moved(0.1, seed), state).correction
    assert not exact.carried
    assert len(solved) == 1
    assert near.ratio == pytest.approx(exact.ratio, rel=mechanics.settings.ratio_error, abs=0)
    assert np.abs(near.ratio - mechanics.corrected(MAP, state).correction.ratio).max() > 3e-5
    assert near.model_error == pytest.approx(exact.model_error, rel=0.2)
    assert near.tip.gain == pytest.approx(exact.tip.gain, rel=0.2)
    solved.clear()
    mechanics._corrections._fine.clear()
    mechanics.corrected(MAP, state)
    assert not mechanics.corrected(moved(8.0, seed), state, slack=1.0).correction.carried
    assert len(solved) == 2


def test_with_slack_the_error_is_larger_and_still_bounded(mechanics):
    state, slack = mechanics.state().changed(poisson_ratio=0.46), 10.0
    mechanics.evaluate(MAP, state, slack=1.0)
    for stiffness in (moved(0.05), moved(0.1, 2)):
        near = mechanics.evaluate(stiffness, state, slack=slack).compliance
        aside = replace(mechanics, _ratios={}, _reduced_ratios={}, _solutions={})
        full = aside.evaluate(stiffness, state)
        tolerance = slack * (mechanics.settings.ratio_error + mechanics.settings.reduced_error)
        assert near == pytest.approx(full.compliance, rel=tolerance, abs=0)
        assert np.abs(near / full.compliance - 1).max() > 1e-7


@pytest.mark.parametrize(
    "change", [{"poisson_ratio": 0.46}, {"shift_m": (8e-4, -5e-4)}], ids=["poisson", "elsewhere"]
)
def test_a_search_solves_other_models_for_a_few_maps_alone(mechanics, monkeypatch, change):
    state, slack = mechanics.state().changed(**change), 10.0
    for seed in range(1, 9):
        mechanics.evaluate(moved(0.3, seed), state, slack=slack)
    (ratios,) = mechanics._reduced_ratios.values()
    solved = [counted(monkeypatch, bases.full) for bases in ratios._others.values()]
    assert len(solved) == (2 if "poisson_ratio" in change else 4)
    tolerance = slack * (mechanics.settings.ratio_error + mechanics.settings.reduced_error)
    for stiffness in (moved(0.1, 9), moved(0.1, 10)):
        near = mechanics.evaluate(stiffness, state, slack=slack)
        slope = near.change(mechanics.state())[0]
        assert not any(solved)
        exact = replace(mechanics, _ratios={}, _reduced_ratios={}, _solutions={})
        full = exact.evaluate(stiffness, state)
        assert near.compliance == pytest.approx(full.compliance, rel=tolerance, abs=0)
        step = full.change(mechanics.state())[0]
        assert slope == pytest.approx(step, abs=0.02 * np.abs(step).max())
        for each in solved:
            each.clear()  # the full evaluation's


def test_with_much_slack_skins_take_the_ratio_of_the_plain_body(mechanics, monkeypatch):
    state = mechanics.state().changed(poisson_ratio=0.46)
    mechanics.evaluate(MAP, state, slack=30.0)
    other = counted(monkeypatch, mechanics._other(0.47))
    skin = state.changed(skin_thickness_m=1e-3, skin_factor=3.0)
    near = mechanics.evaluate(MAP, skin, slack=30.0).compliance
    assert not other
    full = mechanics.evaluate(MAP, skin).compliance
    assert other
    assert near == pytest.approx(full, rel=5e-3, abs=0)
    plain = mechanics.evaluate(MAP, state).compliance
    assert np.abs(full / plain - 1).min() > 0.02


def test_a_response_outlives_its_basis(mechanics):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    near = mechanics.evaluate(moved(0.02), mechanics.state(), slack=1.0)
    state = mechanics.state().changed(inclusion_shape=Shape(edge=0.01))
    before = near.change(state)[0]
    mechanics._bases.clear()
    assert near._response.is_stale  # pyright: ignore[reportAttributeAccessIssue]
    assert near.change(state)[0] == pytest.approx(before, rel=0.02, abs=1e-9)
    assert near.by_map.shape == (4, 6)


def test_ratios_of_several_maps_are_kept(mechanics, monkeypatch):
    state = mechanics.state().changed(poisson_ratio=0.46)
    other = counted(monkeypatch, mechanics._other(0.47))
    for stiffness in (MAP, moved(2.0), moved(0.01), moved(2.0), MAP):
        mechanics._ratios.clear()
        mechanics.evaluate(stiffness, state, slack=1.0)
    assert len(other) == 2


def test_mechanics_of_one_model_share_their_bases(mechanics, monkeypatch):
    mechanics.evaluate(MAP, mechanics.state(), slack=1.0)
    again = BodyMechanics.of(mechanics.coarse).sharing(mechanics)
    other = BodyMechanics.of(mechanics.fine.fine).sharing(mechanics)
    solved = counted(monkeypatch, mechanics.coarse)
    near = again.evaluate(moved(0.01), again.state(), slack=1.0).compliance
    assert not solved
    assert near == pytest.approx(again.evaluate(moved(0.01), again.state()).compliance, rel=1e-5)
    assert not other._bases
    assert not other._solutions


def test_fibres_go_with_the_map_in_full_solutions_and_in_bases(mechanics):
    state = mechanics.state().changed(fibre_share=0.4, fibre_angle_rad=0.5)
    at = mechanics.evaluate(MAP, state)
    for column, step in enumerate(1e-3 * STEPS):
        values = MAP.values.copy()
        up, down = (
            mechanics.evaluate(
                GaussianMap.from_values(values + sign * step * (np.arange(6) == column)), state
            ).compliance
            for sign in (1, -1)
        )
        slope = (up - down) / (2 * step)
        assert np.abs(at.by_map[:, column] - slope).max() < 0.01 * np.abs(slope).max()
    mechanics.evaluate(MAP, state, slack=10.0)
    near = mechanics.evaluate(moved(0.1), state, slack=10.0)
    assert not isinstance(near._response, Response)
    full = mechanics.evaluate(moved(0.1), state)
    assert near.compliance == pytest.approx(full.compliance, rel=1e-4)
    assert np.all(
        np.abs(near.by_map - full.by_map).max(axis=0) < 0.05 * np.abs(full.by_map).max(axis=0)
    )


def test_a_model_elsewhere_that_has_solutions_is_not_made_again(mechanics, monkeypatch):
    state = mechanics.state().changed(shift_m=(8e-4, 0.0))
    mechanics.evaluate(MAP, state, slack=1.0)
    (ratios,) = mechanics._reduced_ratios.values()
    solved = [counted(monkeypatch, bases.full) for bases in ratios._others.values()]
    mechanics.shifted._models.clear()
    mechanics.evaluate(moved(8.0), state, slack=1.0)
    assert len(solved) == 2
    assert all(len(each) == 1 for each in solved)
    assert not mechanics.shifted._models
