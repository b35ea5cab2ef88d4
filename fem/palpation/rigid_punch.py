r"""Other pressures under a tip, from its travel: shape of a punch, size of a contact.

Decrease of a flat tip's compliance by a pressure better than the half-space's:

The compliance C of an assumed pressure is an upper bound: the true pressure of a rigid tip that is
held upright has the least complementary energy. Adding pressures p_k without resultant lowers it,

    C* = C - sum_k A_k^2/A_kk,    A_k = int p_k u dA,

u the displacement under the assumed pressure, A_kk the energy of p_k alone. For
p_0 = Hertz' less the flat pressure (even) and p_1, p_2 = the flat one times x/a and y/a (a tip that
would like to tilt) these are orthogonal on the half-space, with

    A_00 = 0.1 k/a,    A_11 = A_22 = k/(12 a),    k = (1 - nu^2)/E.

The readings A_k need no further solve. On a bonded layer this takes the error of a tip as wide as
the layer is thick (nu = 0.49) from 3.7 to 0.4 %; with a/h < 0.4 there is nothing to correct. Beside
an inclusion the tilt counts much earlier: 1.8 % at a = 5 mm and 6 % at 10 mm over the flank of one
of 10 mm radius, 14 mm deep and six times as stiff as its surroundings.

A Hertz pressure of another radius is another pressure too: by reciprocity
a dC/da = 2 int a (dp/da) u dA, and a dp/da is three times the flat pressure less Hertz'.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from fem.contact.contacts import PressedSurface, contact_frame, disc_quadrature
from fem.contact.half_space import FLAT
from fem.contact.paraboloid import contact_shape
from fem.errors import MeshError
from fem.linear.assembly import shape_functions
from fem.near_field.points import functions
from fem.palpation.model import PalpationModel, Response

_OWN = np.array([0.1, 1 / 12, 1 / 12])  # energies A_kk in units of k/a


class _Reading(NamedTuple):
    """Weights that read the three A_k off a press's field.

    Nodes (n,), weights (3, n, 3) of their displacements, weights (3, m) of the near field's
    amplitudes.
    """

    nodes: np.ndarray
    nodal: np.ndarray
    near: np.ndarray


_READINGS: WeakKeyDictionary[PalpationModel, list[_Reading]] = WeakKeyDictionary()


def shape_gain(response: Response, modulus_pa: np.ndarray) -> np.ndarray:
    """Decrease of the compliance by the better pressure, (j,) m/N, not negative.

    Of flat tips; `modulus_pa` (j,) is Young's modulus at the contact points, Pa.

    Raises
    ------
    MeshError
        Contacts that are not flat tips.
    """
    model = response.model
    contacts, nu = model.contacts, model.stiffness.poisson_ratio
    if contacts.profile != "flat":
        raise MeshError(f"only a flat tip has a shape to correct, got '{contacts.profile}'")
    read = _read(response)
    modulus = np.broadcast_to(np.asarray(modulus_pa, float), len(contacts))
    return np.sum(read**2 / _OWN, axis=1) * modulus * contacts.radius_m / (1 - nu**2)


def by_contact_radius(response: Response) -> np.ndarray:
    """Return the derivative a dC/da of the compliance of Hertz contacts by the radius a, (j,) m/N.

    On a half-space that is -C.

    Raises
    ------
    MeshError
        Contacts of another pressure.
    """
    if response.model.contacts.profile != "hertz":
        raise MeshError(f"expected Hertz contacts, got '{response.model.contacts.profile}'")
    return -6 * _read(response)[:, 0]


def _read(response: Response) -> np.ndarray:
    """Return the readings A_k of all presses, (j, 3) m/N."""
    model = response.model
    if model not in _READINGS:
        surface = PressedSurface(model.mesh)
        _READINGS[model] = [_reading(model, surface, j) for j in range(len(model.contacts))]
    return np.array(
        [
            np.einsum("kns,ns->k", nodal, response.displacement(j)[nodes])
            + near @ response.amplitude[j]
            for j, (nodes, nodal, near) in enumerate(_READINGS[model])
        ]
    )


def travel_under(response: Response, j: int, disc: np.ndarray) -> np.ndarray:
    """Displacement along press j at points (p, 2) of its tip's unit disc under 1 N, (p,) m/N."""
    model = response.model
    nodes, nodal, near = _under(model, PressedSurface(model.mesh), j, disc)
    return nodal @ (response.displacement(j)[nodes] @ model.contacts.directions[j]) + (
        near @ response.amplitude[j]
    )


def _reading(model: PalpationModel, surface: PressedSurface, j: int) -> _Reading:
    disc, flat = disc_quadrature(FLAT)
    # s^2 = 1 - r^2: the Hertz pressure is 3 s^2 times the flat one
    even = flat * (2 - 3 * (disc**2).sum(axis=1))
    shapes = np.stack([even, flat * disc[:, 0], flat * disc[:, 1]])
    nodes, nodal, near = _under(model, surface, j, disc)
    along = model.contacts.directions[j]
    return _Reading(nodes, (shapes @ nodal)[:, :, None] * along, shapes @ near)


def _under(
    model: PalpationModel, surface: PressedSurface, j: int, disc: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights of the travel at points (p, 2) of the disc.

    Nodes (n,), weights (p, n) of their travel, weights (p, m) of the near field's amplitudes.
    """
    contacts, mesh = model.contacts, model.mesh
    centre, radius = contacts.points_m[j], float(contacts.radius_m[j])
    frame = contact_frame(contacts.directions[j])
    under = surface.under(centre, frame, disc * radius, radius)
    nodes, place = np.unique(surface.faces[under.face], return_inverse=True)
    nodal = np.zeros((len(disc), len(nodes)))
    values = shape_functions(under.barycentric, mesh.order)
    np.add.at(nodal, (np.arange(len(disc))[:, None], place.reshape(values.shape)), values)
    if model.enrichment is None:
        return nodes, nodal, np.zeros((len(disc), 0))
    nu, shape = model.stiffness.poisson_ratio, contact_shape(surface, centre, frame, radius)
    local = (mesh.nodes[nodes] - centre) @ frame.T
    pressed = np.column_stack([disc * radius, under.depth])
    own = contacts.profile_code
    near = functions(pressed, shape, radius, nu, own)[:, :, 2]
    return nodes, nodal, near - nodal @ functions(local, shape, radius, nu, own)[:, :, 2]
