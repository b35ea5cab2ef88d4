"""Fit of a map under balls, whose contact grows, to a body of other meshes and another law."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.palpation import by_contact_radius
from identify.body.mechanics import BodyMechanics
from identify.body.response import BodyResponse
from identify.fit.start_map import fit_map
from identify.map.gaussian_map import GaussianMap
from identify.measurement.experiment import BodyModel, MapGuess, PlacedExperiment, contacts_of
from identify.measurement.noise import Noise
from models.scan import Scan
from sim.body.soft_body import SoftBody
from sim.motion.tip import Tip

SIZE, NU, E = (0.06, 0.06, 0.016), 0.45, 8000.0
NOISE = Noise(1e-5, 1e-3)
LUMP = np.array([E, 3 * E, 0.02, 0.03, 0.009, 0.005])


def pressed_by_balls() -> Scan:
    """Presses of two balls on an even block, 0.3 to 0.6 radii deep."""
    x, y = np.meshgrid((0.02, 0.04), (0.02, 0.03, 0.04))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(6, SIZE[2])])
    radii, forces = np.tile((3e-3, 7e-3), 3), np.tile((0.05, 0.3), 3)
    down = np.tile([0.0, 0.0, -1.0], (6, 1))
    body = SoftBody(
        SIZE, lambda at: np.full(len(at), E), NU, [Tip("ball", r) for r in radii], points, down,
        divisions=(10, 10, 5), force_n=forces,
    )  # fmt: skip
    rng, share = np.random.default_rng(3), np.linspace(0.05, 1, 12)
    press = np.repeat(np.arange(6), len(share))
    force = np.tile(share, 6) * forces[press]
    travel = np.array([body.displacement(j, f) for j, f in zip(press, force, strict=True)])
    return Scan(
        press=press, time_s=0.1 * np.arange(len(press)), phase=np.full(len(press), "load"),
        point_m=points[press], direction=down[press],
        force_n=force + NOISE.force_n * rng.standard_normal(len(press)),
        displacement_m=travel + NOISE.displacement_m * rng.standard_normal(len(press)),
        probe_radius_m=radii[press],
    )  # fmt: skip


@pytest.mark.slow
def test_two_balls_agree_on_the_modulus_within_its_interval():
    scan = pressed_by_balls()
    contacts, note = contacts_of(scan, sphere=True)
    coarse, finer = (
        PalpationModel(block_mesh(SIZE, cells), NU, contacts) for cells in ((8, 8, 3), (12, 12, 4))
    )
    body = BodyModel(coarse, coarse, RefinedModel(coarse, finer), note)
    experiment = PlacedExperiment(scan, body, NOISE, MapGuess(0))
    fit = fit_map(experiment)
    found = fit.parameters["background_pa"]
    assert fit.success
    assert found.value == pytest.approx(E, rel=0.006)
    assert found.lower95 < E < found.upper95
    assert fit.chi2_per_dof < 1.6
    growth = fit.model.mechanics.correction.tip.growth
    assert (growth < -1.05).all()  # the layer makes larger contacts stiffer
    lines = fit_map(experiment, rough=True)
    assert lines.chi2_per_dof > 10 * fit.chi2_per_dof


def assert_growth_by_map_is_a_quotient(mechanics: BodyMechanics, body: BodyResponse) -> None:
    for k, value in enumerate(LUMP):
        step = 1e-4 * value * np.eye(6)[k]
        up, down = (
            mechanics.evaluate(GaussianMap.from_values(LUMP + s), mechanics.state()).growth
            for s in (step, -step)
        )
        quotient = (up - down) / (2 * step[k])
        assert_allclose(body.growth_by_map[:, k], quotient, rtol=1e-3, atol=1e-4 / value)


def test_a_correction_to_a_finer_mesh_leaves_the_derivative_of_the_growth():
    points, down = (
        np.array([[0.02, 0.02, 0.016], [0.02, 0.03, 0.016]]),
        np.tile([0, 0, -1.0], (2, 1)),
    )
    contacts = Contacts(points, down, 2e-3, "hertz")
    coarse, finer = (
        PalpationModel(block_mesh(SIZE, cells), NU, contacts) for cells in ((6, 6, 2), (8, 8, 3))
    )
    mechanics = BodyMechanics.of(coarse, finer).following_growth()
    state, stiffness = mechanics.state(), GaussianMap.from_values(LUMP)
    mechanics = mechanics.corrected(stiffness, state)
    trend = mechanics.correction.trend
    assert trend is not None
    assert np.abs(trend.by_map(stiffness) * LUMP).max() > 0.01
    body = mechanics.evaluate(stiffness, state)
    assert_growth_by_map_is_a_quotient(mechanics, body)


@pytest.mark.slow
def test_the_growth_of_a_contact_follows_the_map():
    contacts, _ = contacts_of(pressed_by_balls(), sphere=True)
    model = PalpationModel(block_mesh(SIZE, (8, 8, 3)), NU, contacts)
    mechanics = BodyMechanics.of(model).following_growth()
    state, stiffness = mechanics.state(), GaussianMap.from_values(LUMP)
    body = mechanics.evaluate(stiffness, state)
    own = model.evaluate(stiffness.modulus(model.points_m))
    growth = by_contact_radius(own) / own.compliance
    assert np.ptp(growth) > 0.05  # it differs over the lump
    assert_allclose(body.growth, growth, atol=0.03)  # a law through two contacts, and a slope
    assert_growth_by_map_is_a_quotient(mechanics, body)
    skins = [state.changed(skin_thickness_m=1e-3, skin_factor=f) for f in (1.5, 1.51)]
    base, thicker = (mechanics.evaluate(stiffness, s) for s in skins)
    change = thicker.growth - base.growth
    assert np.abs(change).max() > 1e-4
    assert_allclose(base.growth_change(skins[1]), change, rtol=0.1, atol=1e-5)
