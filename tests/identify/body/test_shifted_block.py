"""A body that lies elsewhere than stated: its models, its effect, and the laboratory's own way."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.mesh.block import moved_sides
from fem.mesh.checks import check_mesh
from fem.mesh.mesh import Mesh
from fem.solve.direct import SuperLUSolver
from identify.body.mechanics import BodyMechanics
from identify.body.shifted_block import ShiftedBlock
from identify.catalogue.body_shift import BodyShift
from identify.effects.conformance.example_scan import trial
from identify.optimize.result import InadmissibleError
from sim.body.block_compliance import block_compliance
from sim.body.true_body import HiddenBody
from sim.body.true_map import Inclusion, TruthMap
from sim.planted.body import body_shift
from tests.identify.select import loop_problem as problem

SHIFT = (0.0023, -0.0014)


def moved_compliance() -> np.ndarray:
    """Of `true_compliance`'s block moved as a whole under the presses."""
    meshes = (block_mesh(problem.SIZE, n, split="alternating") for n in ((6, 6, 4), (10, 10, 6)))
    moved = (Mesh(m.nodes + np.array([*SHIFT, 0.0]), m.cells, m.surfaces) for m in meshes)
    model = RefinedModel(*(PalpationModel(m, problem.NU, problem.contacts()) for m in moved))
    return model.evaluate(problem.TRUE.modulus(model.points_m)).compliance


def test_sides_move_and_the_middle_stays():
    mesh = block_mesh(problem.SIZE, (6, 4, 3))
    moved = moved_sides(mesh, SHIFT)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    np.testing.assert_allclose(moved.nodes.min(axis=0), low + np.array([*SHIFT, 0]))
    np.testing.assert_allclose(moved.nodes.max(axis=0), high + np.array([*SHIFT, 0]))
    middle = np.isclose(mesh.nodes[:, :2], (low + high)[:2] / 2).all(axis=1)
    assert middle.any()
    np.testing.assert_array_equal(moved.nodes[middle], mesh.nodes[middle])
    assert moved.cell_volumes.min() > 0
    assert moved.volume == pytest.approx(mesh.volume)


def test_nodes_farther_from_the_sides_than_the_moved_layers_stay():
    mesh = block_mesh(problem.SIZE, (6, 6, 3))  # cells of 10 mm
    moved = moved_sides(mesh, SHIFT)
    apart = np.minimum(mesh.nodes, problem.SIZE - mesh.nodes)[:, :2].min(axis=1)
    inner = apart > 0.0101
    assert 0 < inner.sum() < len(inner)
    np.testing.assert_array_equal(moved.nodes[inner], mesh.nodes[inner])


def test_nodes_in_the_middle_of_edges_stay_there_where_edges_cross_the_middle():
    check_mesh(moved_sides(block_mesh((0.06, 0.05, 0.03), (3, 3, 2)), SHIFT))


def test_the_models_of_the_body_elsewhere_are_made_like_that_of_the_body_as_stated():
    contacts = Contacts([(0.03, 0.03, 0.03)], (0, 0, -1), 0.005)
    solver = SuperLUSolver()
    mesh = block_mesh((0.06, 0.06, 0.03), (4, 4, 2))
    stated = PalpationModel(
        mesh, 0.45, contacts, near_field=False, solver=solver, skin_surface="x0"
    )
    moved = ShiftedBlock(stated, None).coarse_at((0.001, 0.0))
    assert moved.enrichment is None
    assert moved._solver is solver
    assert moved._skin_surface == "x0"


def test_the_models_last_used_are_kept_and_no_more():
    stated = PalpationModel(
        block_mesh((0.06, 0.06, 0.03), (4, 4, 2)),
        0.45,
        Contacts([(0.03, 0.03, 0.03)], (0, 0, -1), 0.005),
        near_field=False,
    )
    elsewhere = ShiftedBlock(stated, None)
    first = elsewhere.coarse_at((0.001, 0.0))
    second = elsewhere.coarse_at((0.002, 0.0))
    for place in range(3, 8):
        assert elsewhere.coarse_at((0.001, 0.0)) is first
        elsewhere.coarse_at((0.001 * place, 0.0))
    assert elsewhere.coarse_at((0.001, 0.0)) is first
    assert elsewhere.coarse_at((0.002, 0.0)) is not second


@pytest.mark.slow
def test_a_shifted_body_has_the_compliances_of_one_that_was_moved_as_a_whole():
    own = problem.mechanics()
    state = own.state().changed(shift_m=SHIFT)
    plain = own.evaluate(problem.TRUE, own.state()).compliance
    truth, unmoved = moved_compliance(), problem.true_compliance()
    shift = np.abs(np.log(truth / unmoved))
    assert shift.max() > 0.02
    near = np.abs(np.log(own.evaluate(problem.TRUE, state).compliance / plain)
                  - np.log(truth / unmoved))  # fmt: skip
    assert near.max() < 0.08 * shift.max()  # by the coarse models at their places
    carried = own.corrected(problem.TRUE, state).evaluate(problem.TRUE, state).compliance
    assert np.abs(np.log(carried / truth)).max() < 0.0025  # with finer ones at this place


