"""Contributions of near-field functions to the rows of a stiffness matrix, cell by cell.

A function is f v - I_h (f v). Moments of its stress, of the exact part (`fem.near_field.moments`)
less that of the polynomial interpolant, give its integrals with the barycentric coordinates for
each term a of the modulus,

    int a(x) sigma(phi) lambda_b dV = moment number raised_ab.

The rows at the nodes follow from these and the shape functions, whose gradients are linear in
lambda_b. They are not kept: they are up to two and a half times as many numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Axes of the components xx, yy, zz, xy, xz, yz of a strain or stress.
AXES = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])


class Terms(NamedTuple):
    """Terms a of the modulus in a cell, and moments k of a stress that the terms' integrals need.

    Attributes
    ----------
    basis : (q, a) modulus samples by terms
    raised : (a, 4) number of the moment that is each term times lambda_b
    exact : (k, i) moments by `fem.near_field.moments.moments` of the strain
    interpolant : (k, 4) moments of lambda_b over the volume, by the stiffness matrix's quadrature
    density : (a, j) terms by the moments of the energy density
    """

    basis: np.ndarray
    raised: np.ndarray
    exact: np.ndarray
    interpolant: np.ndarray
    density: np.ndarray


def contributions(
    field: np.ndarray, shape: np.ndarray, volumes: np.ndarray, strain: np.ndarray,
    density: np.ndarray, terms: Terms, lame: tuple[float, float], frame: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Moments of the stress and energies of functions in some cells, for E = 1.

    Parameters
    ----------
    field : (c, m, nodes, 3) at the nodes
    shape : (c, 12, nodes) gradients of the shape functions, by axis and lambda_b
    volumes : (c,) m^3
    strain, density : (c, m, 6, i) and (c, m, m, j), see `fem.near_field.moments.moments`
    lame : lambda, mu for E = 1
    frame : (3, 3) the axes of `strain` as rows; all other vectors are in those of the body

    Returns
    -------
    stress : (c, m, k, 6)
    energy : (c, m, m, q)
    """
    cells, count, nodes, _ = field.shape
    s, t = AXES.T
    slope = field.swapaxes(2, 3).reshape(cells, 3 * count, nodes) @ shape.swapaxes(1, 2)
    slope = slope.reshape(cells, count, 3, 3, 4)
    bent = (slope[:, :, s, t] + slope[:, :, t, s]) / 2  # strains of the interpolants, by lambda_b
    work = (bent * np.where(s == t, 1, 2)[:, None]).reshape(cells, count, 24).swapaxes(1, 2)
    bent = _stress(bent, lame) * volumes[:, None, None, None]

    def in_interpolants(moments: np.ndarray) -> np.ndarray:
        """Energies (c, m, m, a) of stresses by moments (c, m, 6, k) in the interpolants."""
        parts = moments[..., terms.raised].transpose(0, 1, 3, 2, 4)
        number = len(terms.raised)
        both = parts.reshape(cells, count * number, 24) @ work
        return both.reshape(cells, count, number, count).swapaxes(2, 3)

    rough = bent @ terms.interpolant.T
    stress = _stress(_turn(frame).T @ strain, lame) @ terms.exact.T - rough
    mixed = in_interpolants(stress)
    energy = density @ terms.density.T - mixed - mixed.swapaxes(1, 2) - in_interpolants(rough)
    return stress.swapaxes(2, 3), energy @ terms.basis.T


def _turn(frame: np.ndarray) -> np.ndarray:
    """Matrix (6, 6) by whose transpose components in a frame become those of the body."""
    s, t = AXES.T
    straight = frame[np.ix_(s, s)] * frame[np.ix_(t, t)]
    return straight + (s != t)[:, None] * frame[np.ix_(t, s)] * frame[np.ix_(s, t)]


def _stress(strain: np.ndarray, lame: tuple[float, float]) -> np.ndarray:
    """Stress (c, m, 6, i) of a strain."""
    lam, mu = lame
    stress = 2 * mu * strain
    stress[:, :, :3] += lam * strain[:, :, :3].sum(axis=2, keepdims=True)
    return stress
