"""Compliance of a spherical cap, bonded at its flat base, pressed at its apex: axisymmetric, exact.

Another formulation than `fem`: products of polynomials of high degree on quadrilaterals that follow
rays from the middle of the base, with the sphere itself as geometry, graded towards the rim of the
contact, and without a near field. The degrees 5 and 8 agree to 1e-5. The pressure stands on the
tip's plane, as in `fem.contact.contacts`.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

FIRST, GROWTH = 1e-4, 4.0  # smallest element over its distance from the apex, and their ratio


def cap_compliance(
    sphere: float, height: float, contact: float, nu: float, profile: str, degree: int = 5
) -> float:
    """Compliance under unit force for E = 1, in the inverse of the unit of the three lengths.

    Parameters
    ----------
    sphere : radius
    height : of the cap, at most the radius
    contact : radius of the contact
    profile : "flat" or "hertz"
    """
    rim, end = np.arcsin(contact / sphere), np.arccos(1 - height / sphere)
    inner, outer = rim - _graded(rim, rim)[::-1], rim + _graded(end - rim, rim)
    last = np.array([0.5, 0.8, 0.95])  # towards the corner of the bonded base
    angles = np.r_[inner, outer[1:-1], outer[-2] + last * (outer[-1] - outer[-2]), outer[-1]]
    shares = 1 - _graded(1.0, contact / height)[::-1]
    points, weights = np.polynomial.legendre.leggauss(degree + 3)
    value, slope = _basis(degree, points)
    lam, mu = nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))
    law = np.diag([2 * mu, 2 * mu, 2 * mu, mu])
    law[:3, :3] += lam
    tall = degree * (len(shares) - 1) + 1
    size = 2 * tall * (degree * (len(angles) - 1) + 1)
    own = np.add.outer(np.arange(degree + 1) * tall, np.arange(degree + 1)).ravel()
    both, along, down = (
        np.einsum("qi,rj->qrij", a, b).reshape(len(points) ** 2, -1)
        for a, b in ((value, value), (slope, value), (value, slope))
    )
    rows, columns, entries = [], [], []
    for i in range(len(angles) - 1):
        t, step = _on(angles, i, points)
        surface = np.array([sphere * np.sin(t), sphere * np.cos(t) - (sphere - height)])
        turn = np.array([sphere * np.cos(t), -sphere * np.sin(t)]) * step
        for j in range(len(shares) - 1):
            s, width = _on(shares, j, points)
            r = np.outer(surface[0], s).ravel()
            by_t = np.einsum("xq,r->qrx", turn, s).reshape(-1, 2)
            by_s = np.einsum("xq,r->qrx", surface, np.full_like(s, width)).reshape(-1, 2)
            jacobian = np.stack([by_t, by_s], axis=1)
            inverse = np.linalg.inv(jacobian)
            by_r, by_z = (
                inverse[:, x, 0, None] * along + inverse[:, x, 1, None] * down for x in (0, 1)
            )
            strain = np.zeros((len(r), 4, 2 * len(own)))
            strain[:, 0, ::2], strain[:, 1, 1::2], strain[:, 2, ::2] = by_r, by_z, both / r[:, None]
            strain[:, 3, ::2], strain[:, 3, 1::2] = by_z, by_r
            volume = np.outer(weights, weights).ravel() * np.abs(np.linalg.det(jacobian))
            stress = (law @ strain) * (2 * np.pi * r * volume)[:, None, None]
            matrix = strain.reshape(-1, 2 * len(own)).T @ stress.reshape(-1, 2 * len(own))
            place = i * degree * tall + j * degree + own
            dof = np.stack([2 * place, 2 * place + 1], axis=1).ravel()
            rows.append(np.repeat(dof, len(dof)))
            columns.append(np.tile(dof, len(dof)))
            entries.append(matrix.ravel())
    indices = np.concatenate(rows), np.concatenate(columns)
    stiffness = sp.coo_array((np.concatenate(entries), indices), shape=(size, size)).tocsc()
    load = np.zeros(size)
    for i in range(len(inner) - 1):  # with s = sqrt(1 - r^2/a^2), a flat pressure is even in s
        ends = np.sqrt(np.maximum(1 - (sphere * np.sin(angles[i : i + 2]) / contact) ** 2, 0))
        if i == len(inner) - 2:
            ends[1] = 0.0
        g, w = np.polynomial.legendre.leggauss(40)
        s, w = ends[1] + (ends[0] - ends[1]) * (g + 1) / 2, w * (ends[0] - ends[1]) / 2
        w = w if profile == "flat" else 3 * s**2 * w
        t = np.arcsin(contact * np.sqrt(1 - s**2) / sphere)
        shape = _basis(degree, 2 * (t - angles[i]) / (angles[i + 1] - angles[i]) - 1)[0]
        nodes = (i * degree + np.arange(degree + 1)) * tall + tall - 1
        load[2 * nodes + 1] -= w @ shape
    held = np.zeros((size // (2 * tall), tall, 2), bool)
    held[0, :, 0], held[-1], held[:, 0] = True, True, True
    free = np.flatnonzero(~held.ravel())
    return float(load[free] @ spsolve(stiffness[free][:, free], load[free]))


def _graded(length: float, scale: float) -> np.ndarray:
    """Places from 0 to a length whose distances grow."""
    places, next_one = [0.0], FIRST * scale
    while next_one < 0.7 * length:
        places.append(next_one)
        next_one *= GROWTH
    return np.array([*places, length])


def _on(places: np.ndarray, i: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Quadrature points of an interval, and half of its length."""
    half = (places[i + 1] - places[i]) / 2
    return places[i] + half * (points + 1), half


def _basis(degree: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange polynomials of the Gauss-Lobatto points and their derivatives, (p, degree + 1)."""
    legendre = np.polynomial.legendre
    inside = legendre.Legendre.basis(degree).deriv().roots().real
    inverse = np.linalg.inv(legendre.legvander(np.r_[-1.0, np.sort(inside), 1.0], degree))
    return legendre.legvander(at, degree) @ inverse, np.stack(
        [legendre.legval(at, legendre.legder(column)) for column in inverse.T], axis=-1
    )
