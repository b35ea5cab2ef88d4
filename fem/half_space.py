r"""Exact fields of a half-space under a unit force, spread as a flat punch or a Hertz contact.

Axisymmetric, frictionless; z is the depth, r the distance from the axis, the displacements are
positive into the body and outwards; Young's modulus 1. With the Boussinesq potentials of the
pressure (Johnson, Contact Mechanics, eq. 3.4; V = int p/R, psi_z = V) and k = (1 + nu)/(2 pi),

    u_z = k [2 (1 - nu) V - z V_z],     u_r = -k [(1 - 2 nu) psi_r + z V_r].

For the rigid flat punch, p = 1/(2 pi a^2 sqrt(1 - r^2/a^2)), they are closed forms of the
complex distance R = sqrt(r^2 + zeta^2), zeta = z + i a (a V = Im ln(R + zeta), and so on); the
Hertz pressure is the superposition of punches of radius s <= a with weight 3 s^2/a^3, integrated
in closed form.
"""

from __future__ import annotations

import numba
import numpy as np

FLAT, HERTZ = 0, 1


def mean_displacement(radius_m: float, poisson_ratio: float, profile: int) -> float:
    """Pressure-weighted mean of u_z under the contact for unit force and E = 1, m Pa / N.

    (1 - nu^2)/(2 a) for the flat punch, 0.6 (1 - nu^2)/a for the Hertz pressure.
    """
    return (0.5 if profile == FLAT else 0.6) * (1 - poisson_ratio**2) / radius_m


@numba.njit(cache=True)
def potentials(r: float, z: float, a: float, profile: int):
    """V, V_z, V_r/r, psi_r/r, V_zz, V_rz/r at one point, unit force."""
    zeta = complex(z, a)
    # abs: the sign of a zero depth would pick the branch; the rim itself is finite in displacement
    root = np.sqrt(complex(r * r + z * z - a * a, 2 * abs(z) * a))
    if abs(root) < 1e-12 * a:
        root = complex(1e-12 * a, 0.0)
    total = root + zeta
    log = np.log(total)
    if profile == FLAT:
        s = 1.0 / a
        return (
            s * log.imag,
            s * (1 / root).imag,
            s * (1 / (root * total)).imag,
            -s * (1 / total).imag,
            -s * (zeta / root**3).imag,
            -s * (1 / root**3).imag,
        )
    # Im int_0^a s f(z + i s) ds = -Im (M1 - z M0), M0 and M1 the primitives of f and zeta f
    s = -3.0 / a**3
    return (
        s * (zeta**2 * log / 2 - (zeta * root - r * r * log) / 4 - z * (zeta * log - root)).imag,
        s * (root - z * log).imag,
        s * (log / 2 - zeta / (2 * total) + z / total).imag,
        -s * ((root**2 + root * zeta + zeta**2) / (3 * total)
              - z * (log / 2 + zeta / (2 * total))).imag,
        -s * (log - zeta / root + z / root).imag,
        -s * (-1 / root + z / (root * total)).imag,
    )  # fmt: skip


@numba.njit(cache=True)
def displacement(r: float, z: float, a: float, nu: float, profile: int):
    """u_z and u_r at one point, unit force and E = 1."""
    v, v_z, v_r, psi_r, _, _ = potentials(r, z, a, profile)
    k = (1 + nu) / (2 * np.pi)
    return k * (2 * (1 - nu) * v - z * v_z), -k * r * ((1 - 2 * nu) * psi_r + z * v_r)


@numba.njit(cache=True)
def strain(r: float, z: float, a: float, nu: float, profile: int):
    """e_zz, e_rr, e_tt, e_rz at one point, unit force and E = 1."""
    _, v_z, v_r, psi_r, v_zz, v_rz = potentials(r, z, a, profile)
    k = (1 + nu) / (2 * np.pi)
    c = 1 - 2 * nu
    return (
        k * (c * v_z - z * v_zz),
        k * (c * (v_z + psi_r) + z * (v_zz + v_r)),
        -k * (c * psi_r + z * v_r),
        -k * z * r * v_rz,
    )
