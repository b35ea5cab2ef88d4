"""Hyperelastic laws at single deformation gradients, without a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from fem.errors import MeshError
from fem.finite_strain.hyperelastic import HyperelasticLaw, stiffening
from fem.linear.assembly import lame


@numba.vectorize(cache=True)
def _g(code, c, q, derivative):
    terms = stiffening(code, c, q)
    if derivative == 0:
        return terms[0]
    if derivative == 1:
        return terms[1]
    return terms[2]


@dataclass(frozen=True)
class MaterialPoint:
    """What a law answers to deformation gradients, for E = 1 (multiply by E in Pa).

    Attributes
    ----------
    energy : (p,) W/E
    stress : (p, 3, 3) first Piola-Kirchhoff P/E
    tangent : (p, 3, 3, 3, 3) dP_iJ/dF_kL / E
    """

    energy: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray


def material_point(
    law: HyperelasticLaw, poisson_ratio: float, deformation: np.ndarray
) -> MaterialPoint:
    """Energy, stress and tangent at deformation gradients F (p, 3, 3), without a mesh.

    Raises
    ------
    MeshError
        A deformation gradient with det F <= 0.
    """
    f = np.asarray(deformation, float)
    lam, mu = lame(poisson_ratio)
    j = np.linalg.det(f)
    if not (j > 0).all():
        raise MeshError(f"a deformation gradient turns matter inside out: det F = {j.min():.3g}")
    log_j = np.log(j)
    q = np.einsum("pij,pij->p", f, f) - 3 - 2 * log_j
    g, g1, g2 = (np.asarray(_g(law.code, law.coefficient, q, d)) for d in range(3))
    h = np.linalg.inv(f).swapaxes(1, 2)  # F^-T
    s = f - h
    energy = mu / 2 * g + lam / 2 * log_j**2
    stress = mu * g1[:, None, None] * s + lam * log_j[:, None, None] * h
    tangent = np.einsum("p,ik,JL->piJkL", mu * g1, np.eye(3), np.eye(3))
    tangent += np.einsum("p,piJ,pkL->piJkL", 2 * mu * g2, s, s)
    tangent += lam * np.einsum("piJ,pkL->piJkL", h, h)
    tangent += np.einsum("p,piL,pkJ->piJkL", mu * g1 - lam * log_j, h, h)
    return MaterialPoint(energy, stress, tangent)
