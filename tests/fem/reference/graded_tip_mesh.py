r"""Compliance of a body's surface from place to place under a tip: S(x, y), m/N.

The normal displacement at x under a unit normal force at y is

    S(x, y) = H(x - y)/E_xy + c H_0 E'_xy/E_xy^2 ln |x - y| + D(x, y),

H the half-space's answer for E = 1, H_0 = (1 - nu^2)/pi, E_xy and E'_xy the means at x and y of the
modulus on the surface and of its slope with depth, and D what supports, sides and the rest of the
map add. (The logarithm: a pressure of wave number q sinks in less by c E'/(E q), c the mean depth
of its strain energy, c = (2 - nu)/(2 (1 - nu)); a slope along the surface does nothing as long as
E is taken half-way.) D is smooth and comes from finite elements: on one mesh, with unit forces on
the surface nodes i near the tip,

    D_ij = G_ij - (G1_ij - W_ij)/E_ij - c H_0 E'_ij/E_ij^2 ln |x_i - x_j|,

G the body's answer, G1 that of the same mesh with E = 1, and W the (smooth) difference of the
homogeneous body from the half-space: zero force inside, on the sides the opposite of Boussinesq's
tractions, on the support the opposite of his displacements. The meshes' error under the point
force, which is large, stands in G and in G1/E alike and cancels. A polynomial in x and y smooths D;
pairs of nodes closer than a cell, where a mesh has no logarithm, are left out of its fit.

Measured: bonded layers within 0.3 % of Hayes up to a tip as wide as the layer is thick. Over a map
that changes by a tenth per millimetre the mesh still counts: compliances are 2-3 % too small with
cells of 2.9 mm at the tip, 2 % with 1.9 mm, about alike for all tips.

This serves to check contact laws: no part of it is shared with `fem.near_field.enrichment`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from fem.contact.contacts import contact_frame
from fem.contact.half_space import half_space_matrix
from fem.errors import MeshError
from fem.linear.assembly import Stiffness, shape_functions
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.solve.direct import Pattern, Solver, default_solver

_DEGREE = 8  # of the polynomial in x and y each
_FEWEST = 2 * (_DEGREE + 1) * (_DEGREE + 2)  # surface nodes, four a polynomial
_APART = 2.5  # spacings between nodes whose answers a mesh resolves
_FILLS = 60
_STEP = 1e-4  # of the reach, for the slope of the modulus with depth
_SQUARE = np.exp(np.pi / 4 - 1.5 - np.log(2) / 2)  # side -> geometric mean of distances from centre
_PLANE = 1e-6  # of the reach, that a surface may be off its plane
_TRIANGLE = np.array([(4, 1, 1), (1, 4, 1), (1, 1, 4)]) / 6  # exact for quadratics


@dataclass(frozen=True)
class TipSurface:
    """The surface around one contact point, ready for any tip.

    Attributes
    ----------
    poisson_ratio : of the body
    reach_m : half the width of the square in which D is known
    modulus : maps (i, 2) m on the surface, in the tip's frame, to Young's modulus and its slope
        with depth, (i,) Pa and (i,) Pa/m
    smooth : (k, k) coefficients of D in the polynomials of `_terms`, m/N
    misfit : rms of D at the nodes less its polynomial, over the mean of H/E on the same nodes
    """

    poisson_ratio: float
    reach_m: float
    modulus: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    smooth: np.ndarray
    misfit: float

    def matrix(self, centres: np.ndarray, side: float) -> np.ndarray:
        """Displacement of each patch under a unit force on each (see `unilateral`), (i, i) m/N."""
        if np.abs(centres).max() > 1.1 * self.reach_m:
            raise MeshError(f"patches lie beyond the reach of {self.reach_m:.3g} m")
        terms = _terms(centres / self.reach_m)
        near = half_space_matrix(centres, side, self.poisson_ratio)
        modulus, slope = self.modulus(centres)
        log = _logarithm(centres, side * _SQUARE)
        near = near / _pairs(modulus) + log * _log_factor(modulus, slope, self.poisson_ratio)
        return near + terms @ self.smooth @ terms.T


def tip_surface(
    mesh: Mesh,
    poisson_ratio: float,
    modulus: Callable[[np.ndarray], np.ndarray],
    point_m: np.ndarray,
    direction: np.ndarray,
    reach_m: float,
    fixed_surface: str = "base",
    solver: Solver | None = None,
) -> TipSurface:
    """Compute the surface compliance around a contact point on a flat part of a body.

    Parameters
    ----------
    mesh : with some tens of surface nodes in the square of half width `reach_m` around the point
        (`graded_block` makes one)
    modulus : maps places (i, 3) m to Young's modulus (i,) Pa
    reach_m : wider than the contact

    Raises
    ------
    MeshError
        The surface is not flat within reach, or holds too few nodes.
    """
    point, frame = np.asarray(point_m, float), contact_frame(np.asarray(direction, float))
    nodes, places = _nodes_near(mesh, point, frame, reach_m)
    free = Stiffness(mesh, poisson_ratio, fixed_surface)
    pattern = (solver or default_solver()).analyse(free.indptr, free.indices)
    load = np.zeros((len(nodes), len(mesh.nodes), 3))
    load[np.arange(len(nodes)), nodes] = frame[2]
    load = free.restrict(load)
    answer = _solve(free, pattern, modulus(free.points_m), load)
    body = load.T @ answer
    answer = _solve(free, pattern, np.ones(len(free.points_m)), load)
    one = load.T @ answer
    # W by Betti's theorem from the answers themselves: two sums over the boundary, no more solves
    beyond = _beyond_half_space(mesh, poisson_ratio, frame, nodes, free, answer, fixed_surface)

    def across(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step, on = _STEP * reach_m, point + local @ frame[:2]
        below = [modulus(on + n * step * frame[2]) for n in range(3)]
        return below[0], (4 * below[1] - 3 * below[0] - below[2]) / (2 * step)

    on_surface, slope = across(places)
    smooth = body - (one - (beyond + beyond.T) / 2) / _pairs(on_surface)
    smooth -= _logarithm(places, 1.0) * _log_factor(on_surface, slope, poisson_ratio)
    spacing = np.sqrt((2 * reach_m) ** 2 / len(nodes))
    apart = np.linalg.norm(places[:, None] - places, axis=2) > _APART * spacing
    coefficients, rest = _fit((smooth + smooth.T) / 2, _terms(places / reach_m), apart)
    scale = (1 - poisson_ratio**2) / (np.pi * reach_m) / on_surface.mean()
    misfit = float(np.sqrt(np.mean(rest[apart] ** 2)) / scale)
    return TipSurface(poisson_ratio, reach_m, across, coefficients, misfit)


def graded_block(
    size_m: Sequence[float],
    centre_m: Sequence[float],
    reach_m: float,
    cells: tuple[int, int, int] = (12, 5, 8),
) -> Mesh:
    """Mesh a block with ten-node cells that are small and even around a point of its top.

    Parameters
    ----------
    centre_m : x and y of the point; the square of half width `reach_m` around it lies on the top
    cells : hexahedra (each cut in six) across that square, from there to each side, and over the
        height; they grow in geometric progression.
    """
    within, beside, layers = cells
    step = 2 * reach_m / within
    axes = []
    for axis in (0, 1):
        left = centre_m[axis] - reach_m
        right = size_m[axis] - centre_m[axis] - reach_m
        if min(left, right) <= 0:
            raise MeshError(f"the square of half width {reach_m:.3g} m around the point "
                            "reaches over the edge of the block")  # fmt: skip
        inner = left + step * np.arange(within + 1)
        outer = _growing(right, step, beside)
        axes.append(np.concatenate([
            left - _growing(left, step, beside)[::-1], inner, inner[-1] + outer
        ]))  # fmt: skip
    axes.append(size_m[2] - np.append(_growing(size_m[2], step, layers)[::-1], 0))
    divisions = [len(a) - 1 for a in axes]
    plain = block_mesh(size_m, divisions, order=1)
    place = np.rint(plain.nodes / size_m * divisions).astype(int)
    nodes = np.column_stack([a[place[:, i]] for i, a in enumerate(axes)])
    return promote_to_tet10(Mesh(nodes, plain.cells, plain.surfaces))


def _growing(length: float, first: float, count: int) -> np.ndarray:
    """Give the ends of `count` steps that fill a length; the first is given if there is room."""
    if count * first >= length:
        return length * np.arange(1, count + 1) / count
    powers = np.arange(count)
    # The sum of powers is convex and rises: Newton's steps from above end at its root
    ratio = length / first + 1
    for _ in range(200):
        excess = first * np.sum(ratio**powers) - length
        ratio -= excess / (first * np.sum(powers * ratio ** np.maximum(powers - 1, 0)))
    return first * np.cumsum(ratio**powers)


def _solve(free: Stiffness, pattern: Pattern, modulus: np.ndarray, load: np.ndarray) -> np.ndarray:
    return pattern.factorize(free.values(modulus)).solve(load)


def _pairs(modulus: np.ndarray) -> np.ndarray:
    return (modulus[:, None] + modulus) / 2


def _fit(smooth: np.ndarray, terms: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit terms X terms' to the known entries of a symmetric matrix; X and the rest."""
    inverse = np.linalg.pinv(terms)
    model = np.full(smooth.shape, smooth[known].mean())
    coefficients = np.zeros((terms.shape[1],) * 2)
    for _ in range(_FILLS):  # the unknown entries are few and follow the fit
        coefficients = inverse @ np.where(known, smooth, model) @ inverse.T
        model = terms @ coefficients @ terms.T
    return coefficients, smooth - model


