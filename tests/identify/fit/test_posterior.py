"""Draws from the posterior against grids of the likelihood, which need one finite element solve."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.catalogue.tool_compliance import ToolCompliance
from identify.effects.readings import Readings
from identify.fit.joint_fit import fit_jointly
from identify.fit.posterior import LogPosterior, Posterior, SampledParameter, draw_posterior
from identify.fit.settings import PRECISE
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from models.scan import Scan
from tests.long import long

SIZE = (0.06, 0.06, 0.03)
NOISE = Noise(4e-5, 1e-2)
TRUE_PA = 6000.0
FORCE = np.array([0.15, 0.3, 0.3, 0.15])


@pytest.fixture(scope="module")
def model():
    points = np.array([[0.02, 0.03, 0.03], [0.04, 0.025, 0.03]])
    contacts = Contacts(points, [0.0, 0.0, -1.0], [0.003, 0.006], "flat")
    return PalpationModel(block_mesh(SIZE, (3, 3, 2), order=2), 0.45, contacts, near_field=False)


def fitted(model, tool_m_per_n):
    """Background and compliance of the tool, fitted to two presses by tips of two radii."""
    unit = compliance(model, GaussianMap(1.0))
    press = np.repeat([0, 1], len(FORCE))
    force = np.tile(FORCE, 2)
    rng = np.random.default_rng(3)
    true = (unit[press] / TRUE_PA + tool_m_per_n) * force
    scan = Scan(
        press=press,
        time_s=0.1 * np.arange(len(press)),
        phase=np.tile(["load", "hold", "hold", "unload"], 2),
        point_m=model.contacts.points_m[press],
        direction=model.contacts.directions[press],
        force_n=force + rng.normal(0, NOISE.force_n, force.shape),
        displacement_m=true + rng.normal(0, NOISE.displacement_m, force.shape),
        probe_radius_m=model.contacts.radius_m[press],
    )
    start, mechanics = GaussianMap(TRUE_PA), BodyMechanics.of(model)
    alone = MeasurementModel(
        Readings.of(scan),
        scan.displacement_m,
        NOISE,
        mechanics,
        parameter_space(start, model.mesh.box_m),
    )
    both = alone.with_effect(ToolCompliance(), {"c_m_per_n": 1e-4}, mechanics.state())
    settings = replace(PRECISE, rounds=0)
    return fit_jointly(both, start, settings=settings), unit, scan


def by_grid(unit, scan, tool_upper):
    """Background (a, 1), tool (1, b) and the posterior over both from the readings alone."""
    log_background = np.linspace(np.log(2e3), np.log(4e4), 801)[:, None]
    tool = np.linspace(0.0, tool_upper, 800)[None, :]
    chi2 = np.zeros((log_background.size, tool.size))
    for j, f, d in zip(scan.press, scan.force_n, scan.displacement_m, strict=True):
        c = unit[j] * np.exp(-log_background) + tool
        chi2 += (d - c * f) ** 2 / (NOISE.displacement_m**2 + (c * NOISE.force_n) ** 2)
    weight = np.exp(-0.5 * (chi2 - chi2.min()))
    return np.exp(log_background), tool, weight / weight.sum()


def ends(values, weight):
    """Quantiles at 2.5 % and 97.5 %."""
    return np.interp([0.025, 0.975], np.cumsum(weight), values)


@pytest.mark.slow
@pytest.mark.parametrize("tool_m_per_n", [0.0, *long(1.2e-3)])  # 0 is a bound: half of a bell
def test_draws_follow_the_likelihood_on_a_grid(model, tool_m_per_n):
    fit, unit, scan = fitted(model, tool_m_per_n)
    background, tool, weight = by_grid(unit, scan, 8e-3)
    found = draw_posterior(fit.solution, 2500, seed=5).parameters
    for name, values, marginal in (
        ("background_pa", background.ravel(), weight.sum(axis=1)),
        ("tool_compliance.c_m_per_n", tool.ravel(), weight.sum(axis=0)),
    ):
        p, mean = found[name], float(values @ marginal)
        std = float(np.sqrt((values - mean) ** 2 @ marginal))
        tails = float(((values - mean) / std) ** 4 @ marginal) - 1  # of a normal one: 2
        assert p.mean == pytest.approx(mean, abs=4 * std / np.sqrt(p.effective))
        assert p.std == pytest.approx(std, rel=4 * np.sqrt(tails / (4 * p.effective)))
        lower, upper = ends(values, marginal)
        # The error of a quantile is 2.7 standard deviations over the root of the draws
        error = 4 * 2.7 * std / np.sqrt(p.effective_tail)
        assert_allclose([p.lower95, p.upper95], [lower, upper], rtol=0, atol=error)
        assert p.r_hat < 1.02


@pytest.mark.slow
def test_the_error_of_the_finer_mesh_widens_the_draws_and_leaves_their_middle(model):
    fit, _, _ = fitted(model, 1.2e-3)
    solution = fit.solution
    # Small noise, so that the posterior is normal; an error of the mesh along the background
    tight = replace(solution.model, noise=Noise(4e-7, 1e-4))
    at = tight.linearise(solution.u)
    noise = np.linalg.inv(at.jacobian.T @ at.jacobian)
    mesh = 3 * noise[0, 0] * np.diag([1.0, 0.0])
    exact = replace(tight, displacement_m=at.predicted_m)
    wide = replace(solution, model=exact, noise_covariance=noise, covariance=noise + mesh)
    draws = draw_posterior(wide, 2000, seed=5).draws.reshape(-1, 2)
    u = np.column_stack([np.log(draws[:, 0]), draws[:, 1] / 1e-4])
    assert_allclose(np.cov(u.T), noise + mesh, rtol=0.12)
    assert_allclose(u.mean(axis=0), solution.u, atol=0.1 * np.sqrt(np.diag(noise + mesh)).max())


@pytest.mark.parametrize(("touch_m", "lag_s"), [(0.0, 0.0), (3e-5, 0.0), (3e-5, 0.01)])
def test_the_residual_without_derivatives_is_the_same(model, touch_m, lag_s):
    fit, _, _ = fitted(model, 1.2e-3)
    other = replace(fit.model, noise=replace(NOISE, touch_m=touch_m, lag_s=lag_s))
    place = fit.u + np.array([0.1, -2.0])
    assert_allclose(other.residual(place), other.linearise(place).residual, rtol=1e-12)


@pytest.mark.parametrize(("touch_m", "lag_s"), [(0.0, 0.0), (3e-5, 0.0), (3e-5, 0.01)])
def test_the_derivatives_are_those_of_chi_square(model, touch_m, lag_s):
    fit, _, _ = fitted(model, 1.2e-3)
    other = replace(fit.model, noise=replace(NOISE, touch_m=touch_m, lag_s=lag_s))
    place = fit.u + np.array([0.01, -0.2])
    at = other.linearise(place)
    steps = 1e-5 * np.diag([1.0, 10.0])
    rise = [np.sum(other.residual(place + h) ** 2) - np.sum(other.residual(place - h) ** 2)
            for h in steps]  # fmt: skip
    found = np.array(rise) / (2 * np.diag(steps))
    assert_allclose(found, -2 * at.jacobian.T @ at.residual, rtol=1e-4)


def test_the_bent_coordinates_keep_the_density(model):
    fit, _, _ = fitted(model, 1.2e-3)
    target = LogPosterior(fit.solution)

    def chi2(z):
        return np.sum(fit.model.linearise(target.scaled(z)).residual ** 2)

    def volume(z):
        columns = [target.scaled(z + 1e-4 * axis) - target.scaled(z - 1e-4 * axis)
                   for axis in np.eye(2)]  # fmt: skip
        return abs(np.linalg.det(np.array(columns)))

    places = np.array([[0.0, 0.0], [0.9, -1.2], [-1.1, 0.4]])
    expected = [np.log(volume(z)) - 0.5 * chi2(z) for z in places]
    found = [target(z) for z in places]
    assert_allclose(np.diff(found), np.diff(expected), rtol=1e-4)


def marginal(r_hat=1.0, effective=900.0):
    return SampledParameter(1.0, 0.1, 0.8, 1.2, 0.8, 1.2, effective, effective, r_hat)


@pytest.mark.parametrize("bad", [marginal(r_hat=1.02), marginal(effective=300.0)])
def test_draws_that_have_not_settled_are_known(bad):
    assert Posterior(2000, 4, 0, {"a": marginal(), "b": marginal()}).settled
    assert not Posterior(2000, 4, 0, {"a": marginal(), "b": bad}).settled
