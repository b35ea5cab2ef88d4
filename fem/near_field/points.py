"""A press's near-field functions at quadrature points, and sums over batches of such points.

The functions are v, x v, y v, z v with v the half-space's field (`fem.contact.half_space`), z the
depth below the paraboloid that follows the surface (`fem.contact.paraboloid`); see
`fem.near_field.enrichment`.
"""

from __future__ import annotations

import numba
import numpy as np

from fem.contact import half_space
from fem.contact.paraboloid import bending, depth_below, slope

FUNCTIONS = 4  # v times 1, x, y, z
BATCH = 64  # quadrature points that are evaluated together
_STRAINS = 6 * FUNCTIONS


@numba.njit(cache=True, error_model="numpy")
def functions(points, shape, radius, nu, profile):
    """Values of the functions at points (p, 3): (p, m, 3)."""
    values = np.empty((len(points), FUNCTIONS, 3))
    bend = shape[3] + shape[5] if profile == half_space.FLAT else 0.0
    for p in range(len(points)):
        x, y = points[p, 0], points[p, 1]
        depth = depth_below(shape, x, y, points[p, 2], radius)
        h_x, h_y = slope(shape, x, y)
        foot_x, foot_y = x + depth * h_x, y + depth * h_y
        r = np.sqrt(foot_x * foot_x + foot_y * foot_y)
        w, u_r = half_space.displacement(r, depth, radius, nu, profile)
        if bend != 0:
            along = half_space.outward(r, depth, radius, nu)
            w, u_r = w + bend * along[0], u_r + bend * along[1]
        scale = u_r / r if r > 0 else 0.0
        u, v = scale * foot_x, scale * foot_y
        for m in range(FUNCTIONS):
            factor = 1.0 if m == 0 else (x, y, depth)[m - 1] / radius
            values[p, m, 0] = factor * (u - h_x * w)
            values[p, m, 1] = factor * (v - h_y * w)
            values[p, m, 2] = factor * (w + h_x * u + h_y * v)
    return values


@numba.njit(cache=True)
def batch_of_points(pairs, low, high):
    """Room for quadrature points, a column each: loops over the points become ones of vectors.

    Places and weight, barycentric coordinates, strains of the functions, their products, and the
    two sets of monomials.
    """
    return (
        np.empty((4, BATCH)),
        np.empty((4, BATCH)),
        np.empty((_STRAINS, BATCH)),
        np.empty((pairs, BATCH)),
        np.empty((low, BATCH)),
        np.empty((high, BATCH)),
    )


@numba.njit(cache=True)
def put_point(batch, k, position, weight, barycentric):
    """Take a quadrature point into column k of a batch (see `batch_of_points`)."""
    place, corners = batch[:2]
    for i in range(3):
        place[i, k] = position[i]
    place[3, k] = weight
    for a in range(4):
        corners[a, k] = barycentric[a]


@numba.njit(cache=True)
def add_batch(batch, count, strain, products, shape, radius, nu, profile, lam, mu, projection):
    """Add the first `count` points of a batch to a cell's moments (k, 6 m) and (pairs, k)."""
    place, corners, strains, parts, lower, higher = batch
    _strains(strains, count, place, shape, radius, nu, profile)
    _monomials(lower, higher, count, place[3], corners)
    if len(projection) > 0:
        _project(parts, count, strains, projection)
    else:
        _energies(parts, count, strains, lam, mu)
    _add_products(strain, count, higher, strains)
    _add_products(products, count, parts, lower)


