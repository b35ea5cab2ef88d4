"""Contributions of near-field functions to the rows of a stiffness matrix, cell by cell.

A function is f v - I_h (f v): the moments of its exact part (`fem.near_field.moments`) and the
polynomial interpolant are both strains times barycentric coordinates, summed by modulus sample. All
of it is products of matrices, which take a fifth of the time of loops over nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class SampleWeights(NamedTuple):
    """Weights of a cell's modulus samples q, for shape functions with gradients linear in lambda_b.

    Attributes
    ----------
    derivatives : (nodes, 4, 4) see `fem.near_field.enrichment.linear_derivatives`
    basis : (q, a) samples by monomials of the modulus's degree
    exact : (q, 4, k) of E lambda_b by the monomials of a degree more
    interpolant : (q, 4, 4) of E lambda_b lambda_b', by the stiffness matrix's own quadrature
    """

    derivatives: np.ndarray
    basis: np.ndarray
    exact: np.ndarray
    interpolant: np.ndarray


def contributions(
    field: np.ndarray, gradients: np.ndarray, volumes: np.ndarray, strain: np.ndarray,
    density: np.ndarray, weights: SampleWeights, lame: tuple[float, float], frame: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Rows k and energies a of functions in some cells, for E = 1 at each modulus sample.

    Parameters
    ----------
    field : (c, m, nodes, 3) at the nodes
    gradients : (c, 4, 3) of the barycentric coordinates
    volumes : (c,) m^3
    strain, density : (c, m, 6, k) and (c, m, m, a), see `fem.near_field.moments.moments`
    lame : lambda, mu for E = 1
    frame : (3, 3) the axes of `strain` as rows; all other vectors are in those of the body

    Returns
    -------
    coupling : (c, m, q, nodes, 3)
    energy : (c, m, m, q)
    """
    cells, count, nodes, _ = field.shape
    samples, _, terms = weights.exact.shape
    # Gradients of the shape functions (c, t, b, i), those of the interpolants (c, m, s, t, b)
    shape = gradients.swapaxes(1, 2) @ weights.derivatives.transpose(1, 2, 0).reshape(4, -1)
    shape = shape.reshape(cells, 12, nodes)
    slope = field.swapaxes(2, 3).reshape(cells, 3 * count, nodes) @ shape.swapaxes(1, 2)
    slope = slope.reshape(cells, count, 9, 4).transpose(0, 3, 1, 2)  # (c, b, m, st)
    stress = (slope.reshape(-1, 9) @ _stress_of_slope(*lame)).reshape(cells, 4, 9 * count)
    stress *= volumes[:, None, None]
    bent = weights.interpolant.reshape(-1, 4) @ stress  # (c, qb, m st)
    turned = _stress_of_strain(*lame) @ np.kron(frame, frame)
    exact = strain.transpose(0, 3, 1, 2).reshape(-1, 6) @ turned
    parts = weights.exact.reshape(-1, terms) @ exact.reshape(cells, terms, 9 * count) - bent
    parts = parts.reshape(cells, samples, 4, count, 3, 3).transpose(0, 3, 1, 4, 5, 2)
    rows = parts.reshape(cells, 3 * count * samples, 12) @ shape  # (c, mqs, i)
    rows = rows.reshape(cells, count * samples, 3, nodes).swapaxes(2, 3)
    there = field.reshape(cells, count, 3 * nodes).swapaxes(1, 2)
    mixed = np.ascontiguousarray(rows).reshape(cells, count * samples, 3 * nodes) @ there
    bent = bent.reshape(cells, samples, 4, count, 9).transpose(0, 3, 1, 2, 4)
    own = bent.reshape(cells, count * samples, 36) @ slope.swapaxes(2, 3).reshape(cells, 36, count)
    mixed, own = (a.reshape(cells, count, samples, count).swapaxes(2, 3) for a in (mixed, own))
    energy = density @ weights.basis.T - mixed - mixed.swapaxes(1, 2) - own
    return rows.reshape(cells, count, samples, nodes, 3), energy


def _stress_of_slope(lam: float, mu: float) -> np.ndarray:
    """Matrix (9, 9) that makes a stress of a displacement's gradient."""
    one = np.eye(3)
    same = np.einsum("su,tv->stuv", one, one)
    result = mu * (same + same.swapaxes(2, 3)) + lam * np.einsum("st,uv->stuv", one, one)
    return result.reshape(9, 9)


def _stress_of_strain(lam: float, mu: float) -> np.ndarray:
    """Matrix (6, 9) that makes a stress of the strains e_xx, e_yy, e_zz, e_xy, e_xz, e_yz."""
    tensor = np.zeros((6, 3, 3))
    for row, (s, t) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        tensor[row, s, t] = tensor[row, t, s] = 1.0
    return tensor.reshape(6, 9) @ _stress_of_slope(lam, mu)
