"""Detection limits against scans in which the laboratory hid an effect of just that size."""

from dataclasses import replace

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.design.detection_limits import detection_limits
from identify.design.settings import DETECTION
from identify.effects.readings import Readings
from identify.fit.joint_fit import fit_jointly
from identify.select.score_test import fitted_basis, score_effect
from palpmap import api
from palpmap.experiment import Experiment
from palpmap.study.study import About, Body, Map, Noise, Probe, Study
from sim.bench.planted_scan import planted_scan

SEED = 5
DRAWS = 2
RADIUS_M = 0.005
TESTED = (
    "stiffness_gradient", "poisson_ratio", "base_compliance", "tool_compliance", "spherical_tip",
    "viscoelasticity", "force_bias", "force_drift", "force_saturation", "contact_offset",
    "sensitivity_drift", "displacement_drift",
    "preconditioning", "hysteresis", "side_gradient", "body_shift", "finite_strain",
    "strain_stiffening", "skin_layer", "extra_inclusion", "anisotropy", "base_sliding",
    "mesh_error", "breathing", "inclusion_stretch",
)  # fmt: skip


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """A scan with nothing hidden, its models and its fit."""
    folder = tmp_path_factory.mktemp("limits")
    scan, truth = planted_scan(None, seed=SEED, radii=(RADIUS_M,))
    study = Study(
        study=About(name="nothing", scan=folder / "scan.csv"),
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),
        probe=Probe(tip="flat", radius_m=RADIUS_M),
        noise=Noise(**truth["noise"]),
        map=Map(inclusions=1),
    )
    posed = api.start(Experiment.of(scan, study))
    return posed, fit_jointly(posed.model, posed.start)


@pytest.fixture(scope="module")
def limits(problem):
    posed, fit = problem
    return {one.name: one for one in detection_limits(fit, posed.catalogue)}


def refitted(problem, scan):
    posed, fit = problem
    rows = scan.used()
    model = replace(posed.model, readings=Readings.of(scan), displacement_m=rows.displacement_m)
    return fit_jointly(model, fit.map, rounds=0)


def score(problem, name, size, seed, shape):
    """Standard errors that a planted effect is scored at, and the size that it has.

    The same noise with and without it, so that the difference is the effect's alone.
    """
    effect = CATALOGUE[name]
    hidden, truth = planted_scan(name, size, seed, (RADIUS_M,), values=dict(shape))
    plain, _ = planted_scan(None, seed=seed, radii=(RADIUS_M,))
    found, none = refitted(problem, hidden), refitted(problem, plain)
    beyond = score_effect(found, effect, fitted_basis(found.at)).beyond
    score = np.linalg.norm(beyond.T @ (found.at.residual - none.at.residual))
    return float(score), truth["effects"][0]["size"]


@pytest.mark.slow
@pytest.mark.parametrize("name", TESTED)
def test_an_effect_of_the_size_printed_scores_five_standard_errors(problem, limits, name):
    own = limits[name]
    scores = [
        score(problem, name, own.smallest_share, SEED + 100 * draw, own.shape)[0]
        for draw in range(DRAWS)
    ]
    ratio = float(np.exp(np.mean(np.log(scores)))) / DETECTION.sigmas
    assert 1 / 1.5 < ratio < 1.5


@pytest.mark.slow
def test_the_largest_effect_that_is_possible_is_not_seen_where_the_limits_say_so(problem, limits):
    own = limits["rigid_tip"]
    assert own.smallest_share is None
    assert "the largest that is possible" in own.untestable
    found, reached = score(problem, "rigid_tip", 0.03, SEED, {})
    assert reached < own.largest_share  # a tip held upright: the effect's bounds leave some room
    assert found < DETECTION.sigmas
