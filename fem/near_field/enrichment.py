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
from fem.linear.modulus_samples import CLOSE_BASIS, CLOSE_RULE, PRODUCTS, by_sample
from fem.linear.quadrature import monomials
from fem.mesh.mesh import TET_EDGES, Mesh
from fem.near_field.cells import SampleWeights, contributions
from fem.near_field.moments import moments
from fem.near_field.points import functions
from fem.near_field.reuse import Shared, shared
from fem.near_field.sums import CellIntegrals

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

    def of_far(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
        own, energy, dilatation = _integrals(stiffness, places[j], far[j][which], profile, 1)
        if stiffness.mean_lame > 0:
            mean = _mean_parts(stiffness, far[j][which], dilatation)
            own, energy = own + mean[0], energy + mean[1]
        return _stored(own, energy)

    def of_near(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
        own, energy, dilatation = _integrals(stiffness, places[j], near[j][which], profile, 2)
        if stiffness.mean_lame == 0:
            return _stored(own, energy)
        # The mean change of volume has the modulus of the cells' ordinary samples
        mean = _mean_parts(stiffness, near[j][which], dilatation)
        return *_stored(own, energy), *_stored(*mean)

    before = (None, None) if known is None else known.computed
    away = over_all(places, stiffness.mesh, far, of_far, before[0])
    ordinary = [cell_integrals(far, away.rows, away.arrays)]
    found = over_all(places, stiffness.mesh, near, of_near, before[1])
    at_close = cell_integrals(near, found.rows, found.arrays[:2])
    if stiffness.mean_lame > 0:
        ordinary.append(cell_integrals(near, found.rows, found.arrays[2:]))
    at_close = at_close._replace(table=np.searchsorted(close, at_close.cells))
    load = [_load(surface, contacts, j, places[j], nu, weights[j]) for j in range(len(places))]
    return Enrichment(np.array(load), tuple(ordinary), at_close, (away, found))


def cell_integrals(
    cells: Sequence[np.ndarray], rows: Sequence[np.ndarray], arrays: tuple[np.ndarray, ...]
) -> CellIntegrals:
    """Return integrals with the table of modulus samples by cell, from cells and rows by press."""
    begin = np.cumsum([0, *map(len, cells)])
    numbers, (coupling, energy) = np.concatenate(cells), arrays
    coupling = coupling.astype(np.float32, copy=False)  # of no cells, too: one kernel is compiled
    return CellIntegrals(begin, numbers, numbers, np.concatenate(rows), coupling, energy)


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


def _stored(coupling: np.ndarray, energy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Single precision where it counts: half the memory, an error of 1e-7."""
    return np.ascontiguousarray(coupling, np.float32), np.ascontiguousarray(energy)


def _integrals(stiffness: Stiffness, place: Neighbourhood, cells, profile: int, degree: int):
    """Contributions of the functions in some cells, by sample of a modulus of that degree.

    Returns
    -------
    coupling : (c, m, q, nodes, 3)
    energy : (c, m, m, q)
    dilatation : (c, m) mean change of each cell's volume
    """
    nu, mesh = stiffness.poisson_ratio, stiffness.mesh
    field = nodal_fields(place.local, mesh.cells[cells], place.shape, place.radius, nu, profile)
    field = np.ascontiguousarray((field @ place.frame).swapaxes(0, 1))  # (c, m, nodes, 3)
    volumes = stiffness.volumes[cells]
    vertices = place.local[mesh.cells[cells, :4]]
    strain, density = moments(vertices, place.shape, place.radius, nu, profile, degree)
    coupling, energy = contributions(
        field, stiffness.gradients[cells], volumes, strain, density,
        _sample_weights(stiffness, degree), split_lame(nu)[:2], place.frame,
    )  # fmt: skip
    counts = (monomials(degree + 1)[:, :, None] == np.arange(4)).sum(axis=1)
    often = factorial(degree + 1) / factorial(counts).prod(axis=1)  # in (sum lambda)^(degree + 1)
    dilatation = strain[:, :, :3].sum(axis=2) @ often / volumes[:, None]
    flat = 3 * field.shape[2]
    mean = stiffness.mean_gradients[cells].reshape(len(cells), flat, 1)
    return coupling, energy, dilatation - (field.reshape(*field.shape[:2], flat) @ mean)[..., 0]


def _sample_weights(stiffness: Stiffness, degree: int) -> SampleWeights:
    """Weights of the samples of a modulus of that degree."""
    points, weights = stiffness.rule if degree == 1 else CLOSE_RULE
    basis = sample_basis(stiffness) if degree == 1 else CLOSE_BASIS
    raised = _raised(degree)[:, :, None] == np.arange(len(monomials(degree + 1)))  # (a, 4, k)
    inner = np.einsum("p,pb,pd->bdp", weights, points, points)
    inner = np.moveaxis(inner if degree == 1 else by_sample(inner), 2, 0)
    exact = np.tensordot(basis, raised, 1)
    return SampleWeights(
        linear_derivatives(stiffness.mesh.order), basis, exact, np.ascontiguousarray(inner)
    )


def _mean_parts(stiffness: Stiffness, cells, dilatation):
    """Coupling and energy of each cell's mean change of volume (c, m)."""
    share = stiffness.mean_lame * stiffness.volumes[cells, None] * stiffness.rule[1]
    gradients = stiffness.mean_gradients[cells]
    coupling = np.einsum("cq,cm,cia->cmqia", share, dilatation, gradients, optimize=True)
    return coupling, np.einsum("cq,cm,cl->cmlq", share, dilatation, dilatation, optimize=True)


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
