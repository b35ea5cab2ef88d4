"""Hyperelastic laws at finite strain, normalised so that small strain gives Young's modulus and nu.

All laws are one family in F = I + du/dX, J = det F, I1 = tr F'F, with lambda and mu for E = 1
(`fem.linear.assembly.lame`):

    W/E = mu/2 g(Q) + lambda/2 (ln J)^2,      Q = I1 - 3 - 2 ln J >= 0,
    P/E = mu g'(Q) S + lambda ln J F^-T,      S = F - F^-T = (dQ/dF)/2   (first Piola-Kirchhoff).

Q is of second order in the strain, Q = 2 eps:eps + ..., so that any g with g(0) = 0 and g'(0) = 1
has the limit of Hooke's law, and the unloaded body is free of stress. Where J = 1, Q = I1 - 3, and

    NeoHookean  g = Q                         compressible form of Simo & Pister (1984)
    Yeoh        g = Q + c Q^2                 the first two terms of Yeoh (1993), c = C20/C10
    Fung        g = (exp(b Q) - 1)/b          Fung (1967), Demiray (1972)

are the laws of those names. Derivative, with the spatial gradients F^-T g of two vectors g, h:

    dP/dF : (a (x) g, c (x) h)/E = mu g' [(a.c)(g.h)] + 2 mu g'' [a.S g][c.S h]
        + lambda [a.F^-T g][c.F^-T h] + (mu g' - lambda ln J) [a.F^-T h][c.F^-T g].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numba
import numpy as np

from fem.errors import MeshError
from fem.linear.assembly import lame

_NEO_HOOKEAN, _YEOH, _FUNG = 0, 1, 2


class HyperelasticLaw(Protocol):
    """A law of the family: which g, and its one coefficient."""

    @property
    def code(self) -> int:
        """The number by which the compiled kernels know g."""
        ...

    @property
    def coefficient(self) -> float:
        """Stiffening coefficient of g, 1; zero makes every law neo-Hookean."""
        ...


@dataclass(frozen=True)
class NeoHookean:
    """g = Q."""

    code: ClassVar[int] = _NEO_HOOKEAN
    coefficient: ClassVar[float] = 0.0


@dataclass(frozen=True)
class Yeoh:
    """g = Q + c Q^2, with the stiffening coefficient c >= 0."""

    coefficient: float
    code: ClassVar[int] = _YEOH

    def __post_init__(self) -> None:
        _check(self.coefficient)


@dataclass(frozen=True)
class Fung:
    """g = (exp(b Q) - 1)/b, with the stiffening coefficient b >= 0."""

    coefficient: float
    code: ClassVar[int] = _FUNG

    def __post_init__(self) -> None:
        _check(self.coefficient)


def _check(coefficient: float) -> None:
    if not (math.isfinite(coefficient) and coefficient >= 0):
        raise MeshError(
            f"a stiffening coefficient is zero or positive, got {coefficient}: with a negative one "
            "the body loses its stiffness at some strain"
        )


@numba.njit(inline="always")
def stiffening(code, c, q):
    """g(Q), g'(Q), g''(Q) and dg'/dc of a law (all 1)."""
    if code == _YEOH:
        return q + c * q * q, 1 + 2 * c * q, 2 * c, 2 * q
    if code == _FUNG:
        rise = math.exp(c * q)
        return (math.expm1(c * q) / c if c > 0 else q), rise, c * rise, q * rise
    return q, 1.0, 0.0, 0.0


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
