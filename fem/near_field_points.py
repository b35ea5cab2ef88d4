"""A press's near-field functions at quadrature points, and sums over batches of such points.

The functions are v, x v, y v, z v with v the half-space's field (`fem.half_space`), z the depth
below the paraboloid that follows the surface (`fem.contact_shape`); see `fem.near_field`.
"""

from __future__ import annotations

import numba
import numpy as np

from fem import half_space
from fem.contact_shape import depth_below, slope

FUNCTIONS = 4  # v times 1, x, y, z
BATCH = 60  # quadrature points whose moments are summed as one product of matrices
_STRAINS = 6 * FUNCTIONS


@numba.njit(cache=True, error_model="numpy")
def functions(points, shape, radius, nu, profile):
    """Values of the functions at points (p, 3): (p, m, 3)."""
    values = np.empty((len(points), FUNCTIONS, 3))
    for p in range(len(points)):
        x, y = points[p, 0], points[p, 1]
        depth = depth_below(shape, x, y, points[p, 2], radius)
        u_x, u_y, u_z = _field(x, y, depth, radius, nu, profile)
        for m in range(FUNCTIONS):
            factor = 1.0 if m == 0 else (x, y, depth)[m - 1] / radius
            values[p, m, 0] = factor * u_x
            values[p, m, 1] = factor * u_y
            values[p, m, 2] = factor * u_z
    return values


@numba.njit(cache=True, error_model="numpy")
def _field(x, y, z, radius, nu, profile):
    r = np.sqrt(x * x + y * y)
    u_z, u_r = half_space.displacement(r, z, radius, nu, profile)
    scale = u_r / r if r > 0 else 0.0
    return scale * x, scale * y, u_z


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _strains(eps, position, shape, radius, nu, profile):
    """Strains of the functions at a point, (6 m,): e_xx, e_yy, e_zz, e_xy, e_xz, e_yz of each."""
    x, y = position[0], position[1]
    z = depth_below(shape, x, y, position[2], radius)
    r = np.sqrt(x * x + y * y)
    u_z, u_r, zz, zr, rz, rr, tt = half_space.field(r, z, radius, nu, profile)
    cx, cy = (x / r, y / r) if r > 0 else (1.0, 0.0)
    u_x, u_y = u_r * cx, u_r * cy
    h_x, h_y = slope(shape, x, y)
    for m in range(FUNCTIONS):
        f = 1.0 if m == 0 else (x, y, z)[m - 1] / radius
        f_x = 1 / radius if m == 1 else 0.0
        f_y = 1 / radius if m == 2 else 0.0
        f_z = 1 / radius if m == 3 else 0.0
        # Derivatives by x and y at constant depth below the paraboloid, and by that depth
        xz, yz, zz_ = f * rz * cx + f_z * u_x, f * rz * cy + f_z * u_y, f * zz + f_z * u_z
        off = f * (rr - tt) * cx * cy
        eps[6 * m] = f * (rr * cx * cx + tt * cy * cy) + f_x * u_x - h_x * xz
        eps[6 * m + 1] = f * (rr * cy * cy + tt * cx * cx) + f_y * u_y - h_y * yz
        eps[6 * m + 2] = zz_
        eps[6 * m + 3] = off + 0.5 * (f_y * u_x + f_x * u_y - h_y * xz - h_x * yz)
        eps[6 * m + 4] = 0.5 * (f * zr * cx + f_x * u_z - h_x * zz_ + xz)
        eps[6 * m + 5] = 0.5 * (f * zr * cy + f_y * u_z - h_y * zz_ + yz)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def put_point(
    batch, k, position, weight, barycentric, shape, radius, nu, profile, lam, mu, projection
):
    """Evaluate a quadrature point into row k of a batch (see `batch_of_points`)."""
    strains, products, lower, higher = batch
    eps, low, high = strains[k], lower[k], higher[k]
    _strains(eps, position, shape, radius, nu, profile)
    degree = 1 if lower.shape[1] == 4 else 2
    i = j = 0  # in the order of `monomials`
    for a in range(4):
        s = weight * barycentric[a]
        if degree == 1:
            low[i] = s
            i += 1
        for b in range(a, 4):
            t = s * barycentric[b]
            if degree == 1:
                high[j] = t
                j += 1
                continue
            low[i] = t
            i += 1
            for d in range(b, 4):
                high[j] = t * barycentric[d]
                j += 1
    if len(projection) > 0:
        _project(eps, projection, products[k])
    else:
        _energies(eps, lam, mu, products[k])


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _energies(eps, lam, mu, products):
    """Twice the energy density of each pair of functions of strains eps (6 m,)."""
    pair = 0
    for m in range(FUNCTIONS):
        i = 6 * m
        trace = lam * (eps[i] + eps[i + 1] + eps[i + 2])
        xx, yy = trace + 2 * mu * eps[i], trace + 2 * mu * eps[i + 1]
        zz = trace + 2 * mu * eps[i + 2]
        xy, xz, yz = 4 * mu * eps[i + 3], 4 * mu * eps[i + 4], 4 * mu * eps[i + 5]
        for n in range(m + 1):
            j = 6 * n
            straight = xx * eps[j] + yy * eps[j + 1] + zz * eps[j + 2]
            products[pair] = straight + xy * eps[j + 3] + xz * eps[j + 4] + yz * eps[j + 5]
            pair += 1


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _project(eps, projection, products):
    """Products of each pair of the projected strains (s, 6) of the functions."""
    kinds = len(projection)
    parts = np.zeros(kinds * FUNCTIONS)
    pair = 0
    for m in range(len(parts)):
        for i in range(6):
            parts[m] += projection[m % kinds, i] * eps[6 * (m // kinds) + i]
        for n in range(m + 1):
            products[pair] = parts[m] * parts[n]
            pair += 1


@numba.njit(cache=True)
def batch_of_points(pairs, low, high):
    """Rows for quadrature points: strains, their products, and the two sets of monomials."""
    return (
        np.empty((BATCH, _STRAINS)),
        np.empty((BATCH, pairs)),
        np.empty((BATCH, low)),
        np.empty((BATCH, high)),
    )


@numba.njit(cache=True)
def add_batch(batch, count, strain, products):
    """Add the first `count` points of a batch to a cell's moments (k, 6 m) and (pairs, k)."""
    strains, parts, lower, higher = batch
    strain += np.dot(higher[:count].T, strains[:count])
    products += np.dot(parts[:count].T, lower[:count])