@numba.njit(inline="always")
def _by_functions(eps, count, place, foot, field, shape, radius):
    """Fill the strains of v times 1, x, y, z from v and its derivatives, `field` (12, k)."""
    for m in range(FUNCTIONS):
        for k in range(count):
            f, f_x, f_y, f_z = 1.0, 0.0, 0.0, 0.0
            if m == 1:
                f, f_x = place[0, k] / radius, 1 / radius
            elif m == 2:
                f, f_y = place[1, k] / radius, 1 / radius
            elif m == 3:
                h_x, h_y = slope(shape, place[0, k], place[1, k])
                f, f_x, f_y, f_z = foot[2, k] / radius, -h_x / radius, -h_y / radius, 1 / radius
            u, v, w = field[0, k], field[1, k], field[2, k]
            eps[6 * m, k] = f * field[3, k] + f_x * u
            eps[6 * m + 1, k] = f * field[7, k] + f_y * v
            eps[6 * m + 2, k] = f * field[11, k] + f_z * w
            eps[6 * m + 3, k] = 0.5 * (f * (field[4, k] + field[6, k]) + f_y * u + f_x * v)
            eps[6 * m + 4, k] = 0.5 * (f * (field[5, k] + field[9, k]) + f_z * u + f_x * w)
            eps[6 * m + 5, k] = 0.5 * (f * (field[8, k] + field[10, k]) + f_z * v + f_y * w)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _strains(eps, count, place, shape, radius, nu, profile):
    """Strains of the functions at points, (6 m, k): e_xx, e_yy, e_zz, e_xy, e_xz, e_yz of each."""
    radial, potential = np.empty(BATCH), np.empty((6, BATCH))
    foot, field = np.empty((3, BATCH)), np.empty((12, BATCH))
    bend = shape[3] + shape[5] if profile == half_space.FLAT else 0.0
    for k in range(count):
        x, y = place[0, k], place[1, k]
        z = depth_below(shape, x, y, place[2, k], radius)
        h_x, h_y = slope(shape, x, y)
        foot[0, k], foot[1, k], foot[2, k] = x + z * h_x, y + z * h_y, z
        radial[k] = np.sqrt(foot[0, k] ** 2 + foot[1, k] ** 2)
    for k in range(count):  # apart, as it slows the others down
        potential[0, k] = half_space.potential(radial[k], foot[2, k], radius, profile)
    for k in range(count):
        slopes = half_space.slopes(radial[k], foot[2, k], radius, profile)
        for i in range(5):
            potential[i + 1, k] = slopes[i]
    for k in range(count):
        x, y, z, r = foot[0, k], foot[1, k], foot[2, k], radial[k]
        u_z, u_r, zz, zr, rz, rr, tt = half_space.field_of(
            r, z, nu, potential[0, k], potential[1, k], potential[2, k], potential[3, k],
            potential[4, k], potential[5, k],
        )  # fmt: skip
        if bend != 0:
            along = half_space.outward(r, z, radius, nu)
            u_z, u_r, zz, zr = (
                u_z + bend * along[0], u_r + bend * along[1],
                zz + bend * along[2], zr + bend * along[3],
            )  # fmt: skip
            rz, rr, tt = rz + bend * along[4], rr + bend * along[5], tt + bend * along[6]
        cx, cy = (x / r, y / r) if r > 0 else (1.0, 0.0)
        # The field and its derivatives in the frame of the surface below
        u, v = u_r * cx, u_r * cy
        xx, yy, xy = rr * cx * cx + tt * cy * cy, rr * cy * cy + tt * cx * cx, (rr - tt) * cx * cy
        xz, yz, zx, zy = rz * cx, rz * cy, zr * cx, zr * cy
        # Derivatives by the body's x, y, z: those of the foot are (p, q), (q, s) across, h along
        h_x, h_y = slope(shape, place[0, k], place[1, k])
        h_xx, h_xy, h_yy = bending(shape, place[0, k], place[1, k])
        p, q, s = 1 - h_x * h_x + z * h_xx, z * h_xy - h_x * h_y, 1 - h_y * h_y + z * h_yy
        xx, xy, xz, yx, yy, yz, zx, zy, zz = (
            xx * p + xy * q - xz * h_x, xx * q + xy * s - xz * h_y, xx * h_x + xy * h_y + xz,
            xy * p + yy * q - yz * h_x, xy * q + yy * s - yz * h_y, xy * h_x + yy * h_y + yz,
            zx * p + zy * q - zz * h_x, zx * q + zy * s - zz * h_y, zx * h_x + zy * h_y + zz,
        )  # fmt: skip
        # Turned with the surface
        field[0, k], field[1, k], field[2, k] = (
            u - h_x * u_z,
            v - h_y * u_z,
            u_z + h_x * u + h_y * v,
        )
        field[3, k] = xx - h_x * zx - h_xx * u_z
        field[4, k] = xy - h_x * zy - h_xy * u_z
        field[5, k] = xz - h_x * zz
        field[6, k] = yx - h_y * zx - h_xy * u_z
        field[7, k] = yy - h_y * zy - h_yy * u_z
        field[8, k] = yz - h_y * zz
        field[9, k] = zx + h_x * xx + h_y * yx + h_xx * u + h_xy * v
        field[10, k] = zy + h_x * xy + h_y * yy + h_xy * u + h_yy * v
        field[11, k] = zz + h_x * xz + h_y * yz
    _by_functions(eps, count, place, foot, field, shape, radius)


