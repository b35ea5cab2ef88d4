r"""Fibres in the body: transverse isotropy beside the isotropic modulus.

Fibres of unit direction a add to the energy density

    E_f(x)/2 (a.eps.a)^2,        so that    K = sum_p E_p K_p + sum_p E_fp K_p(a),

(the reinforcing term of a transversely isotropic solid; under tension along a they carry E_f times
the strain, across it nothing). With T(a) on the strains (e_11, e_22, 2 e_12) of a plane that holds
a = t_1 cos p + t_2 sin p, a.eps.a = T.e with T = (cos^2 p, sin^2 p, sin p cos p), and

    dC_j/dE_f = -int (T.e)^2 = -fibre_weights(p) . int (e_1 e_1, e_2 e_2, e_3 e_3, e_1 e_2, ...)

for every direction from six integrals, at E_f = 0 as well as elsewhere. The near field of a press
(`fem.near_field.enrichment`) stays that of isotropic material: it is exact for weak fibres, and
less apt the more E_f exceeds E.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np

from fem.contact.contacts import Contacts, PressedSurface
from fem.errors import MeshError
from fem.linear.assembly import Stiffness
from fem.near_field.cells import AXES
from fem.near_field.enrichment import (
    Neighbourhood,
    cell_integrals,
    linear_derivatives,
    neighbourhood,
    nodal_fields,
    over_all,
    sample_basis,
    square,
)
from fem.near_field.moments import pair_moments
from fem.near_field.sums import CellIntegrals, pairs

#: The pairs of (e_11, e_22, 2 e_12) whose products `Response.fibre_moments` integrates.
PAIRS = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
#: The plane z = 0: its two directions as rows.
HORIZONTAL = np.eye(3)[:2]


class Fibres(NamedTuple):
    """Fibres throughout a body.

    Attributes
    ----------
    direction : (3,) unit vector a
    modulus_pa : (p,) E_f at the modulus samples, Pa, or one number
    """

    direction: np.ndarray
    modulus_pa: np.ndarray | float


def checked_fibres(fibres: Fibres | tuple, samples: int) -> Fibres:
    """Return fibres with arrays (3,) and (p,); raise `MeshError` if they are not that."""
    direction = np.array(fibres[0], float)
    if direction.shape != (3,) or not np.isclose(np.linalg.norm(direction), 1, atol=1e-6):
        raise MeshError(f"a fibre's direction must be a unit vector (3,), got {fibres[0]}")
    modulus = np.broadcast_to(np.array(fibres[1], float), samples)
    if not np.isfinite(modulus).all():
        raise MeshError("the modulus of the fibres must be finite everywhere")
    return Fibres(direction, modulus)


def fibre_weights(angle: float) -> np.ndarray:
    """Weights (6,) of `PAIRS` in (a.eps.a)^2 for a = t_1 cos(angle) + t_2 sin(angle)."""
    return _weights(np.array([np.cos(angle), np.sin(angle)]))


def in_plane_projection(in_plane: np.ndarray) -> np.ndarray:
    """T (3,) of a direction given by its two components in the plane."""
    return np.array([in_plane[0] ** 2, in_plane[1] ** 2, in_plane[0] * in_plane[1]])


def _weights(in_plane: np.ndarray) -> np.ndarray:
    projection = in_plane_projection(in_plane)
    i, j = PAIRS.T
    return np.where(i == j, 1, 2) * projection[i] * projection[j]


def plane_of(direction: np.ndarray) -> np.ndarray:
    """Plane (2, 3) for fibres of a direction: the horizontal one if it holds it, else any."""
    if abs(direction[2]) < 1e-12:
        return HORIZONTAL
    helper = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    return np.array([direction, helper / np.linalg.norm(helper)])


class PlaneParts(NamedTuple):
    """In-plane strains e (3) of near-field functions, split over the modulus samples.

    Cells that lie alike under their tips share a row (`fem.near_field.reuse`).

    Attributes
    ----------
    cells, rows : for each press (c,), its cells, and their rows in the arrays
    mixed : (n, m, 3, q, 4) integrals of each with a cell's lambda_b
    products : (n, m, 3, m, 3, q) integrals of their products
    """

    cells: list[np.ndarray]
    rows: list[np.ndarray]
    mixed: np.ndarray
    products: np.ndarray


class FibrePlane:
    """Effect of fibres on a body, for all directions in one plane.

    Parameters
    ----------
    plane : (2, 3) orthonormal t_1, t_2
    near_field : true if the presses have one
    """

    def __init__(
        self, stiffness: Stiffness, contacts: Contacts, plane: np.ndarray, near_field: bool
    ) -> None:
        plane = np.array(plane, float)
        if plane.shape != (2, 3) or not np.allclose(plane @ plane.T, np.eye(2), atol=1e-6):
            raise MeshError("a plane of fibres is given by two orthonormal vectors, (2, 3)")
        self.stiffness, self.plane = stiffness, plane
        self._derivatives = linear_derivatives(stiffness.mesh.order)
        self._samples = stiffness.rule[0]
        self._gradients = stiffness.gradients @ plane.T  # (e, 4, 2)
        self.parts: PlaneParts | None = None
        if near_field:
            self.parts = _plane_parts(stiffness, contacts, plane)

    @cached_property
    def near_products(self) -> np.ndarray:
        """Integrals (n, m, m, q, 9) of products of two functions' strains: `PlaneParts.products`.

        In the order in which sums over pairs of functions read them.
        """
        parts = self.parts
        assert parts is not None
        by_function = parts.products.transpose(0, 1, 3, 5, 2, 4)
        return np.ascontiguousarray(by_function.reshape(*by_function.shape[:4], 9))

    def holds(self, direction: np.ndarray) -> bool:
        """Return True if a direction lies in the plane."""
        return bool(np.linalg.norm(self.plane @ direction) > 1 - 1e-12)

    def weights(self, direction: np.ndarray) -> np.ndarray:
        """Weights (6,) of `PAIRS` in (a.eps.a)^2."""
        return _weights(self.plane @ direction)

    def products(self, nodal: np.ndarray, amplitude: np.ndarray, j: int) -> np.ndarray:
        """Integrals of the strains' `PAIRS` for press j by modulus sample, (p, 6).

        Parameters
        ----------
        nodal : (n, 3) finite element part of the field
        amplitude : (m,) of the near-field functions
        """
        stiffness = self.stiffness
        weights = stiffness.volumes[:, None] * stiffness.rule[1]
        result = np.empty((*weights.shape, len(PAIRS)))
        strain = np.empty((len(weights), 3, 4))
        _strain_products(result, strain, nodal @ self.plane.T, stiffness.mesh.cells,
                         self._derivatives, self._gradients, self._samples, weights)  # fmt: skip
        parts = self.parts
        if parts is not None:
            _add_near_products(result, strain, parts.cells[j], parts.rows[j], amplitude,
                               parts.mixed, parts.products)  # fmt: skip
        return result.reshape(-1, len(PAIRS))

    def near(self, direction: np.ndarray) -> CellIntegrals:
        """Return the parts of k and a by fibres of modulus 1 at each sample."""
        parts = self.parts
        assert parts is not None
        projection = in_plane_projection(self.plane @ direction)
        energy = np.einsum("s,t,nmsltq->nmlq", projection, projection, parts.products,
                           optimize=True)  # fmt: skip
        along = np.prod(direction[AXES], axis=1)
        stress = np.einsum("s,nmsqb,a->nmqba", projection, parts.mixed, along, optimize=True)
        kinds, count, samples = stress.shape[:3]
        integrals = stress.reshape(kinds, count, 4 * samples, 6), pairs(energy)
        terms = np.eye(samples), np.arange(4 * samples).reshape(samples, 4)
        gradients = self.stiffness.gradients
        return cell_integrals(parts.cells, parts.rows, integrals, terms, gradients)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _strain_products(out, strain, u, cells, derivatives, gradients, samples, weights):
    """Products out (e, q, 6) of in-plane strains times the weights (e, q); strains (e, 3, 4).

    The strains are those at the vertices of each cell, between which they are linear; u (n, 2) is
    the in-plane displacement, `derivatives` (nodes, 4, 4) of `linear_derivatives`, `gradients`
    (e, 4, 2) in-plane, of the barycentric coordinates, `samples` (q, 4) barycentric.
    """
    for e in numba.prange(len(cells)):
        slope = np.zeros((2, 2, 4))
        at = np.empty(3)
        for v in range(4):
            for b in range(4):
                x = y = 0.0
                for i in range(cells.shape[1]):
                    x += derivatives[i, v, b] * u[cells[e, i], 0]
                    y += derivatives[i, v, b] * u[cells[e, i], 1]
                for d in range(2):
                    slope[0, d, b] += x * gradients[e, v, d]
                    slope[1, d, b] += y * gradients[e, v, d]
        for b in range(4):
            strain[e, 0, b], strain[e, 1, b] = slope[0, 0, b], slope[1, 1, b]
            strain[e, 2, b] = slope[0, 1, b] + slope[1, 0, b]
        for q in range(len(samples)):
            for s in range(3):
                at[s] = 0.0
                for b in range(4):
                    at[s] += strain[e, s, b] * samples[q, b]
            for pair in range(len(PAIRS)):
                out[e, q, pair] = weights[e, q] * at[PAIRS[pair, 0]] * at[PAIRS[pair, 1]]


@numba.njit(cache=True, fastmath=True, parallel=True)
def _add_near_products(out, strain, cells, rows, amplitude, mixed, products):
    """Add the near field's part of `_strain_products`; see `PlaneParts`."""
    count = len(amplitude)
    for k in numba.prange(len(cells)):
        along = np.empty((3, 4))
        for q in range(out.shape[1]):
            for s in range(3):
                for b in range(4):
                    along[s, b] = 0.0
                    for m in range(count):
                        along[s, b] += amplitude[m] * mixed[rows[k], m, s, q, b]
            for pair in range(len(PAIRS)):
                s, t = PAIRS[pair]
                value = 0.0
                for b in range(4):
                    value += along[s, b] * strain[cells[k], t, b]
                    value += along[t, b] * strain[cells[k], s, b]
                for m in range(count):
                    for n in range(count):
                        value += amplitude[m] * amplitude[n] * products[rows[k], m, s, n, t, q]
                out[cells[k], q, pair] += value


