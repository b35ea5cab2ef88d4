"""Near field of a press: exact singular functions join the finite element space.

Under the rim of a tip the pressure and the strain are singular, so that any affordable mesh is
10-50 % too stiff and refinement helps only like h. The singular part is known, though: it is the
field v of the same pressure on a half-space (`fem.half_space`), whatever the map of the modulus,
the supports and the shape of the rest do. So each press j gets the functions

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

On a curved or tilted surface z is the depth below a paraboloid that follows it (see
`fem.contact_shape`), strains and loads are those of the field so bent: the space stays a space of
admissible fields, only less apt the more the surface bends under the tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import factorial

from fem.assembly import Stiffness, split_lame
from fem.contact import Contacts, PressedSurface, contact_frame, disc_quadrature
from fem.contact_shape import contact_shape
from fem.mesh import TET_EDGES, Mesh
from fem.near_field_cells import exact, interpolant
from fem.near_field_moments import moments, monomials
from fem.near_field_points import functions

_REACH_RADII = 2.0  # cells are enriched whose centre lies within this many radii of the disc ...
_REACH_CELLS = 1.0  # ... plus this many cell diameters

# lambda_a lambda_b, a <= b: the ten products that span the quadratics of a cell
PRODUCTS = monomials(2)
_CLOSE_CELLS = 0.3  # cells have samples of their own whose distance from the disc is less than this
_PLACES = monomials(4)  # measured at these points of a cell
_PLACES = (_PLACES[:, :, None] == np.arange(4)).mean(axis=1)
# ... at places between which a quadratic modulus is fitted best: the ten nodes, drawn inwards
CLOSE_SAMPLES = 0.25 + 0.7 * ((PRODUCTS[:, :, None] == np.arange(4)).mean(axis=1) - 0.25)
CLOSE_BASIS = np.linalg.inv(CLOSE_SAMPLES[:, PRODUCTS].prod(axis=2)).T


class Close(NamedTuple):
    """Contributions like those of `Enrichment`, at the `CLOSE_SAMPLES` of each of some cells."""

    cells: np.ndarray
    coupling: np.ndarray
    energy: np.ndarray

    @staticmethod
    def points_m(mesh: Mesh, cells: np.ndarray) -> np.ndarray:
        """Places of the samples of cells (c,), (c s, 3) m."""
        corners = mesh.nodes[mesh.cells[cells, :4]]
        return np.einsum("qv,cvi->cqi", CLOSE_SAMPLES, corners).reshape(-1, 3)


@dataclass(frozen=True)
class Enrichment:
    """The enrichment of one press by m functions, for E = 1 at each modulus sample.

    Attributes
    ----------
    cells : (c,) cells in which the functions live
    coupling : (m, c, q, nodes, 3) contribution of each modulus sample to k, at each cell's nodes
    energy : (m, m, c, q) contribution of each modulus sample to a
    load : (m,) l, the work of the unit load on the functions
    close : what the exact functions contribute in the cells around the tip
    """

    cells: np.ndarray
    coupling: np.ndarray
    energy: np.ndarray
    load: np.ndarray
    close: Close


class Neighbourhood(NamedTuple):
    """Where the near field of a press lives.

    Attributes
    ----------
    frame : (3, 3) two tangents and the press direction
    local : (n, 3) m, the mesh's nodes in that frame, from the contact point
    cells : (c,) enriched cells
    shape : (6,) the surface's paraboloid, see `fem.contact_shape`
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
    cells = _cells_near(mesh.cells, local, radius)
    shape = contact_shape(surface, contacts.points_m[j], frame, radius)
    return Neighbourhood(frame, local, cells, shape, radius)


