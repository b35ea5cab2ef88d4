"""Derivatives of a model's predictions by all unknowns, against differences of predictions."""

from dataclasses import replace

import numpy as np
import pytest

from fem import PalpationModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.catalogue import CATALOGUE
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.chain import OperatingPoint
from identify.measurement.model import MeasurementModel
from models.scan import Scan
from tests.identify.select import loop_problem as problem

AGREE = 0.02  # of the norm of a column; what the noise has part in is left out of some
STEP = 3e-4  # of scaled coordinates


# A grain whose error on the meshes goes with its place, in a body where Poisson's ratio counts
GRAIN = GaussianMap(5000.0, (Inclusion(40e3, 0.028, 0.034, 0.025, 0.004),))
NU = 0.482


def scan() -> Scan:
    press, _, _, force = problem.timing(0)
    return problem.scan(problem.true_compliance()[press] * force, force, seed=4)


def pressed(profile: str) -> BodyMechanics:
    """The body under flat tips, or under balls, whose contact grows with the map."""
    tips = replace(problem.contacts(), profile=profile)
    coarse, fine = (
        PalpationModel(block_mesh(problem.SIZE, n), NU, tips) for n in ((5, 5, 3), (6, 6, 4))
    )
    own = BodyMechanics.of(coarse, fine).following_growth()
    return own.corrected(GRAIN, own.state())


@pytest.fixture(scope="module", params=["flat", "hertz"])
def model(request: pytest.FixtureRequest) -> MeasurementModel:
    body = pressed(request.param)
    assert body.correction.trend is not None
    return problem.model(scan(), body)


def disagreements(model: MeasurementModel, u: np.ndarray, first: int) -> dict[str, float]:
    """Relative errors of the columns from `first` on that do not agree."""
    at, found = model.linearise(u), {}

    def predicted(side: np.ndarray) -> np.ndarray:
        """At the latent forces of u: the noise's share in them is no matter of derivatives."""
        body = model.body(side)
        chain = model._chain(body)
        c, e = body.compliance, body.local_modulus
        return chain.predict(OperatingPoint(c, e, at.latent_force_n, model.values(side)))

    for i, name in enumerate(model.names[first:], start=first):
        up, down = (np.clip(u + s * STEP * np.eye(len(u))[i], *model.bounds) for s in (1, -1))
        column = (predicted(up) - predicted(down)) / (up[i] - down[i])
        off = np.linalg.norm(column - at.jacobian[:, i] * at.sigma_m)
        if off > AGREE * np.linalg.norm(column):
            found[name] = float(off / np.linalg.norm(column))
    return found


def test_derivatives_by_the_map_are_differences_of_evaluations(model):
    assert disagreements(model, model.start(GRAIN), 0) == {}


@pytest.mark.parametrize("effect", [*CATALOGUE], ids=lambda e: e.name)
def test_derivatives_by_an_effect_are_differences_of_evaluations(model, effect):
    known = {p.name: p for p in effect.bounded(model.readings, model.mechanics.state())}
    values = {
        name: p.typical if p.null is None else p.null + 0.5 * p.typical for name, p in known.items()
    }
    both = model.with_effect(effect, values, model.mechanics.state())
    u = both.start(GRAIN)
    assert disagreements(both, u, len(model.names)) == {}
