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


@numba.njit(cache=True, error_model="numpy")
def _distance(r: float, z: float, a: float):
    """Complex distance R; beside the tip it goes on smoothly above the surface, to z < 0."""
    # abs: a negative zero of z must not change the branch under the tip
    side = z if r > a else abs(z)
    x, y = r * r + z * z - a * a, 2 * side * a
    # The principal root by hand: three times as fast as the library's
    larger = np.sqrt((np.sqrt(x * x + y * y) + abs(x)) / 2)
    larger = max(larger, 1e-12 * a)  # on the rim itself the strain is infinite
    other = y / (2 * larger)
    return complex(larger, other) if x >= 0 else complex(abs(other), np.copysign(larger, y))


@numba.njit(cache=True, error_model="numpy")
def _inverse(c: complex):
    return complex(c.real, -c.imag) * (1 / (c.real * c.real + c.imag * c.imag))


@numba.njit(cache=True, error_model="numpy")
def potential(r: float, z: float, a: float, profile: int):
    """V at one point, unit force."""
    zeta = complex(z, a)
    root = _distance(r, z, a)
    total = root + zeta
    if profile == FLAT:
        return np.arctan2(total.imag, total.real) / a
    log = np.log(total)
    # Im int_0^a s f(z + i s) ds = -Im (M1 - z M0), M0 and M1 the primitives of f and zeta f
    first = zeta**2 * log / 2 - (zeta * root - r * r * log) / 4
    return -3.0 / a**3 * (first - z * (zeta * log - root)).imag


