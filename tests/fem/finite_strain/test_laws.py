"""Presses at finite strain: limits, convergence, derivatives, failures, agreement of methods."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, SolverError, block_mesh
from fem.contact.contacts import PressedSurface, contact_frame, contact_weights, disc_quadrature
from fem.contact.half_space import FLAT
from fem.errors import MeshError
from fem.finite_strain.hyperelastic import Fung, NeoHookean, Yeoh
from fem.finite_strain.load_stepping import NewtonOptions
from fem.finite_strain.model import FiniteStrainModel, LoadNotReached
from fem.finite_strain.tips import DeadPressure, RigidTip
from fem.linear.assembly import shape_functions
from fem.solve.direct import SuperLUSolver

NU = 0.45
SIZE = (0.06, 0.06, 0.03)
CONTACTS = Contacts([(0.03, 0.03, 0.03), (0.021, 0.036, 0.03)], (0, 0, -1), 0.008)
TIGHT = NewtonOptions(rtol=1e-11)
FORCES = np.array([0.3, 0.8, 1.5])
MESH = block_mesh(SIZE, (4, 4, 2))


def model_of(law=None, tip=None, contacts=CONTACTS, **options) -> FiniteStrainModel:
    return FiniteStrainModel(MESH, NU, contacts, law or NeoHookean(), tip=tip, **options)


def modulus_at(points: np.ndarray, weight: float = 9e3, depth: float = 0.02) -> np.ndarray:
    distance = ((points - [0.024, 0.03, depth]) ** 2).sum(axis=1)
    return 6e3 + weight * np.exp(-distance / (2 * 0.007**2))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", [NeoHookean(), Yeoh(2.0), Fung(3.0)], ids=lambda x: str(x)[:4])
def test_a_small_force_gives_the_linear_reading(law, order):
    mesh = block_mesh(SIZE, (4, 4, 2), order=order)
    model = FiniteStrainModel(mesh, NU, CONTACTS, law, options=TIGHT)
    linear = PalpationModel(mesh, NU, CONTACTS, near_field=False)
    modulus = modulus_at(model.points_m)
    compliance = linear.evaluate(modulus_at(linear.points_m)).compliance
    forces = np.array([1e-3, 2e-3, 0.0])
    response = model.evaluate(modulus, forces)
    np.testing.assert_allclose(response.mesh_compliance, compliance, rtol=1e-10)
    departure = response.ratio - 1
    assert (np.abs(departure[:, :2]) < 2e-3).all()
    assert (departure[:, 0] != 0).all()
    # the first departure from proportionality is proportional to the force
    np.testing.assert_allclose(departure[:, 1] / departure[:, 0], 2, rtol=0.1)
    np.testing.assert_array_equal(response.readings_m[:, 2], 0)
    np.testing.assert_array_equal(response.ratio[:, 2], 1)


@pytest.mark.parametrize("tip", [DeadPressure(), RigidTip(2)], ids=["dead", "rigid"])
@pytest.mark.parametrize("mean", [False, True])
def test_newton_converges_quadratically(tip, mean):
    options = NewtonOptions(rtol=1e-12, refactor_above=0)
    model = model_of(Fung(0.5), tip, mean_dilatation=mean, options=options)
    response = model.evaluate(modulus_at(model.points_m), [1.0])
    response.require_complete()
    for j in range(2):
        errors = [e for e in response.errors(j, 0) if 1e-9 < e < 0.05]
        assert len(errors) >= 2
        order = np.log(errors[-1]) / np.log(errors[-2])
        assert order > 1.7
        assert len(response.errors(j, 0)) <= 8


def test_kept_factors_reach_what_newton_reaches_with_fewer_factorisations():
    modulus = modulus_at(model_of().points_m)
    newton = model_of(options=NewtonOptions(rtol=1e-9, refactor_above=0)).evaluate(modulus, FORCES)
    kept = model_of(options=NewtonOptions(rtol=1e-9)).evaluate(modulus, FORCES)
    np.testing.assert_allclose(kept.readings_m, newton.readings_m, rtol=1e-8)
    np.testing.assert_allclose(kept.tangent_compliance, newton.tangent_compliance, rtol=1e-6)
    assert kept.factorizations < newton.factorizations / 2


def test_readings_are_far_closer_than_the_states_that_they_are_read_off():
    modulus = modulus_at(model_of().points_m)
    exact = model_of(options=TIGHT).evaluate(modulus, FORCES).readings_m
    model = model_of()
    response = model.evaluate(modulus, FORCES)
    assert np.abs(response.readings_m / exact - 1).max() < 1e-7
    weights = contact_weights(MESH, CONTACTS)
    off = [
        abs(np.sum(weights[j] * response.displacement(j, level)) / exact[j, level] - 1)
        for j in range(2)
        for level in range(3)
    ]
    assert 1e-7 < max(off) < 1e-4  # else the readings' correction would not be seen here


def test_equilibrium_holds_at_every_node_and_reactions_carry_the_force():
    model = model_of(options=TIGHT)
    modulus = modulus_at(model.points_m)
    response = model.evaluate(modulus, FORCES)
    free = model.body.stiffness.free_nodes
    for j, level in ((0, 2), (1, 1)):
        u = response.displacement(j, level)[free].ravel()
        force, _ = model.body.internal_force(u, modulus)
        # the sum over all free nodes of the external load is the force itself
        total = force.reshape(-1, 3).sum(axis=0)
        np.testing.assert_allclose(total, [0, 0, -FORCES[level]], atol=1e-9)


def test_the_order_of_the_forces_and_the_threads_do_not_matter():
    model = model_of(workers=2)
    modulus = modulus_at(model.points_m)
    up = model.evaluate(modulus, FORCES)
    forces = np.array([FORCES[[2, 0, 1]], FORCES[[1, 2, 0]]])
    mixed = model_of(workers=1).evaluate(modulus, forces)
    np.testing.assert_allclose(mixed.readings_m[0], up.readings_m[0, [2, 0, 1]], rtol=1e-12)
    np.testing.assert_allclose(mixed.readings_m[1], up.readings_m[1, [1, 2, 0]], rtol=1e-12)
    again = model.evaluate(modulus, FORCES)
    np.testing.assert_array_equal(again.readings_m, up.readings_m)


def test_the_portable_solver_gives_the_same_readings():
    modulus = modulus_at(model_of().points_m)
    portable = model_of(solver=SuperLUSolver()).evaluate(modulus, FORCES[:2])
    np.testing.assert_allclose(
        portable.readings_m, model_of().evaluate(modulus, FORCES[:2]).readings_m, rtol=1e-6
    )


@pytest.mark.parametrize("modulus", [6.0e3, 6.1e3, 6.2e3])
def test_a_solution_without_any_error_left_is_taken_whatever_its_sign(modulus):
    # factors in double precision leave an error of rounding size, on either side of zero
    model = model_of(
        tip=RigidTip(2), options=NewtonOptions(rtol=1e-12), solver=SuperLUSolver(), workers=1
    )
    assert model.evaluate(modulus, FORCES[:1]).complete


def test_a_warm_start_saves_work_and_changes_nothing():
    model = model_of(options=NewtonOptions(rtol=1e-9))
    near = model.evaluate(modulus_at(model.points_m), [1.5])
    modulus = modulus_at(model.points_m, weight=9.2e3)
    cold = model.evaluate(modulus, [1.5])
    warm = model.evaluate(modulus, [1.5], start=near)
    np.testing.assert_allclose(warm.readings_m, cold.readings_m, rtol=1e-8)
    assert warm.factorizations <= cold.factorizations
    assert warm.iterations < 0.8 * cold.iterations
    for j in range(2):
        assert warm.errors(j, 0)[0] < 0.1 * cold.errors(j, 0)[0]


def test_a_warm_start_takes_forces_that_are_zero_repeated_and_in_any_order():
    model = model_of(options=NewtonOptions(rtol=1e-9))
    forces = [0.8, 0.0, 0.3, 0.8, 1.5, 0.0]
    near = model.evaluate(modulus_at(model.points_m), forces)
    modulus = modulus_at(model.points_m, weight=9.2e3)
    warm = model.evaluate(modulus, forces, start=near)
    assert warm.complete
    cold = model.evaluate(modulus, forces)
    np.testing.assert_allclose(warm.readings_m, cold.readings_m, rtol=1e-8)
    assert warm.iterations < cold.iterations


@pytest.mark.parametrize("tip", [DeadPressure(), RigidTip(2)], ids=["dead", "rigid"])
@pytest.mark.parametrize("mean", [False, True])
def test_derivatives_by_the_modulus_pass_a_taylor_test(tip, mean):
    model = model_of(Yeoh(0.4), tip, mean_dilatation=mean, options=TIGHT)
    modulus = modulus_at(model.points_m)
    directions = np.random.default_rng(3).uniform(-1, 1, (len(modulus), 2)) * modulus[:, None]
    response = model.evaluate(modulus, FORCES)
    gradient = response.gradient(directions)
    assert gradient.shape == (2, 3, 2)
    for k in range(2):
        remainders = []
        for step in (0.1, 0.05, 0.025):
            moved = model.evaluate(modulus + step * directions[:, k], FORCES, start=response)
            first_order = step * gradient[:, :, k]
            remainders.append(np.abs(moved.readings_m - response.readings_m - first_order))
        slopes = np.log2(np.array(remainders[:-1]) / remainders[1:])
        np.testing.assert_allclose(slopes, 2, atol=0.2)


def test_derivatives_by_force_are_those_of_differences():
    response = model_of(Fung(0.7), options=TIGHT).evaluate(6e3, FORCES)
    up, down = (model_of(Fung(0.7), options=TIGHT).evaluate(6e3, FORCES + s) for s in (1e-3, -1e-3))
    central = (up.readings_m - down.readings_m) / 2e-3
    np.testing.assert_allclose(response.tangent_compliance, central, rtol=1e-4)


def test_accurate_compliances_are_met_at_small_force_and_with_their_derivatives():
    model = model_of(Fung(0.7), options=TIGHT)
    linear = PalpationModel(MESH, NU, CONTACTS)  # with near field

    def readings(weight: float, start=None):
        accurate = linear.evaluate(modulus_at(linear.points_m, weight))
        modulus = modulus_at(model.points_m, weight)
        return model.evaluate(modulus, FORCES, accurate.compliance, start), accurate

    response, accurate = readings(9e3)
    assert (accurate.compliance > 1.1 * response.mesh_compliance).all()
    tiny = model.evaluate(modulus_at(model.points_m), [1e-4], accurate.compliance)
    np.testing.assert_allclose(tiny.readings_m[:, 0], accurate.compliance * 1e-4, rtol=2e-3)
    # the same depth on the mesh has the same ratio
    scaled = FORCES * (accurate.compliance / response.mesh_compliance)[:, None]
    bare = model.evaluate(modulus_at(model.points_m), scaled)
    np.testing.assert_allclose(response.ratio, bare.ratio, rtol=1e-9)
    up, down = (readings(9e3 + s, response)[0].readings_m for s in (20.0, -20.0))
    direction, beside = (
        (modulus_at(points) - 6e3)[:, None] / 9e3 for points in (model.points_m, linear.points_m)
    )
    exact = response.gradient(direction, accurate.gradient(beside))[:, :, 0]
    np.testing.assert_allclose(exact, (up - down) / 40, rtol=1e-4)
    with pytest.raises(SolverError, match="gradient belongs"):
        response.gradient(direction)


@pytest.mark.parametrize("wrong", [[1e-3, 0.0], [-1e-3, 1e-3], [np.nan, 1e-3], [1e-3], 1e-3])
def test_accurate_compliances_that_cannot_be_scaled_to_are_refused(wrong):
    with pytest.raises(SolverError, match="must be 2 positive finite numbers in m/N"):
        model_of().evaluate(6e3, FORCES, np.array(wrong))


def test_a_rigid_tip_keeps_the_surface_flat_where_a_dead_pressure_does_not():
    contacts = Contacts([(0.03, 0.03, 0.03)], (0, 0, -1), 0.012)
    mesh = block_mesh(SIZE, (6, 6, 3))
    surface = PressedSurface(mesh)
    disc, weight = disc_quadrature(FLAT)
    frame = contact_frame(contacts.directions[0])
    under = surface.under(contacts.points_m[0], frame, 0.012 * disc, 0.012)
    shape = shape_functions(under.barycentric, 2)

    def spread(tip) -> np.ndarray:
        """Weighted standard deviation of the displacement under the tip, along x, y, z."""
        model = FiniteStrainModel(mesh, NU, contacts, NeoHookean(), tip=tip, options=TIGHT)
        response = model.evaluate(6e3, [1.5])
        u = np.einsum("pi,pia->pa", shape, response.displacement(0, 0)[surface.faces[under.face]])
        mean = weight @ u
        assert response.readings_m[0, 0] == pytest.approx(-mean[2], rel=1e-10)
        return np.sqrt(weight @ (u - mean) ** 2)

    dead, sliding, sticking = map(spread, (DeadPressure(), RigidTip(6, False), RigidTip(6)))
    assert sliding[2] < 0.3 * dead[2]
    assert sticking[2] < 0.3 * dead[2]
    assert sticking[0] < 0.3 * sliding[0]


def test_a_tip_of_real_size_arrives_at_forty_percent_of_the_height():
    contacts = Contacts([(0.03, 0.03, 0.03)], (0, 0, -1), 0.008)
    model = model_of(tip=RigidTip(2), contacts=contacts)
    response = model.evaluate(6e3, [1.0, 2.0, 4.0, 6.5])
    response.require_complete()
    assert response.readings_m.max() > 0.4 * SIZE[2]
    assert (np.diff(response.readings_m) > 0).all()


def test_a_load_without_equilibrium_says_how_far_it_came():
    contacts = Contacts([(0.03, 0.03, 0.03), (0.012, 0.012, 0.03)], (0, 0, -1), 0.005)
    forces = np.array([[0.2, 0.3], [0.2, 60.0]])
    response = model_of(tip=DeadPressure(), contacts=contacts).evaluate(6e3, forces)
    assert not response.complete
    assert response.messages[0] == ""
    assert response.messages[1]
    assert np.isfinite(response.readings_m[[0, 0, 1], [0, 1, 0]]).all()
    assert np.isnan(response.readings_m[1, 1])
    assert 0.2 <= response.reached_n[1] < 60
    assert response.reached_n[0] == pytest.approx(0.3)
    with pytest.raises(LoadNotReached, match="press 1 stopped at") as caught:
        response.require_complete()
    assert caught.value.response is response
    gradient = response.gradient(np.ones((len(response._modulus), 1)))
    np.testing.assert_array_equal(np.isnan(gradient[:, :, 0]), np.isnan(response.readings_m))
    # where it stopped is where Newton, from below, stops too
    part = model_of(contacts=contacts).evaluate(6e3, [[0.2], [float(response.reached_n[1])]])
    assert part.complete


def test_where_a_load_stops_is_bracketed_with_little_work():
    contacts = Contacts([(0.012, 0.012, 0.03)], (0, 0, -1), 0.005)
    model = model_of(tip=DeadPressure(), contacts=contacts)
    response = model.evaluate(6e3, [[0.2, 4.0]])
    (reached,), smallest = response.reached_n, NewtonOptions().smallest_step * 4.0
    assert 0.2 < reached < 4.0
    beyond = model.evaluate(6e3, [[0.2, float(reached), float(reached) + 2 * smallest]])
    assert not beyond.complete  # nothing that could have been reached was left
    assert response.factorizations < 18


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda m: m.evaluate(-1.0, [1.0]), "modulus must be positive"),
        (lambda m: m.evaluate(6e3, [-1.0]), "not negative"),
        (lambda m: m.evaluate(6e3, [np.nan]), "finite"),
        (lambda m: m.evaluate(6e3, [0.1], start=m.evaluate(6e3, [0.1, 0.2])), "same number"),
    ],
)
def test_what_cannot_be_computed_with_is_refused(run, message):
    with pytest.raises(SolverError, match=message):
        run(model_of())


def test_a_rigid_flat_tip_needs_a_flat_profile():
    round_tip = replace(CONTACTS, profile="hertz")
    with pytest.raises(MeshError, match="profile 'flat'"):
        model_of(tip=RigidTip(), contacts=round_tip)
    with pytest.raises(MeshError, match="degree 1 or more"):
        RigidTip(0)
    model_of(contacts=round_tip).evaluate(6e3, [0.1]).require_complete()


@pytest.mark.parametrize("nu", [0.3, 0.49, 0.4999])
@pytest.mark.parametrize("tip", [DeadPressure(), RigidTip(4)], ids=["dead", "rigid"])
def test_single_precision_of_the_factors_is_not_felt_in_what_is_answered(nu, tip):
    found = []
    for solver in (None, SuperLUSolver()):  # PARDISO in single precision, SuperLU in double
        model = FiniteStrainModel(
                MESH, nu, CONTACTS, NeoHookean(), tip=tip, solver=solver,
                options=NewtonOptions(rtol=1e-6),
            )  # fmt: skip
        response = model.evaluate(modulus_at(model.points_m), FORCES)
        response.require_complete()
        found.append(response)
    for name, rtol in (("mesh_compliance", 1e-9), ("readings_m", 1e-6),
                       ("tangent_compliance", 3e-6)):  # fmt: skip
        np.testing.assert_allclose(*(getattr(r, name) for r in found), rtol=rtol)
