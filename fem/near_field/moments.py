"""Strains and energies of a press's near-field functions, integrated over cells.

The functions are those of `fem.near_field.points`; the integrals serve `fem.near_field.enrichment`.
Numba's cache does not see a change in that file: change this one too, or kernels stay as they were.
"""

from __future__ import annotations

import math
from functools import cache

import numba
import numpy as np

from fem.contact.paraboloid import height
from fem.linear.assembly import split_lame
from fem.linear.quadrature import TET_RULES, monomials
from fem.near_field.points import BATCH, FUNCTIONS, add_batch, batch_of_points, put_point

# Radius of the polar quadrature around the rim: this many tip radii, but no more than this part of
# the least height of the cells there. Its points are dealt out to the cells that hold them, which
# integrates over each of them only if they are larger than the tube.
_TUBE = 0.35
_TUBE_CELLS = 0.3
_THINNEST = 0.05  # tip radii; the cost grows like one over the tube's radius
# Largest diameter of a quadrature cell over its distance from the rim; within the tube, over the
# tube's radius. Compliances are off by less than 5e-5, by 2e-3 on a surface that bends under a tip.
_LEAF = 1.5
_POINTS = (96, 8, 12)  # in the tube: around the rim, outwards, across
# Of a tetrahedron: ends of its edges, and corners (or, from 4 on, middles) of its eight parts
_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_CHILDREN = np.array([[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
                      [4, 6, 7, 8], [4, 6, 5, 8], [6, 7, 8, 9], [6, 5, 8, 9]])  # fmt: skip


def moments(
    vertices: np.ndarray, shape: np.ndarray, radius: float, nu: float, profile: int, degree: int = 1
):
    """Integrals over each cell of the functions' strain and energy density.

    Cells are cut towards the rim; at the rim itself the points are polar. A smooth partition of
    unity passes from one to the other, so that neither meets a singular or discontinuous integrand.

    Parameters
    ----------
    degree : of the modulus in each cell

    Returns
    -------
    strain : (c, m, 6, k) times `monomials(degree + 1)`
    density : (c, m, m, k) twice the energy density of each pair, times `monomials(degree)`, without
        that of the cells' mean dilatation (see `fem.linear.assembly.split_lame`)
    """
    strain, density = _integrate(vertices, shape, radius, nu, profile, degree)
    return strain, _both_ways(density, FUNCTIONS)


def pair_moments(
    vertices: np.ndarray, shape: np.ndarray, radius: float, nu: float, profile: int,
    projection: np.ndarray,
):  # fmt: skip
    """Integrals over each cell of some strain components and of their products.

    `projection` (s, 6) has the components by the strains e_xx, e_yy, e_zz, e_xy, e_xz, e_yz.

    Returns
    -------
    strain : (c, m, s, 10) times lambda_a lambda_b
    pairs : (c, m, s, m, s, 4) products, times lambda_a
    """
    strain, pairs = _integrate(vertices, shape, radius, nu, profile, 1, projection)
    half = (FUNCTIONS, len(projection))
    pairs = _both_ways(pairs, FUNCTIONS * len(projection))
    return np.einsum("cmik,si->cmsk", strain, projection), pairs.reshape(-1, *half, *half, 4)


def _both_ways(pairs: np.ndarray, size: int) -> np.ndarray:
    """Products (c, size, size, k) of those with first >= second, (c, size (size + 1) / 2, k)."""
    result = np.empty((len(pairs), size, size, pairs.shape[2]))
    first, second = np.tril_indices(size)
    result[:, first, second] = result[:, second, first] = pairs
    return result


def _integrate(vertices, shape, radius, nu, profile, degree, projection=None):
    """Strain moments (c, m, 6, k) and those of products: energies, or of projected strains."""
    lam, mu, _ = split_lame(nu)
    size = FUNCTIONS * (1 if projection is None else len(projection))
    strain = np.zeros((len(vertices), len(monomials(degree + 1)), 6 * FUNCTIONS))
    products = np.zeros((len(vertices), size * (size + 1) // 2, len(monomials(degree))))
    projection = np.zeros((0, 6)) if projection is None else np.ascontiguousarray(projection)
    arguments = (strain, products, shape, radius, nu, profile, lam, mu, projection)
    tube, spread = _tube_radius(vertices, radius), _TUBE * radius
    quarter = math.ceil(_POINTS[0] * spread / (4 * tube))  # quarter turns change nothing
    tube_points = (4 * quarter, *_POINTS[1:])
    reach = _rim_reach(vertices, radius)
    volumes = np.abs(np.linalg.det(vertices[:, 1:] - vertices[:, :1])) / 6
    _integrate_cells(vertices, volumes, *TET_RULES[5], _LEAF, tube, *arguments)
    result = strain.reshape(*strain.shape[:2], FUNCTIONS, 6).transpose(0, 2, 3, 1), products
    if not shape.any() and not (reach < 2 * tube).any():
        return result
    points, weights = _tube_points(radius, tube, tube_points)
    points[:, 2] += height(shape, points[:, 0], points[:, 1])
    off = np.abs(points[:, 2]).max() if shape.any() else tube
    close = np.flatnonzero(reach < max(off, tube) + tube)
    owner, barycentric = _locate(points, vertices[close])
    order = np.argsort(owner, kind="stable")
    order = order[owner[order] >= 0]
    _integrate_points(points[order], weights[order], close[owner[order]], barycentric[order],
                      *arguments)  # fmt: skip
    return result


def _rim_reach(vertices: np.ndarray, radius: float) -> np.ndarray:
    """Lower bound of each cell's distance from the rim."""
    centre = vertices.mean(axis=1)
    reach = np.linalg.norm(vertices - centre[:, None], axis=2).max(axis=1)
    return np.hypot(np.hypot(centre[:, 0], centre[:, 1]) - radius, centre[:, 2]) - reach


def _tube_radius(vertices: np.ndarray, radius: float) -> float:
    """Radius of the polar quadrature around the rim."""
    close = vertices[_rim_reach(vertices, radius) < _TUBE * radius]
    if not len(close):
        return _TUBE * radius
    gradients = np.linalg.inv(close[:, 1:] - close[:, :1])  # columns of lambda_1..3
    steepest = np.linalg.norm(gradients, axis=1).max(axis=1)
    steepest = np.maximum(steepest, np.linalg.norm(gradients.sum(axis=2), axis=1))
    height = 1 / steepest.max()  # least distance of a corner from the face across
    return min(_TUBE * radius, max(_TUBE_CELLS * height, _THINNEST * radius))


_gauss = cache(np.polynomial.legendre.leggauss)


def _tube_points(
    radius: float, tube: float, counts: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    around, outwards, across = counts
    angle = 2 * np.pi * (np.arange(around) + 0.5) / around
    x, wx = _gauss(outwards)
    root = (x + 1) / 2  # of rho over the tube's radius: strains go with one over it at the rim
    rho, w_rho = tube * root**2, tube * root * wx
    y, wy = _gauss(across)
    phi, w_phi = np.pi * (y + 1) / 2, np.pi * wy / 2
    angle, rho, phi = np.meshgrid(angle, rho, phi, indexing="ij")
    r = radius + rho * np.cos(phi)
    w_rho = w_rho * [_bump(s) for s in root**2]
    weight = (2 * np.pi / around) * w_rho[None, :, None] * w_phi * r * rho
    points = np.stack([r * np.cos(angle), r * np.sin(angle), rho * np.sin(phi)], axis=-1)
    return points.reshape(-1, 3), weight.ravel()


def _locate(points: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell of each point (-1 where none holds it) and barycentric coordinates in it."""
    inverse = np.linalg.inv(vertices[:, 1:] - vertices[:, :1])  # x - x0 = l (v - v0)
    owner = np.full(len(points), -1)
    barycentric = np.zeros((len(points), 4))
    _search(points, vertices, inverse, owner, barycentric)
    return owner, barycentric


@numba.njit(cache=True, nogil=True)
def _search(points, vertices, inverse, owner, barycentric):
    place, last = np.empty(4), 0
    for p in range(len(points)):
        deepest = -1e-9
        for i in range(len(vertices)):
            c = (last + i) % len(vertices)  # most points lie in the cell of the one before
            place[0] = 1.0
            for a in range(3):
                place[a + 1] = 0.0
                for b in range(3):
                    place[a + 1] += (points[p, b] - vertices[c, 0, b]) * inverse[c, b, a]
                place[0] -= place[a + 1]
            smallest = min(place[0], place[1], place[2], place[3])
            if smallest > deepest:
                deepest, owner[p] = smallest, c
                for a in range(4):
                    barycentric[p, a] = place[a]
                if deepest > 0:
                    last = c
                    break


@numba.njit(cache=True, error_model="numpy")
def _bump(s):
    """One at the rim, zero from s = 1 on, twice differentiable."""
    t = min(max(s, 0.0), 1.0)
    return 1 - t**3 * (10 - 15 * t + 6 * t**2)


@numba.njit(cache=True, nogil=True)
def _integrate_points(points, weights, owner, barycentric, strain, products, shape, radius, nu,
                      profile, lam, mu, projection):  # fmt: skip
    """Add points that are sorted by their cells."""
    batch = batch_of_points(products.shape[1], products.shape[2], strain.shape[1])
    count = np.int64(0)  # no literal 0, for which all kernels would be compiled a second time
    for p in range(len(points)):
        put_point(batch, count, points[p], weights[p], barycentric[p])
        count += 1
        if count == BATCH or p + 1 == len(points) or owner[p + 1] != owner[p]:
            add_batch(batch, count, strain[owner[p]], products[owner[p]], shape, radius, nu,
                      profile, lam, mu, projection)  # fmt: skip
            count = 0


# Neither array expressions, which would allocate, nor numpy.linalg: each costs seconds when one of
# these is compiled
@numba.njit(cache=True, nogil=True, fastmath=True)
def _integrate_cells(vertices, volumes, rule_points, rule_weights, leaf, tube, strain, products,
                     shape, radius, nu, profile, lam, mu, projection):  # fmt: skip
    """Add cells by a rule in pieces that grow with their distance from the rim."""
    batch = batch_of_points(products.shape[1], products.shape[2], strain.shape[1])
    count = np.int64(0)
    stack = np.empty((256, 4, 4))  # barycentric coordinates of the pieces' corners
    volume = np.empty(256)
    piece, barycentric, position, centre = np.empty((4, 4)), np.empty(4), np.empty(3), np.empty(3)
    for c in range(len(vertices)):
        v = vertices[c]
        for a in range(4):
            for b in range(4):
                stack[0, a, b] = 1.0 if a == b else 0.0
        volume[0] = volumes[c]
        top = 1
        while top > 0:
            top -= 1
            size = volume[top]
            width = _take_piece(stack[top], v, piece, centre)
            if width > leaf * max(_rim_distance(centre, shape, radius), tube):
                top = _divide(piece, size, stack, volume, top)
                continue
            for q in range(len(rule_weights)):
                _point_of(rule_points[q], piece, v, barycentric, position)
                w = 1 - _bump(_rim_distance(position, shape, radius) / tube)
                if w > 0:
                    put_point(batch, count, position, w * size * rule_weights[q], barycentric)
                    count += 1
                if count == BATCH:
                    add_batch(batch, count, strain[c], products[c], shape, radius, nu, profile,
                              lam, mu, projection)  # fmt: skip
                    count = 0
        if count > 0:
            add_batch(batch, count, strain[c], products[c], shape, radius, nu, profile, lam, mu,
                      projection)  # fmt: skip
            count = 0


@numba.njit(cache=True, nogil=True, fastmath=True)
def _take_piece(corners, vertices, piece, centre):
    """Copy a piece's corners (4, 4), find its centre (3,); return its width."""
    for a in range(4):
        for b in range(4):
            piece[a, b] = corners[a, b]
    for i in range(3):
        centre[i] = 0.0
        for a in range(4):
            for b in range(4):
                centre[i] += piece[a, b] * vertices[b, i] / 4
    reach = 0.0
    for a in range(4):
        square = 0.0
        for i in range(3):
            place = 0.0
            for b in range(4):
                place += piece[a, b] * vertices[b, i]
            square += (place - centre[i]) ** 2
        reach = max(reach, square)
    return 2 * np.sqrt(reach)


@numba.njit(cache=True, nogil=True, fastmath=True)
def _divide(piece, size, stack, volume, top):
    """Put the eight parts of a piece on the stack; return the new top."""
    for k in range(8):
        for a in range(4):
            m = _CHILDREN[k, a]
            for b in range(4):
                if m < 4:
                    stack[top, a, b] = piece[m, b]
                else:
                    stack[top, a, b] = (piece[_EDGES[m - 4, 0], b] + piece[_EDGES[m - 4, 1], b]) / 2
        volume[top] = size / 8
        top += 1
    return top


@numba.njit(cache=True, nogil=True, fastmath=True)
def _point_of(rule_point, piece, vertices, barycentric, position):
    """Find a rule's point of a piece: coordinates in the cell (4,) and place (3,)."""
    for a in range(4):
        barycentric[a] = 0.0
        for b in range(4):
            barycentric[a] += rule_point[b] * piece[b, a]
    for i in range(3):
        position[i] = 0.0
        for b in range(4):
            position[i] += barycentric[b] * vertices[b, i]


@numba.njit(cache=True, error_model="numpy")
def _rim_distance(p, shape, radius):
    """Return the distance of a point from the rim, as it lies on the surface under the tip."""
    out = np.sqrt(p[0] * p[0] + p[1] * p[1]) - radius
    depth = p[2] - height(shape, p[0], p[1])
    return np.sqrt(out * out + depth * depth)
