"""Evidence of a map of few parameters, beside that of a free map."""

import numpy as np
import pytest

import palpmap as pm
from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.fit.free_map.parametric_evidence import parametric_evidence
from identify.map import GaussianMap, Inclusion

SIZE_M, NU, TIP_M = (0.06, 0.06, 0.03), 0.45, 0.004
NOISE = pm.Noise(displacement_m=2e-5, force_n=3e-3)


def body_of_one_inclusion(swing_m: float) -> pm.Experiment:
    """Scan of 25 presses, its truth on another mesh; the body swings unless `swing_m` is zero."""
    truth = GaussianMap(6e3, (Inclusion(1.5e4, 0.03, 0.03, 0.022, 0.006),))
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0.012, 0.048, 5)] * 2))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    down = np.tile([0, 0, -1.0], (x.size, 1))
    at = Contacts(points, down, np.full(x.size, TIP_M))
    c = compliance(PalpationModel(block_mesh(SIZE_M, (17, 17, 9)), NU, at), truth)
    rng, forces = np.random.default_rng(4), np.linspace(0.05, 0.3, 8)
    press, force = np.repeat(np.arange(len(x)), 8), np.tile(forces, len(x))
    time = 6.0 * press + 0.4 * np.tile(np.arange(8), len(x))
    scan = pm.Scan(
        press=press, time_s=time, phase=np.full(len(press), "load"),
        force_n=force + rng.normal(0, NOISE.force_n, len(press)),
        displacement_m=c[press] * force + swing_m * np.sin(2 * np.pi * 0.31 * time)
        + rng.normal(0, NOISE.displacement_m, len(press)),
        point_m=points[press], direction=down[press], probe_radius_m=np.full(len(press), TIP_M),
    )  # fmt: skip
    return pm.Experiment(scan, pm.Block(SIZE_M, poisson_ratio=NU), pm.FlatTip(TIP_M), noise=NOISE)


@pytest.mark.slow
def test_it_is_that_of_the_criterion_where_the_map_leaves_noise():
    fit = pm.fit(body_of_one_inclusion(0.0), inclusions=1)
    solution = fit.solution
    every = np.ones(solution.model.readings.presses)
    found = parametric_evidence(solution.model, solution.at.body, solution.u, every)
    # Above the criterion by what presses that scatter more than the noise lose in weight
    assert -fit.bic / 2 < found < -fit.bic / 2 + 0.05 * fit.chi2


@pytest.mark.slow
def test_the_kind_of_map_does_not_hang_on_an_effect_that_is_missing():
    """A free map's own errors of the presses took a body's motion, and passed for its evidence."""
    fit = pm.fit(body_of_one_inclusion(3e-4).of_kind("auto"))
    assert fit.field is None
    assert fit.chi2_per_dof > 2
    assert "one inclusion, its log evidence is" in fit.message