@pytest.mark.slow
def test_first_order_change_of_the_place_is_that_of_the_models():
    own = problem.mechanics()
    own.forget_others()  # ratios that earlier tests have left are linear ones
    at = own.evaluate(problem.TRUE, own.state())
    for shift in ((4e-4, 0.0), (0.0, -4e-4)):
        predicted, _ = at.change(own.state().changed(shift_m=shift))
        found, _ = at.exact_change(own.state().changed(shift_m=shift))
        assert np.linalg.norm(predicted - found) < 0.1 * np.linalg.norm(found)
        at.forget_other_models()  # they are made again when they are asked for
        again, _ = at.change(own.state().changed(shift_m=shift))
        np.testing.assert_allclose(again, predicted, rtol=1e-9)
    small, slack = own.state().changed(shift_m=(2e-4, 0.0)), own.settings.straight_slack
    found, chord = (own.evaluate(problem.TRUE, small, s).compliance - at.compliance
                    for s in (0.5 * slack, slack))  # fmt: skip
    assert 1e-6 < np.linalg.norm(chord - found) / np.linalg.norm(found) < 0.1
    there = own.evaluate(problem.TRUE, own.state().changed(shift_m=SHIFT))
    further = own.state().changed(shift_m=(SHIFT[0] + 1e-5, SHIFT[1]))
    predicted, _ = there.change(further)
    found, _ = there.exact_change(further)
    np.testing.assert_allclose(predicted, found, rtol=1e-3, atol=1e-3 * np.abs(found).max())


def test_bounds_keep_the_tips_on_the_body():
    own, effect = trial(), BodyShift()
    x, y = effect.bounded(own.readings, own.state)
    gap = 0.012 - 0.005  # of the outermost presses' rims
    assert (-x.lower, x.upper) == pytest.approx((0.95 * gap, 0.95 * gap))
    assert (y.lower, y.upper) == (x.lower, x.upper)
    further = replace(own.readings, point_m=own.readings.point_m + np.array([0.003, 0, 0]))
    x, y = effect.bounded(further, own.state)
    assert (-x.lower, x.upper) == pytest.approx((0.95 * (gap - 0.003), 0.95 * (gap + 0.003)))


def test_no_shift_is_asked_for_where_a_tip_stands_at_an_edge_or_the_body_is_no_block():
    mesh = block_mesh(problem.SIZE, (5, 5, 3))
    edge = Contacts([(0.004, 0.03, problem.SIZE[2])], (0, 0, -1), 0.004)
    round_body = Mesh(mesh.nodes, mesh.cells, {n: mesh.surfaces[n] for n in ("top", "base")})
    for body, contacts, reason in (
        (mesh, edge, "a tip stands at an edge"),
        (round_body, problem.contacts(), "only a block"),
    ):
        model = PalpationModel(body, problem.NU, contacts)
        own = BodyMechanics(model, None, lambda nu, model=model: model)
        at = own.evaluate(problem.TRUE, own.state())
        with pytest.raises(InadmissibleError, match=reason):
            at.change(own.state().changed(shift_m=(1e-3, 0.0)))


def test_the_laboratory_moves_the_body_under_presses_and_inclusions():
    spot = Inclusion(12e3, (0.040, 0.048, 0.040), 0.008)
    presses = np.array([[0.014, 0.048], [0.040, 0.048], [0.082, 0.048]])
    radius, divisions = np.full(3, 0.005), (10, 10, 5)
    stated = HiddenBody(truth=TruthMap(6e3, (spot,)))
    body = body_shift.body(stated, {"angle_rad": np.pi, "distance_m": 0.004})
    assert body.shift_m == pytest.approx((-0.004, 0.0))
    moved = block_compliance(body, presses, radius, divisions=divisions)
    still = block_compliance(stated, presses, radius, divisions=divisions)
    # its high side has come nearer to the last press, its low side gone from the first
    assert moved[0] < 0.97 * still[0]
    assert moved[1] == pytest.approx(still[1], rel=0.01)
    assert moved[2] > 1.03 * still[2]
    # the same body with its spot and the presses moved the other way
    other = HiddenBody(truth=TruthMap(6e3, (replace(spot, centre_m=(0.044, 0.048, 0.040)),)))
    same = block_compliance(other, presses + np.array([0.004, 0.0]), radius, divisions=divisions)
    np.testing.assert_allclose(moved, same, rtol=1e-12)