def _plane_parts(stiffness: Stiffness, contacts: Contacts, plane: np.ndarray) -> PlaneParts:
    surface = PressedSurface(stiffness.mesh)
    presses = range(len(contacts))
    places = [neighbourhood(stiffness, surface, contacts, j) for j in presses]

    def of_press(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
        return _plane_part(stiffness, contacts.profile_code, places[j], which, plane)

    cells = [place.cells for place in places]
    found = over_all(places, stiffness.mesh, cells, of_press)
    return PlaneParts(cells, found.rows, *found.arrays)


def _plane_part(
    stiffness: Stiffness, profile: int, place: Neighbourhood, which: np.ndarray, plane: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return `mixed` and `products` of `PlaneParts` for some of a press's cells."""
    mesh, nu = stiffness.mesh, stiffness.poisson_ratio
    frame, local, cells, shape, radius = place
    cells = cells[which]
    inside = plane @ frame.T
    projection = _strain_projection(inside)
    vertices = local[mesh.cells[cells, :4]]
    strain, pairs = pair_moments(vertices, shape, radius, nu, profile, projection)
    basis, derivatives = sample_basis(stiffness), linear_derivatives(mesh.order)
    field = nodal_fields(local, mesh.cells[cells], shape, radius, nu, profile) @ inside.T
    gradients = stiffness.gradients[cells] @ plane.T
    slope = np.einsum("ivb,mcia,cvd->mcadb", derivatives, field, gradients, optimize=True)
    linear = np.stack(
        [slope[:, :, 0, 0], slope[:, :, 1, 1], slope[:, :, 0, 1] + slope[:, :, 1, 0]], axis=1
    )  # (m, s, c, b) of the interpolant
    points, weight = stiffness.rule
    at_points = np.einsum("mscb,qb->mscq", linear, points)
    volumes = stiffness.volumes[cells, None] * weight
    exact = np.einsum("qa,cmsab->mscqb", basis, square(strain))
    own = volumes[:, :, None] * at_points[..., None] * points
    cross = np.einsum("mscqb,ltcb->msltcq", exact, linear, optimize=True)
    products = np.einsum("qa,cmslta->msltcq", basis, pairs, optimize=True)
    products -= cross + cross.transpose(2, 3, 0, 1, 4, 5)
    products += np.einsum("cq,mscq,ltcq->msltcq", volumes, at_points, at_points, optimize=True)
    mixed, products = np.moveaxis(exact - own, 2, 0), np.moveaxis(products, 4, 0)
    return np.ascontiguousarray(mixed), np.ascontiguousarray(products)


def _strain_projection(plane: np.ndarray) -> np.ndarray:
    """Matrix (3, 6) from e_xx, e_yy, e_zz, e_xy, e_xz, e_yz to e_11, e_22, 2 e_12 of a plane."""

    def row(s: np.ndarray, t: np.ndarray) -> list[float]:
        mixed = [s[a] * t[b] + s[b] * t[a] for a, b in ((0, 1), (0, 2), (1, 2))]
        return [*(s * t), *mixed]

    first, second = plane
    return np.array([row(first, first), row(second, second), 2 * np.array(row(first, second))])