@numba.njit(cache=True, error_model="numpy")
def slopes(r: float, z: float, a: float, profile: int):
    """V_z, V_r/r, psi_r/r, V_zz, V_rz/r at one point, unit force."""
    zeta = complex(z, a)
    root = _distance(r, z, a)
    inverse, other = _inverse(root), _inverse(root + zeta)
    if profile == FLAT:
        s = 1.0 / a
        cube = inverse * inverse * inverse
        return (
            s * inverse.imag,
            s * (inverse * other).imag,
            -s * other.imag,
            -s * (zeta * cube).imag,
            -s * cube.imag,
        )
    s = -3.0 / a**3
    log = np.log(root + zeta)
    return (
        s * (root - z * log).imag,
        s * (log / 2 - zeta * other / 2 + z * other).imag,
        -s * ((root * root + root * zeta + zeta * zeta) * other / 3
              - z * (log / 2 + zeta * other / 2)).imag,
        -s * (log - zeta * inverse + z * inverse).imag,
        -s * (z * inverse * other - inverse).imag,
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def field(r: float, z: float, a: float, nu: float, profile: int):
    """u_z, u_r and du_z/dz, du_z/dr, du_r/dz, du_r/dr, u_r/r at one point, unit force and E = 1.

    u_z and u_r are finite on the rim too.
    """
    return field_of(r, z, nu, potential(r, z, a, profile), *slopes(r, z, a, profile))


@numba.njit(cache=True, error_model="numpy")
def field_of(r, z, nu, v, v_z, v_r, psi_r, v_zz, v_rz):
    """Return the result of `field` from `potential` and `slopes`."""
    k = (1 + nu) / (2 * np.pi)
    c = 1 - 2 * nu
    # z V_z and z V_r vanish on the surface, where V_z may be infinite
    w_z, w_r = (z * v_z, z * v_r) if z != 0 else (0.0, 0.0)
    tilt = k * r * (2 * (1 - nu) * v_r - z * v_rz)
    return (
        k * (2 * (1 - nu) * v - w_z),
        -k * r * (c * psi_r + w_r),
        k * (c * v_z - z * v_zz),
        tilt,
        -2 * k * z * r * v_rz - tilt,
        k * (c * (v_z + psi_r) + z * (v_zz + v_r)),
        -k * (c * psi_r + z * v_r),
    )


@numba.njit(cache=True, error_model="numpy")
def outward(r: float, z: float, a: float, nu: float):
    r"""u_z, u_r and the gradients of `field` under the tangential traction r p(r), outwards.

    With p of the flat punch, unit length and E = 1: r p = dS/dr with S = -(a^2/3) times Hertz's
    pressure, so that with V of that pressure, times -a^2/3,

        u_r = k [2 (1 - nu) V_r + z V_rz],    u_z = k [z V_zz - (1 - 2 nu) V_z]

    (Johnson, eq. 3.4, with F_1 = dX/dx, G_1 = dX/dy and X_zz = V).
    """
    k = -(1 + nu) / (2 * np.pi) * a * a / 3
    c = 1 - 2 * nu
    v_z, v_r, _, v_zz, v_rz = slopes(r, z, a, HERTZ)
    zeta = complex(z, a)
    root = _distance(r, z, a)
    inverse, other = _inverse(root), _inverse(root + zeta)
    edge = complex(0.0, a) * inverse * inverse * inverse
    s = 3.0 / a**3
    v_zzz = s * (inverse + zeta * edge).imag
    v_rzz = s * r * (inverse * other + edge).imag
    v_rr = -v_zz - v_r
    return (
        k * (z * v_zz - c * v_z),
        k * r * (2 * (1 - nu) * v_r + z * v_rz),
        k * (2 * nu * v_zz + z * v_zzz),
        k * (z * v_rzz - c * r * v_rz),
        k * ((3 - 2 * nu) * r * v_rz + z * v_rzz),
        k * (2 * (1 - nu) * v_rr - z * (v_zzz + v_rz)),
        k * (2 * (1 - nu) * v_r + z * v_rz),
    )


@numba.njit(cache=True, error_model="numpy")
def displacement(r: float, z: float, a: float, nu: float, profile: int):
    """u_z and u_r at one point, unit force and E = 1; finite on the rim too."""
    return field(r, z, a, nu, profile)[:2]


@numba.njit(cache=True, error_model="numpy")
def strain(r: float, z: float, a: float, nu: float, profile: int):
    """e_zz, e_rr, e_tt, e_rz at one point, unit force and E = 1."""
    _, _, e_zz, zr, rz, e_rr, e_tt = field(r, z, a, nu, profile)
    return e_zz, e_rr, e_tt, (zr + rz) / 2


def patch_grid(reach_m: float, patches: int, disc: bool = False) -> tuple[np.ndarray, float]:
    """Centres (i, 2) and side of square patches, `patches` across a width of 2 reach.

    Parameters
    ----------
    disc : keep the patches whose centre lies in the circle, and scale the grid such that they have
        its area: the rim of a flat tip is then right to second order in the side.
    """
    side = 2 * reach_m / patches
    line = side * (np.arange(patches) - (patches - 1) / 2)
    x, y = (v.ravel() for v in np.meshgrid(line, line, indexing="ij"))
    centres = np.column_stack([x, y])
    if disc:
        centres = centres[np.hypot(x, y) < reach_m]
        scale = np.sqrt(np.pi * reach_m**2 / len(centres)) / side
        centres, side = centres * scale, side * scale
    return centres, side


def half_space_matrix(centres: np.ndarray, side: float, poisson_ratio: float) -> np.ndarray:
    """Displacement at the centre of patch i under a unit force on patch j, (i, i) Pa m/N.

    For E = 1; uniform pressure on a rectangle (Love 1929; Johnson, Contact Mechanics, eq. 3.25).
    """
    x, y = (centres[:, None, a] - centres[None, :, a] for a in (0, 1))

    def corner(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return u * np.arcsinh(v / np.abs(u)) + v * np.arcsinh(u / np.abs(v))

    b = side / 2
    total = (
        corner(x + b, y + b) + corner(x - b, y - b) - corner(x + b, y - b) - corner(x - b, y + b)
    )
    return (1 - poisson_ratio**2) / (np.pi * side**2) * total
