"""A study that states a length wrongly: what is found in its place is doubted."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.mesh.mesh import Mesh
from identify.body.mechanics import BodyMechanics
from identify.catalogue.body_shift import BodyShift
from identify.catalogue.stiffness_gradient import StiffnessGradient
from identify.design.geometry_confounders import geometry_confounders
from identify.effects.base import Effect
from identify.fit.joint_fit import fit_jointly
from models.scan import Scan
from tests.identify.select import loop_problem as problem

RADII = np.where(np.arange(25) % 2, 0.003, 0.006)


def contacts(wider_m: float = 0.0) -> Contacts:
    down = np.tile([0.0, 0.0, -1.0], (25, 1))
    return Contacts(problem.points(), down, RADII + wider_m)


def moved(divisions: tuple[int, int, int], split: str, to: np.ndarray, stretch: float) -> Mesh:
    mesh = block_mesh(problem.SIZE, divisions, split=split)
    nodes, top = mesh.nodes + to, problem.SIZE[2]
    nodes[:, 2] = top + (nodes[:, 2] - top) * stretch
    return Mesh(nodes, mesh.cells, mesh.surfaces)


def found(effect: Effect, wider_m: float = 0.0, higher_m: float = 0.0, shift_m: float = 0.0) -> Any:
    """Return the mistakes that are named beside an effect fitted to a scan of another body."""
    to, stretch = np.array([shift_m, 0.0, 0.0]), 1 + higher_m / problem.SIZE[2]
    pair = RefinedModel(
        *(
            PalpationModel(moved(n, "alternating", to, stretch), problem.NU, contacts(wider_m))
            for n in ((7, 7, 4), (10, 10, 6))
        )
    )
    compliance = pair.evaluate(problem.TRUE.modulus(pair.points_m)).compliance
    press, _, _, force = problem.timing(1)
    made = problem.scan(compliance[press] * force, force, 1)
    table: Scan = made.replace(probe_radius_m=RADII[press])
    coarse, fine = (
        PalpationModel(block_mesh(problem.SIZE, n), problem.NU, contacts())
        for n in ((5, 5, 3), (8, 8, 5))
    )
    own = BodyMechanics(coarse, RefinedModel(coarse, fine), lambda nu: coarse)
    model = problem.model(table, own.corrected(problem.TRUE, own.state()))
    before = fit_jointly(model, problem.TRUE)
    null = dict.fromkeys((p.name for p in effect.parameters), 0.0)
    after = fit_jointly(before.model.with_effect(effect, null, own.state()), before.map)
    assert after.chi2 < before.chi2 - 20
    steps = tuple(SimpleNamespace(fit=fit) for fit in (before, after))
    explained: Any = SimpleNamespace(ladder=steps, accepted=(SimpleNamespace(name=effect.name),))
    return {
        m.length: m.change_m for m in geometry_confounders(explained) if m.effect == effect.name
    }


@pytest.mark.slow
def test_a_tip_that_is_wider_than_stated_is_named_beside_the_gradient():
    assert found(StiffnessGradient(), wider_m=3e-4)["tip_radius"] == pytest.approx(3e-4, rel=0.2)


@pytest.mark.slow
def test_a_body_that_is_higher_than_stated_is_named_beside_the_gradient():
    assert found(StiffnessGradient(), higher_m=4e-3)["body_height"] == pytest.approx(4e-3, rel=0.2)


@pytest.mark.slow
def test_no_length_looks_like_a_body_that_lies_elsewhere():
    assert found(BodyShift(), shift_m=1.5e-3) == {}