def _logarithm(places: np.ndarray, own: float) -> np.ndarray:
    """Logarithm of |x_i - x_j|, with |x_i - x_i| replaced."""
    distance = np.linalg.norm(places[:, None] - places, axis=2)
    np.fill_diagonal(distance, own)
    return np.log(distance)


def _log_factor(modulus: np.ndarray, slope: np.ndarray, nu: float) -> np.ndarray:
    mean_depth = (2 - nu) / (2 * (1 - nu))
    return mean_depth * (1 - nu**2) / np.pi * _pairs(slope) / _pairs(modulus) ** 2


def _terms(places: np.ndarray) -> np.ndarray:
    """Products of Legendre polynomials up to a total degree, (i, k); places in units of reach."""
    x, y = (np.polynomial.legendre.legvander(places[:, a], _DEGREE) for a in (0, 1))
    pairs = [(a, b) for a, b in product(range(_DEGREE + 1), repeat=2) if a + b <= _DEGREE]
    return np.column_stack([x[:, a] * y[:, b] for a, b in pairs])


def _nodes_near(
    mesh: Mesh, point: np.ndarray, frame: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Surface nodes in the square around a point, and their places in the tip's frame."""
    surface = np.unique(mesh.boundary)
    local = (mesh.nodes[surface] - point) @ frame.T
    near = (np.abs(local[:, :2]).max(axis=1) < 1.001 * reach) & (np.abs(local[:, 2]) < reach / 2)
    if near.sum() < _FEWEST:
        raise MeshError(f"{near.sum()} surface nodes within {reach:.3g} m of the contact point; "
                        f"the surface compliance needs {_FEWEST}")  # fmt: skip
    off = np.abs(local[near, 2]).max()
    if off > _PLANE * reach:
        raise MeshError(f"the surface is {off:.3g} m off its plane within {reach:.3g} m of the "
                        "contact point; the surface compliance is for flat surfaces")  # fmt: skip
    return surface[near], local[near, :2]


def _beyond_half_space(mesh, nu, frame, nodes, free, answer, fixed_surface) -> np.ndarray:
    """W: displacement at node i of the homogeneous body (E = 1), less the half-space's, under j."""
    held = mesh.surface_nodes(fixed_surface)
    faces = mesh.boundary
    depth = (mesh.nodes[faces[:, :3]] - mesh.nodes[nodes[0]]) @ frame[2]
    # Neither the pressed plane, where Boussinesq has no tractions, nor the support
    bare = np.abs(depth).max(axis=1) > 1e-9 * np.ptp(depth)
    faces = faces[bare & ~np.isin(faces, held).all(axis=1)]
    corners = mesh.nodes[faces[:, :3]]
    where = np.einsum("qv,tvi->tqi", _TRIANGLE, corners).reshape(-1, 3)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6  # a point
    area = np.repeat(area, 3, axis=0) @ frame.T
    shape = shape_functions(_TRIANGLE, mesh.order)  # (q, nodes)
    tractions = np.zeros((len(nodes), len(mesh.nodes), 3))
    shift = np.empty((len(nodes), len(held), 3))
    for j, node in enumerate(nodes):  # in the tip's frame, whose axis 2 is the depth
        _, stress = _boussinesq((where - mesh.nodes[node]) @ frame.T, nu)
        force = np.einsum("pab,pb->pa", stress, area).reshape(len(faces), 3, 3) @ frame
        np.add.at(tractions[j], faces, np.einsum("qn,tqi->tni", shape, force))
        shift[j] = _boussinesq((mesh.nodes[held] - mesh.nodes[node]) @ frame.T, nu)[0] @ frame
    reaction = _reactions(mesh, nu, free.prolong(answer), held)
    return np.einsum("ihs,jhs->ij", reaction, shift) - answer.T @ free.restrict(tractions)


def _reactions(mesh: Mesh, nu: float, fields: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return the forces of the support on the body at its nodes, E = 1, (i, held, 3)."""
    touching = mesh.cells[np.isin(mesh.cells, held).any(axis=1)]
    used, cells = np.unique(touching, return_inverse=True)
    layer = Mesh(mesh.nodes[used], cells.reshape(touching.shape), {"none": np.zeros((0, 3))})
    stiffness = Stiffness(layer, nu, "none")
    values = stiffness.values(np.ones(len(stiffness.points_m)))
    force = stiffness.product(values, fields[:, used].reshape(len(fields), -1).T)
    return force.T.reshape(len(fields), -1, 3)[:, np.searchsorted(used, held)]


def _boussinesq(x: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (p, 3) and stress (p, 3, 3) under a unit force along axis 2, for E = 1.

    Johnson, Contact Mechanics, eqs. 3.18 and 3.19; x (p, 3) from the force, x[:, 2] >= 0.
    """
    rho, z = np.linalg.norm(x, axis=1), x[:, 2]
    flat = x[:, :2]
    c = 1 - 2 * nu
    outwards = z / rho**3 - c / (rho * (rho + z))
    shift = np.column_stack([outwards[:, None] * flat, z**2 / rho**3 + 2 * (1 - nu) / rho])
    shift *= (1 + nu) / (2 * np.pi)
    stress = -3 * (z / rho**5)[:, None, None] * x[:, :, None] * x[:, None, :]
    # the part of the plane stresses that vanishes for nu = 0.5
    both = 1 / (rho * (rho + z))
    mixed = (2 * rho + z) * both**2 / rho
    plane = c * (z / rho**3 - both)
    stress[:, 0, 0] += plane + c * mixed * flat[:, 0] ** 2
    stress[:, 1, 1] += plane + c * mixed * flat[:, 1] ** 2
    stress[:, 0, 1] += c * mixed * flat[:, 0] * flat[:, 1]
    stress[:, 1, 0] += c * mixed * flat[:, 0] * flat[:, 1]
    return shift, stress / (2 * np.pi)
