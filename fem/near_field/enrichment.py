"""Near field of a press: exact singular functions join the finite element space.

Under the rim of a tip the pressure and the strain are singular, so that any affordable mesh is
10-50 % too stiff and refinement helps only like h. The singular part is known, though: it is the
field v of the same pressure on a half-space (`fem.contact.half_space`), whatever the map of the
modulus, the supports and the shape of the rest do. So each press j gets the functions

    phi_m = f_m v_j - I_h (f_m v_j)      in the cells around the tip, 0 elsewhere,

with f = 1, x, y, z from the contact point (a modulus that varies under the tip bends v linearly)
and I_h the interpolation at the nodes. The Galerkin solution in the enriched space is

    K u = B,   K z = k,   (a - k'z) alpha = l - k'u,   u* = u + (phi - z) alpha,
    C = B'u + (l - k'u)' alpha,
    k_im = int eps(N_i) : sigma(phi_m),  a_ml = int eps(phi_m) : sigma(phi_l),
    l_m = int p phi_m . d dA.

The compliance remains a lower bound that rises with each added function; k and a are sums over the
same modulus samples as K, so that dC/dE follows from the enriched field's energies alone. (Stable
generalised finite elements: Babuska & Banerjee, Comput. Methods Appl. Mech. Eng. 201, 2012.)

On a curved or tilted surface x, y are the foot of the normal to a paraboloid that follows it (see
`fem.contact.paraboloid`), z is the depth below, and v is turned with the surface; a flat tip that
pulls the bent surface outwards has the field of that traction in v
(`fem.contact.half_space.outward`). Strains and loads are those of the field so bent: the space
stays a space of admissible fields, only less apt the more the surface bends under the tip. On domes
of 40 mm, cells of 5 mm, nu = 0.45 a flat tip of 3 or 5 mm is 0.4 % too stiff, a ball's contact of 1
to 3 mm 0.1 % (`benchmarks/curved.py`); the error lies at the rim, which the facets miss by the
paraboloid's lift.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import factorial

from fem.contact.contacts import Contacts, PressedSurface, contact_frame, disc_quadrature
from fem.contact.paraboloid import contact_shape
from fem.linear.assembly import Stiffness, split_lame
from fem.linear.modulus_samples import CLOSE_BASIS, CLOSE_RULE, PRODUCTS
from fem.linear.quadrature import monomials
from fem.mesh.mesh import TET_EDGES, Mesh
from fem.near_field.cells import Terms, contributions
from fem.near_field.moments import moments
from fem.near_field.points import functions
from fem.near_field.reuse import Shared, shared
from fem.near_field.sums import CellIntegrals, pairs

_REACH_RADII = 2.0  # cells are enriched whose centre lies within this many radii of the disc ...
_REACH_CELLS = 1.0  # ... plus this many cell diameters

_CLOSE_CELLS = 0.3  # cells have samples of their own whose distance from the disc is less than this
_PLACES = monomials(4)  # measured at these points of a cell
_PLACES = (_PLACES[:, :, None] == np.arange(4)).mean(axis=1)


class Enrichment(NamedTuple):
    """The enrichment of every press by m functions.

    Attributes
    ----------
    load : (j, m) l, the work of the unit load on the functions
    ordinary : integrals at the mesh's modulus samples, a table by cell: those over the cells that
        are not close to a tip, and where a cell's mean change of volume is resisted the part of
        that over the cells that are
    close : integrals over the cells close to this tip or another, at their `CLOSE_SAMPLES`
    computed : the same by cell, far from the tips and close to them, for other presses and meshes
    """

    load: np.ndarray
    ordinary: tuple[CellIntegrals, ...]
    close: CellIntegrals
    computed: tuple[Shared, Shared]


class Neighbourhood(NamedTuple):
    """Cells and frame of a press's near field.

    Attributes
    ----------
    frame : (3, 3) two tangents and the press direction
    local : (n, 3) m, the mesh's nodes in that frame, from the contact point
    cells : (c,) enriched cells
    shape : (7,) the surface's paraboloid, see `fem.contact.paraboloid`
    radius : m
    """

    frame: np.ndarray
    local: np.ndarray
    cells: np.ndarray
    shape: np.ndarray
    radius: float


def neighbourhood(
    stiffness: Stiffness, surface: PressedSurface, contacts: Contacts, j: int
) -> Neighbourhood:
    """Find the cells, the frame and the surface's shape around press j."""
    mesh = stiffness.mesh
    radius = float(contacts.radius_m[j])
    frame = contact_frame(contacts.directions[j])
    local = (mesh.nodes - contacts.points_m[j]) @ frame.T  # axis 2 is the depth
    distance = _from_disc((mesh.centres_m - contacts.points_m[j]) @ frame.T, radius)
    near = distance < _REACH_RADII * radius + _REACH_CELLS * mesh.diameters_m
    cells = np.flatnonzero(near)
    shape = contact_shape(surface, contacts.points_m[j], frame, radius)
    return Neighbourhood(frame, local, cells, shape, radius)