@numba.njit(cache=True, fastmath=True)
def _monomials(lower, higher, count, weight, corners):
    """Weighted products of the barycentric coordinates, in the order of `monomials`."""
    degree = 1 if len(lower) == 4 else 2
    i = j = 0
    for a in range(4):
        if degree == 1:
            for k in range(count):
                lower[i, k] = weight[k] * corners[a, k]
            i += 1
        for b in range(a, 4):
            if degree == 1:
                for k in range(count):
                    higher[j, k] = weight[k] * corners[a, k] * corners[b, k]
                j += 1
                continue
            for k in range(count):
                lower[i, k] = weight[k] * corners[a, k] * corners[b, k]
            for d in range(b, 4):
                for k in range(count):
                    higher[j, k] = lower[i, k] * corners[d, k]
                j += 1
            i += 1


@numba.njit(cache=True, fastmath=True)
def _energies(products, count, eps, lam, mu):
    """Twice the energy density (pairs, k) of each pair of functions of strains eps (6 m, k)."""
    pair = 0
    for m in range(FUNCTIONS):
        e = eps[6 * m : 6 * m + 6]
        for n in range(m + 1):
            o = eps[6 * n : 6 * n + 6]
            for k in range(count):
                trace = (e[0, k] + e[1, k] + e[2, k]) * (o[0, k] + o[1, k] + o[2, k])
                straight = e[0, k] * o[0, k] + e[1, k] * o[1, k] + e[2, k] * o[2, k]
                shear = e[3, k] * o[3, k] + e[4, k] * o[4, k] + e[5, k] * o[5, k]
                products[pair, k] = lam * trace + 2 * mu * (straight + 2 * shear)
            pair += 1


@numba.njit(cache=True, fastmath=True)
def _project(products, count, eps, projection):
    """Products (pairs, k) of each pair of the projected strains (s, 6) of the functions."""
    kinds = len(projection)
    parts = np.zeros((kinds * FUNCTIONS, BATCH))
    pair = 0
    for m in range(len(parts)):
        for i in range(6):
            for k in range(count):
                parts[m, k] += projection[m % kinds, i] * eps[6 * (m // kinds) + i, k]
        for n in range(m + 1):
            for k in range(count):
                products[pair, k] = parts[m, k] * parts[n, k]
            pair += 1


@numba.njit(cache=True, fastmath=True)
def _add_products(sums, count, first, second):
    """Add to sums (a, b) the products of the rows of (a, k) and (b, k); a and b are even."""
    for i in range(0, len(first), 2):
        for j in range(0, len(second), 2):
            even, right, below, both = 0.0, 0.0, 0.0, 0.0  # four at a time share what is loaded
            for k in range(count):
                f, g, s, t = first[i, k], first[i + 1, k], second[j, k], second[j + 1, k]
                even += f * s
                right += f * t
                below += g * s
                both += g * t
            sums[i, j] += even
            sums[i, j + 1] += right
            sums[i + 1, j] += below
            sums[i + 1, j + 1] += both
