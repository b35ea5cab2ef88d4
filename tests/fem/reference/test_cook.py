"""Cook's membrane: a tapered panel in shear, thin, or nearly incompressible in plane strain.

The panel is 48 wide and clamped at x = 0, where it is 44 high; at x = 48 it goes from y = 44 to 60
and carries a shear force of 1 upwards. The reference is a plane mixed method (Taylor-Hood:
displacement Q2, pressure Q1), another element with another formulation, itself held against the
published deflection of the loaded edge's middle: 23.96 (P. G. Bergan and C. A. Felippa, A
triangular membrane element with rotational degrees of freedom, Comput. Meth. Appl. Mech. Engng. 50,
1985, give 23.9; programs that refine further 23.96).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fem.linear.assembly import Stiffness, lame
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10

NU = 0.4999
PUBLISHED = 23.96  # in plane stress, for E = 1, nu = 1/3, thickness 1


def panel(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points of the panel for x and y in the unit square, (..., 2)."""
    return np.stack([48 * x, (1 - x) * 44 * y + x * (44 + 16 * y)], axis=-1)


@cache
def slab_deflection(n: int, nu: float, order: int = 2, plane_strain: bool = True) -> float:
    """Mean deflection of the loaded edge of a slab of thickness 1, E = 1, with n x n hexahedra."""
    block = block_mesh((1, 1, 1), (n, n, 1), order=1)
    xy = panel(block.nodes[:, 0], block.nodes[:, 1])
    plain = Mesh(np.column_stack([xy, block.nodes[:, 2]]), block.cells,
                 block.surfaces | {"none": block.boundary[:0]})  # fmt: skip
    mesh = promote_to_tet10(plain) if order == 2 else plain
    nodes = mesh.nodes
    stiffness = Stiffness(mesh, nu, "none")
    values = stiffness.values(np.ones(len(stiffness.points_m)))
    upper = sp.csr_array((values, stiffness.indices, stiffness.indptr))
    matrix = sp.csc_array(upper + sp.triu(upper, 1).T)
    held = np.zeros((len(nodes), 3), bool)
    held[mesh.surface_nodes("x0"), :2] = True
    held[:, 2] = np.isin(nodes[:, 2], (0, 1) if plane_strain else 0.5)  # or free to grow thinner
    faces = mesh.surface("x1")
    load = np.zeros_like(nodes)
    edges = nodes[faces[:, 1:3]] - nodes[faces[:, :1]]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    ends = faces if order == 1 else faces[:, 3:]  # of a quadratic face the mid-edge nodes carry all
    np.add.at(load[:, 1], ends, np.broadcast_to(area[:, None] / 3 / 16, ends.shape))
    free = ~held.ravel()
    solved = splu(matrix[free][:, free]).solve(load.ravel()[free])
    return float(load.ravel()[free] @ solved)


@cache
def mixed_deflection(n: int, nu: float, plane_strain: bool = True) -> tuple[float, float]:
    """Mean deflection of the loaded edge and that of its middle by Taylor-Hood quadrilaterals."""
    lam, mu = lame(nu)
    if not plane_strain:
        lam = 2 * lam * mu / (lam + 2 * mu)
    line = np.array([-1.0, 0.0, 1.0])
    gauss, weight = np.polynomial.legendre.leggauss(4)
    quad = np.array([line * 0 + 1, line, line**2]).T
    square = np.linalg.inv(quad)  # coefficients of the three quadratics of a line
    value = np.array([gauss**0, gauss, gauss**2]).T @ square
    slope = np.array([gauss * 0, gauss**0, 2 * gauss]).T @ square
    hat = np.column_stack([1 - gauss, 1 + gauss]) / 2
    shape_x, shape_y = (np.einsum("pi,qj->pqij", *pair).reshape(16, 9)
                        for pair in ((slope, value), (value, slope)))  # fmt: skip
    pressure = np.einsum("pi,qj->pqij", hat, hat).reshape(16, 4)
    weights = np.outer(weight, weight).ravel()
    side = np.linspace(0, 1, 2 * n + 1)
    place = panel(*np.meshgrid(side, side, indexing="ij")).reshape(-1, 2)
    number = np.arange((2 * n + 1) ** 2).reshape(2 * n + 1, -1)
    first = np.arange((n + 1) ** 2).reshape(n + 1, -1)
    rows, columns, entries = [], [], []
    for i in range(n):
        for j in range(n):
            nodes = number[2 * i : 2 * i + 3, 2 * j : 2 * j + 3].ravel()
            jacobian = np.stack([shape_x @ place[nodes], shape_y @ place[nodes]], axis=1)
            local = np.linalg.solve(jacobian, np.stack([shape_x, shape_y], axis=1))  # (16, 2, 9)
            strain = np.zeros((16, 3, 18))
            strain[:, 0, ::2], strain[:, 1, 1::2] = local[:, 0], local[:, 1]
            strain[:, 2, ::2], strain[:, 2, 1::2] = local[:, 1], local[:, 0]
            measure = weights * np.linalg.det(jacobian)
            law = mu * np.diag([2, 2, 1])
            whole = np.zeros((22, 22))
            whole[:18, :18] = np.einsum("q,qai,ab,qbj->ij", measure, strain, law, strain)
            mixed = np.einsum("q,qi,qj->ij", measure, strain[:, 0] + strain[:, 1], pressure)
            whole[:18, 18:], whole[18:, :18] = mixed, mixed.T
            whole[18:, 18:] = -np.einsum("q,qi,qj->ij", measure, pressure, pressure) / lam
            corners = 2 * number.size + first[i : i + 2, j : j + 2].ravel()
            dof = np.concatenate([(2 * nodes[:, None] + [0, 1]).ravel(), corners])
            rows.append(np.repeat(dof, 22))
            columns.append(np.tile(dof, 22))
            entries.append(whole.ravel())
    size = 2 * number.size + first.size
    matrix = sp.csc_array(sp.coo_array(
        (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), (size, size)
    ))  # fmt: skip
    load = np.zeros(size)
    for j in range(n):
        load[2 * number[-1, 2 * j : 2 * j + 3] + 1] += np.array([1, 4, 1]) / 6 / n
    free = np.setdiff1d(np.arange(size), (2 * number[0][:, None] + [0, 1]).ravel())
    moved = np.zeros(size)
    moved[free] = splu(matrix[free][:, free]).solve(load[free])
    return float(load @ moved), float(moved[2 * number[-1, n] + 1])


def test_the_plane_method_has_the_published_deflection():
    assert mixed_deflection(24, 1 / 3, plane_strain=False)[1] == pytest.approx(PUBLISHED, rel=5e-4)


def test_a_thin_free_panel_deflects_as_in_plane_stress():
    exact, _ = mixed_deflection(24, 1 / 3, plane_strain=False)
    assert slab_deflection(16, 1 / 3, plane_strain=False) == pytest.approx(exact, rel=0.003)


def test_the_nearly_incompressible_panel_converges_to_a_mixed_methods_deflection():
    exact, _ = mixed_deflection(24, NU)
    assert exact == pytest.approx(mixed_deflection(12, NU)[0], rel=3e-3)
    errors = np.array([1 - slab_deflection(n, NU) / exact for n in (4, 8, 16)])
    assert (np.abs(errors[1:]) < 0.6 * np.abs(errors[:-1])).all()
    assert abs(errors[-1]) < 0.015
    # Linear cells lock
    assert slab_deflection(8, NU, order=1) < 0.5 * exact