def close_cells(mesh: Mesh, places: Sequence[Neighbourhood]) -> np.ndarray:
    """Cells (c,), in order, that lie so close to a tip that its field varies in them.

    They have modulus samples of their own, see `fem.linear.modulus_samples`.
    """
    close = [place.cells[_lie_close(mesh, place)] for place in places]
    return np.unique(np.concatenate(close))


def enrich(
    stiffness: Stiffness,
    surface: PressedSurface,
    contacts: Contacts,
    weights: np.ndarray,
    places: Sequence[Neighbourhood],
    close: np.ndarray,
    known: Enrichment | None = None,
) -> Enrichment:
    """Integrate the enrichments of all presses.

    Parameters
    ----------
    surface : of the mesh
    weights : (j, n, 3) contact weights
    places : of the presses
    close : (c,) cells with modulus samples of their own
    known : of the same material and kind of tip on another mesh or under other presses
    """
    profile, nu = contacts.profile_code, stiffness.poisson_ratio
    near = [place.cells[np.isin(place.cells, close)] for place in places]
    far = [np.setdiff1d(place.cells, close, assume_unique=True) for place in places]

    terms = {degree: _terms(stiffness, degree) for degree in (1, 2)}
    shape = _shape_slopes(stiffness)

    def integrals(cells: Sequence[np.ndarray], degree: int, before: Shared | None) -> Shared:
        def of_press(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
            own = cells[j][which]
            stress, energy, dilatation = _integrals(
                stiffness, places[j], own, shape[own], profile, degree, terms[degree]
            )
            if stiffness.mean_lame == 0:
                return _stored(stress, energy)
            # The mean change of volume has the modulus of the cells' ordinary samples
            return *_stored(stress, energy), *_stored(*_mean_parts(stiffness, own, dilatation))

        return over_all(places, stiffness.mesh, cells, of_press, before)

    before = (None, None) if known is None else known.computed
    away, found = integrals(far, 1, before[0]), integrals(near, 2, before[1])

    gradients = stiffness.gradients
    by_sample, quadratic = ((t.basis, t.raised) for t in (terms[1], terms[2]))
    ordinary = [cell_integrals(far, away.rows, away.arrays[:2], by_sample, gradients)]
    at_close = cell_integrals(near, found.rows, found.arrays[:2], quadratic, gradients)
    at_close = at_close._replace(table=np.searchsorted(close, at_close.cells))
    if stiffness.mean_lame > 0:
        alike = stiffness.rule[1][:, None], np.zeros((1, 4), int)
        ordinary += [
            cell_integrals(cells, one.rows, one.arrays[2:], alike, gradients)
            for cells, one in ((far, away), (near, found))
        ]
    load = [_load(surface, contacts, j, places[j], nu, weights[j]) for j in range(len(places))]
    return Enrichment(np.array(load), tuple(ordinary), at_close, (away, found))


def cell_integrals(
    cells: Sequence[np.ndarray],
    rows: Sequence[np.ndarray],
    arrays: tuple[np.ndarray, ...],
    terms: tuple[np.ndarray, np.ndarray],
    gradients: np.ndarray,
) -> CellIntegrals:
    """Return integrals with the table of modulus samples by cell, from cells and rows by press.

    `arrays` are stress and energy, `terms` basis and raised; these and `gradients`, see
    `CellIntegrals`.
    """
    # Alike in all of them, as one kernel is compiled. Single precision: an error of 1e-7
    stress, energy = (np.ascontiguousarray(array, np.float32) for array in arrays)
    basis, raised = np.ascontiguousarray(terms[0], float), np.ascontiguousarray(terms[1], np.int32)
    begin, numbers = np.cumsum([0, *map(len, cells)]), np.concatenate(cells)
    return CellIntegrals(
        begin, numbers, numbers, np.concatenate(rows), stress, energy, basis, raised, gradients
    )


def over_all(
    places: Sequence[Neighbourhood],
    mesh: Mesh,
    cells: Sequence[np.ndarray],
    compute: Callable[[int, np.ndarray], tuple[np.ndarray, ...]],
    known: Shared | None = None,
) -> Shared:
    """Compute integrals over some cells of each press, see `fem.near_field.reuse.shared`."""
    local = [p.local[mesh.cells[own]] for p, own in zip(places, cells, strict=True)]
    alike = [b"".join([p.frame.tobytes(), p.shape.tobytes(), bytes(str(p.radius), "ascii")])
             for p in places]  # fmt: skip
    return shared(local, alike, np.array([place.radius for place in places]), compute, known)


def _stored(stress: np.ndarray, energy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Integrals as they are kept, see `CellIntegrals`."""
    return np.ascontiguousarray(stress, np.float32), pairs(energy).astype(np.float32)


def _integrals(
    stiffness: Stiffness, place: Neighbourhood, cells, shape, profile: int, degree: int,
    terms: Terms,
):  # fmt: skip
    """Contributions of the functions in some cells, by sample of a modulus of that degree.

    Returns
    -------
    stress : (c, m, k, 6), see `fem.near_field.cells`
    energy : (c, m, m, q)
    dilatation : (c, m) mean change of each cell's volume
    """
    nu, mesh = stiffness.poisson_ratio, stiffness.mesh
    field = nodal_fields(place.local, mesh.cells[cells], place.shape, place.radius, nu, profile)
    field = np.ascontiguousarray((field @ place.frame).swapaxes(0, 1))  # (c, m, nodes, 3)
    volumes = stiffness.volumes[cells]
    vertices = place.local[mesh.cells[cells, :4]]
    strain, density = moments(vertices, place.shape, place.radius, nu, profile, degree)
    stress, energy = contributions(
        field, shape, volumes, strain, density, terms, split_lame(nu)[:2], place.frame
    )  # fmt: skip
    counts = (monomials(degree + 1)[:, :, None] == np.arange(4)).sum(axis=1)
    often = factorial(degree + 1) / factorial(counts).prod(axis=1)  # in (sum lambda)^(degree + 1)
    dilatation = strain[:, :, :3].sum(axis=2) @ often / volumes[:, None]
    flat = 3 * field.shape[2]
    mean = stiffness.mean_gradients[cells].reshape(len(cells), flat, 1)
    return stress, energy, dilatation - (field.reshape(*field.shape[:2], flat) @ mean)[..., 0]


def _terms(stiffness: Stiffness, degree: int) -> Terms:
    """Terms of a modulus of that degree: its samples, or where it is quadratic its monomials."""
    raised, products = _raised(degree), monomials(degree + 1)
    if degree == 2:
        points, weights = CLOSE_RULE
        interpolant = np.einsum("p,pk,pb->kb", weights, points[:, products].prod(axis=2), points)
        return Terms(CLOSE_BASIS, raised, np.eye(len(products)), interpolant, np.eye(len(raised)))
    # The stiffness matrix's own quadrature does not integrate a stress of the interpolant exactly
    points, weights = stiffness.rule
    interpolant = np.einsum("q,qb,qd->qbd", weights, points, points).reshape(-1, 4)
    basis, samples = sample_basis(stiffness), len(weights)
    exact = np.tensordot(basis, raised[:, :, None] == np.arange(len(products)), 1)
    own = np.arange(4 * samples).reshape(samples, 4)
    return Terms(np.eye(samples), own, exact.reshape(len(interpolant), -1), interpolant, basis)


def _mean_parts(stiffness: Stiffness, cells, dilatation):
    """Stress (c, m, 1, 6) and energy of each cell's mean change of volume (c, m)."""
    stress = np.zeros((*dilatation.shape, 1, 6))
    whole = stiffness.mean_lame * stiffness.volumes[cells, None] * dilatation
    stress[..., 0, :3] = whole[..., None] / 4  # of each of the four lambda_b
    energy = whole[:, :, None, None] * dilatation[:, None, :, None] * stiffness.rule[1]
    return stress, energy


def _load(surface, contacts: Contacts, j: int, place: Neighbourhood, nu: float, weights):
    """Work (m,) of the unit load on the functions."""
    frame, local, _, shape, radius = place
    profile = contacts.profile_code
    disc, pressure = disc_quadrature(profile)
    disc = disc * radius
    depth = surface.under(contacts.points_m[j], frame, disc, radius).depth
    there = functions(np.column_stack([disc, depth]), shape, radius, nu, profile)
    touched = np.flatnonzero(weights.any(axis=1))
    nodal = nodal_fields(local, touched[:, None], shape, radius, nu, profile)[:, :, 0]
    load = np.einsum("p,pm->m", pressure, there[:, :, 2])
    return load - np.einsum("mns,ns->m", nodal, weights[touched] @ frame.T)


def sample_basis(stiffness: Stiffness) -> np.ndarray:
    """Matrix (q, 4) that gives each modulus sample's weight in E(x) = sum_q E_q (T lambda)_q."""
    points = stiffness.rule[0]
    return np.ones((1, 4)) if len(points) == 1 else np.linalg.inv(points).T


def _shape_slopes(stiffness: Stiffness) -> np.ndarray:
    """Gradients (e, 12, nodes) of the shape functions, by axis and lambda_b."""
    derivatives = linear_derivatives(stiffness.mesh.order)
    by_cell = stiffness.gradients.swapaxes(1, 2) @ derivatives.transpose(1, 2, 0).reshape(4, -1)
    return by_cell.reshape(len(by_cell), 12, len(derivatives))


def linear_derivatives(order: int) -> np.ndarray:
    """D of dN_i/dlambda_v = sum_b D_ivb lambda_b, (nodes, 4, 4)."""
    if order == 1:
        return np.repeat(np.eye(4)[:, :, None], 4, axis=2)
    d = np.zeros((10, 4, 4))
    for v in range(4):
        d[v, v] = -1
        d[v, v, v] = 3
    for m, (i, j) in enumerate(TET_EDGES):
        d[4 + m, i, j] = d[4 + m, j, i] = 4
    return d


def _raised(degree: int) -> np.ndarray:
    """Find `monomials(degree)` times lambda_b among `monomials(degree + 1)`, (k, 4)."""
    number = {tuple(term): k for k, term in enumerate(monomials(degree + 1).tolist())}
    return np.array(
        [[number[(*sorted([*term, b]),)] for b in range(4)] for term in monomials(degree).tolist()]
    )


def square(moments: np.ndarray) -> np.ndarray:
    """Moments times lambda_a lambda_b, (..., 10) -> (..., 4, 4)."""
    result = np.empty((*moments.shape[:-1], 4, 4))
    result[..., PRODUCTS[:, 0], PRODUCTS[:, 1]] = moments
    result[..., PRODUCTS[:, 1], PRODUCTS[:, 0]] = moments
    return result


def _lie_close(mesh: Mesh, place: Neighbourhood) -> np.ndarray:
    """Return True for a press's cells close enough to the disc for a varying field, (c,)."""
    points = _PLACES @ place.local[mesh.cells[place.cells, :4]]
    distance = _from_disc(points, place.radius).min(axis=1)
    return distance < _CLOSE_CELLS * mesh.diameters_m[place.cells]


def _from_disc(points: np.ndarray, radius: float) -> np.ndarray:
    """Distance of points (..., 3) from the tip's disc."""
    x, y, z = (points[..., i] for i in range(3))
    out = np.maximum(np.sqrt(x * x + y * y) - radius, 0)  # hypot takes eight times as long
    return np.sqrt(out * out + z * z)


def nodal_fields(local, cells, shape, radius: float, nu: float, profile: int) -> np.ndarray:
    """Values of the functions at the nodes of cells (c, nodes): (m, c, nodes, 3)."""
    used, inverse = np.unique(cells, return_inverse=True)
    values = functions(local[used], shape, radius, nu, profile)
    return values[inverse.reshape(cells.shape)].transpose(2, 0, 1, 3)
