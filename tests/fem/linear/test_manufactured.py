"""Manufactured solutions: the error falls with the mesh as fast as theory says."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fem.linear.assembly import (
    Stiffness,
    barycentric_gradients,
    lame,
    shape_derivatives,
    shape_functions,
)
from fem.linear.quadrature import TET_RULES
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh
from fem.solve.direct import default_solver

SIZE = np.array([1.0, 0.8, 0.6])
NU = 0.3
# u_i = A_i sin(k_i . x + phase_i), E = e0 + slope . x: no symmetry to hide behind
AMPLITUDE = np.array([0.7, -1.1, 0.5])
WAVE = np.array([(2.1, -1.3, 0.7), (0.9, 1.7, -2.0), (-1.2, 2.2, 1.5)])
PHASE = np.array([0.3, 1.1, -0.6])
MODULUS, MODULUS_SLOPE = 2.0, np.array([0.6, -0.5, 0.9])


def modulus(x: np.ndarray) -> np.ndarray:
    return MODULUS + x @ MODULUS_SLOPE


def displacement(x: np.ndarray) -> np.ndarray:
    return AMPLITUDE * np.sin(x @ WAVE.T + PHASE)


def slope(x: np.ndarray) -> np.ndarray:
    """Derivatives du_i/dx_a, (..., 3, 3)."""
    return (AMPLITUDE * np.cos(x @ WAVE.T + PHASE))[..., None] * WAVE


def body_force(x: np.ndarray) -> np.ndarray:
    """-div(E sigma(u)), by hand."""
    lam, mu = lame(NU)
    second = -(AMPLITUDE * np.sin(x @ WAVE.T + PHASE))[..., None, None] * (
        WAVE[:, :, None] * WAVE[:, None, :]
    )  # (..., i, a, b)
    gradient = slope(x)
    trace = np.trace(gradient, axis1=-2, axis2=-1)[..., None, None]
    stress = lam * trace * np.eye(3) + mu * (gradient + gradient.swapaxes(-1, -2))
    divergence = (lam + mu) * np.einsum("...jji->...i", second) + mu * np.einsum(
        "...ijj->...i", second
    )
    return -(stress @ MODULUS_SLOPE + modulus(x)[..., None] * divergence)


def errors(order: int, n: int) -> tuple[float, float]:
    """L2 error of displacement and of its gradient on a mesh of n divisions an edge."""
    plain = block_mesh(SIZE, (n, n, n), order=order, split="alternating")
    mesh = Mesh(plain.nodes, plain.cells, {"all": plain.boundary, "none": plain.boundary[:0]})
    held = Stiffness(mesh, NU, "all")
    whole = Stiffness(mesh, NU, "none")
    points, weights = TET_RULES[5]
    x = np.einsum("qv,evi->eqi", points, mesh.nodes[mesh.cells[:, :4]])
    shape = shape_functions(points, order)
    measure = mesh.cell_volumes[:, None] * weights
    load = np.zeros_like(mesh.nodes)
    np.add.at(load, mesh.cells, np.einsum("eq,qn,eqi->eni", measure, shape, body_force(x)))
    boundary = np.zeros_like(mesh.nodes)
    on = mesh.surface_nodes("all")
    boundary[on] = displacement(mesh.nodes[on])
    upper = sp.csr_array((whole.values(modulus(whole.points_m)), whole.indices, whole.indptr))
    lifted = (upper @ boundary.ravel() + sp.triu(upper, 1).T @ boundary.ravel()).reshape(-1, 3)
    factor = default_solver().analyse(held.indptr, held.indices)
    factor = factor.factorize(held.values(modulus(held.points_m)))
    solved = held.prolong(factor.solve(held.restrict((load - lifted)[None])))[0] + boundary
    in_cell = solved[mesh.cells]
    at_points = np.einsum("qn,eni->eqi", shape, in_cell)
    derivative = np.einsum("qnv,eva->eqna", shape_derivatives(points, order),
                           barycentric_gradients(mesh.nodes, mesh.cells))  # fmt: skip
    gradient = np.einsum("eqna,eni->eqia", derivative, in_cell)
    value = np.einsum("eq,eqi->", measure, (at_points - displacement(x)) ** 2)
    first = np.einsum("eq,eqia->", measure, (gradient - slope(x)) ** 2)
    return float(np.sqrt(value)), float(np.sqrt(first))


def test_the_body_force_balances_the_stress():
    # Central differences of E sigma(u) at asymmetric points
    lam, mu = lame(NU)

    def stress(x: np.ndarray) -> np.ndarray:
        g = slope(x)
        return modulus(x) * (lam * np.trace(g) * np.eye(3) + mu * (g + g.T))

    for x in np.random.default_rng(0).uniform(0, 1, (4, 3)):
        steps = 1e-5 * np.eye(3)
        divergence = sum((stress(x + s) - stress(x - s))[:, a] / 2e-5 for a, s in enumerate(steps))
        np.testing.assert_allclose(divergence, -body_force(x), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize(("order", "coarse", "fine"), [(1, 6, 12), (2, 3, 6)])
def test_the_error_falls_at_the_theoretical_rate(order, coarse, fine):
    ratio = np.log(fine / coarse)
    rates = np.log(np.divide(errors(order, coarse), errors(order, fine))) / ratio
    assert rates[0] == pytest.approx(order + 1, abs=0.1)
    assert rates[1] == pytest.approx(order, abs=0.1)
    assert errors(order, fine)[0] < 0.01
