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
from typing import ClassVar

import numba

from fem.errors import MeshError

_NEO_HOOKEAN, _YEOH, _FUNG = 0, 1, 2


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


HyperelasticLaw = NeoHookean | Yeoh | Fung
"""The compiled kernels know the laws by their `code`."""


def _check(coefficient: float) -> None:
    if not (math.isfinite(coefficient) and coefficient >= 0):
        raise MeshError(
            f"a stiffening coefficient is zero or positive, got {coefficient}: with a negative one "
            "the body loses its stiffness at some strain"
        )


@numba.njit(inline="always")
def stiffening(code, c, q):
    """g(Q), g'(Q) and g''(Q) of a law (all 1)."""
    if code == _YEOH:
        return q + c * q * q, 1 + 2 * c * q, 2 * c
    if code == _FUNG:
        rise = math.exp(c * q)
        return (math.expm1(c * q) / c if c > 0 else q), rise, c * rise
    return q, 1.0, 0.0