def enrich(
    stiffness: Stiffness,
    surface: PressedSurface,
    contacts: Contacts,
    j: int,
    weights: np.ndarray,
) -> Enrichment:
    """Integrate the enrichment of press j.

    Parameters
    ----------
    surface : of the mesh
    weights : (n, 3) contact weights of the press.
    """
    place = neighbourhood(stiffness, surface, contacts, j)
    mesh, (frame, local, cells, shape, radius) = stiffness.mesh, place
    nu, profile = stiffness.poisson_ratio, contacts.profile_code
    field = nodal_fields(local, mesh.cells[cells], shape, radius, nu, profile)  # (m, c, nodes, 3)
    # What the interpolant takes off, by the stiffness matrix's own quadrature
    gradients = stiffness.gradients[cells] @ frame.T
    lam, mu, mean_lame = split_lame(nu)
    volumes = stiffness.volumes[cells, None] * stiffness.rule[1]
    coupling, energy = interpolant(field, linear_derivatives(mesh.order), stiffness.rule[0],
                                   gradients, frame, volumes, lam, mu)  # fmt: skip
    # The exact functions, with samples of their own where they vary most
    is_close = _cells_close(mesh.cells[cells], place)
    far, close = np.flatnonzero(~is_close), np.flatnonzero(is_close)
    volume = np.empty(field.shape[:2])  # (m, c) change of each cell's volume
    own, more, volume[:, far] = _exact(stiffness, place, cells[far], field[:, far], profile, 1)
    coupling[:, far] += own
    energy[:, :, far] += more
    own, more, volume[:, close] = _exact(
        stiffness, place, cells[close], field[:, close], profile, 2
    )
    # Single precision: half the memory, an error of 1e-7
    near = Close(cells[close], own.astype(np.float32), np.ascontiguousarray(more))
    if mean_lame > 0:
        # Mean change of volume of each cell, that of the interpolant taken off
        gradients = stiffness.mean_gradients[cells]
        dilatation = volume / stiffness.volumes[cells]
        dilatation -= np.einsum("mcis,cis->mc", field, gradients @ frame.T)
        share = mean_lame * volumes
        coupling += np.einsum("cq,mc,cia->mcqia", share, dilatation, gradients, optimize=True)
        energy += np.einsum("cq,mc,lc->mlcq", share, dilatation, dilatation, optimize=True)
    load = _load(surface, contacts, j, place, nu, weights)
    return Enrichment(cells, coupling.astype(np.float32), energy, load, near)


def _exact(stiffness: Stiffness, place: Neighbourhood, cells, field, profile: int, degree: int):
    """Contributions of the exact functions in some cells, by sample of a modulus of that degree.

    Returns
    -------
    coupling : (m, c, q, nodes, 3)
    energy : (m, m, c, q), what they have of it together with the interpolant among it
    volume : (m, c) change of each cell's volume
    """
    nu, order = stiffness.poisson_ratio, stiffness.mesh.order
    vertices = place.local[stiffness.mesh.cells[cells, :4]]
    strain, density = moments(vertices, place.shape, place.radius, nu, profile, degree)
    basis = sample_basis(stiffness) if degree == 1 else CLOSE_BASIS
    # From moments to those against the shape functions and modulus samples
    gradients = stiffness.gradients[cells] @ place.frame.T
    coupling, cross = exact(_stress(strain, nu), _raised(degree), basis,
                            linear_derivatives(order), gradients, place.frame,
                            np.ascontiguousarray(field))  # fmt: skip
    energy = np.moveaxis(density @ basis.T, 0, 2) - cross - cross.swapaxes(0, 1)
    counts = (monomials(degree + 1)[:, :, None] == np.arange(4)).sum(axis=1)
    often = factorial(degree + 1) / factorial(counts).prod(axis=1)  # in (sum lambda)^(degree + 1)
    volume = np.einsum("cmsk,k->mc", strain[:, :, :3], often)
    return coupling, energy, volume


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


def _stress(strain: np.ndarray, nu: float) -> np.ndarray:
    """Stress moments (c, m, k, 3, 3) of strain moments (c, m, 6, k), E = 1."""
    lam, mu, _ = split_lame(nu)
    index = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
    tensor = 2 * mu * strain.swapaxes(2, 3)[..., index]
    trace = lam * strain[:, :, :3].sum(axis=2)
    tensor[..., range(3), range(3)] += trace[..., None]
    return tensor


def _cells_near(cells: np.ndarray, local: np.ndarray, radius: float) -> np.ndarray:
    corners = local[cells[:, :4]]
    centre = corners.mean(axis=1)
    diameter = 2 * np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    # distance from the tip's disc
    out = np.maximum(np.hypot(centre[:, 0], centre[:, 1]) - radius, 0)
    distance = np.hypot(out, centre[:, 2])
    return np.flatnonzero(distance < _REACH_RADII * radius + _REACH_CELLS * diameter)


def _cells_close(cells: np.ndarray, place: Neighbourhood) -> np.ndarray:
    """Whether cells (c, nodes) lie so close to the disc that the field varies in them, (c,)."""
    corners = place.local[cells[:, :4]]
    diameter = 2 * np.linalg.norm(corners - corners.mean(axis=1)[:, None], axis=2).max(axis=1)
    points = np.einsum("qv,cvi->cqi", _PLACES, corners)
    out = np.maximum(np.hypot(points[..., 0], points[..., 1]) - place.radius, 0)
    return np.hypot(out, points[..., 2]).min(axis=1) < _CLOSE_CELLS * diameter


def nodal_fields(local, cells, shape, radius: float, nu: float, profile: int) -> np.ndarray:
    """Values of the functions at the nodes of cells (c, nodes): (m, c, nodes, 3)."""
    used, inverse = np.unique(cells, return_inverse=True)
    values = functions(local[used], shape, radius, nu, profile)
    return values[inverse.reshape(cells.shape)].transpose(2, 0, 1, 3)
