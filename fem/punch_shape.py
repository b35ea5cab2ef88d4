r"""How much a flat tip sinks less because its pressure is not quite the half-space's.

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
"""

from __future__ import annotations

import numpy as np

from fem.assembly import shape_functions
from fem.contact import PressedSurface, contact_frame, disc_quadrature
from fem.contact_shape import contact_shape
from fem.errors import MeshError
from fem.half_space import FLAT
from fem.near_field_points import functions
from fem.palpation import PalpationModel, Response


def shape_gain(model: PalpationModel, response: Response, modulus_pa: np.ndarray) -> np.ndarray:
    """Compliance that the better pressure takes off, (j,) m/N, not negative.

    Parameters
    ----------
    modulus_pa : (j,) Young's modulus at the contact points, Pa

    Raises
    ------
    MeshError
        Contacts that are not flat tips.
    """
    contacts, nu = model.contacts, model.stiffness.poisson_ratio
    if contacts.profile != "flat":
        raise MeshError(f"only a flat tip has a shape to correct, got '{contacts.profile}'")
    surface = PressedSurface(model.mesh)
    disc, flat = disc_quadrature(FLAT)
    # s^2 = 1 - r^2: the Hertz pressure is 3 s^2 times the flat one
    even = flat * (2 - 3 * (disc**2).sum(axis=1))
    shapes = np.stack([even, flat * disc[:, 0], flat * disc[:, 1]])
    own = np.array([0.1, 1 / 12, 1 / 12])
    modulus = np.broadcast_to(np.asarray(modulus_pa, float), len(contacts))
    gain = np.empty(len(contacts))
    for j in range(len(contacts)):
        radius = float(contacts.radius_m[j])
        readings = shapes @ _sinking(model, response, surface, j, disc * radius)
        gain[j] = np.sum(readings**2 / own) * modulus[j] * radius / (1 - nu**2)
    return gain


def _sinking(model, response: Response, surface: PressedSurface, j: int, disc) -> np.ndarray:
    """Displacement along the press at points (p, 2) of its disc under 1 N, near field included."""
    contacts, mesh = model.contacts, model.mesh
    centre, radius = contacts.points_m[j], float(contacts.radius_m[j])
    frame = contact_frame(contacts.directions[j])
    under = surface.under(centre, frame, disc, radius)
    faces = surface.faces[under.face]
    values = response.displacement(j)[faces] @ frame[2]  # (p, nodes)
    exact = 0.0
    if len(model.enrichments):
        alpha, nu = response._amplitude[j], model.stiffness.poisson_ratio
        shape = contact_shape(surface, centre, frame, radius)
        local = (mesh.nodes[faces.ravel()] - centre) @ frame.T
        nodal = functions(local, shape, radius, nu, FLAT)[:, :, 2] @ alpha
        values = values - nodal.reshape(faces.shape)
        pressed = np.column_stack([disc, under.depth])
        exact = functions(pressed, shape, radius, nu, FLAT)[:, :, 2] @ alpha
    return np.einsum("pn,pn->p", shape_functions(under.barycentric, mesh.order), values) + exact
