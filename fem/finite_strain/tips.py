"""Contact of a tip with the surface at finite strain: a given pressure, or a rigid flat punch.

With the contact weights alone the pressure under the tip is given, p, and the surface's shape is
free: at small strain it is nearly flat, since p is the punch's own pressure, and the error of the
reading is of second order. At finite strain it is not flat at all, and a singular pressure that
does not change sinks ever deeper the finer the mesh. So the pressure is free to change,

    p(x) (1 + sum_k lambda_k phi_k(x)),    int p phi_k = 0,   int p phi_k phi_l = delta_kl,

with the polynomials phi_k up to some degree, and its multipliers lambda_k see to it that the
surface's displacement along the press has no such part, int p phi_k u.d dA = 0. A tip that sticks
holds the displacement across the press likewise, its mean included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fem.contact.contacts import Contacts, PressedSurface, contact_frame, disc_quadrature
from fem.errors import MeshError
from fem.linear.assembly import shape_functions

_INDEPENDENT = 1e-3  # singular values of the constraints below this part of the largest are dropped


class TipShape(Protocol):
    """A tip's hold on the surface."""

    def constraints(self, surface: PressedSurface, contacts: Contacts, j: int) -> np.ndarray:
        """Vectors b_k (k, n, 3) with b_k.u = 0 under press j."""
        ...


@dataclass(frozen=True)
class DeadPressure:
    """The pressure of the contact weights, whatever the surface does: a dead load."""

    def constraints(self, surface: PressedSurface, contacts: Contacts, j: int) -> np.ndarray:
        """None."""
        del contacts, j
        return np.empty((0, len(surface.nodes), 3))


@dataclass(frozen=True)
class RigidTip:
    """A flat tip that does not bend and does not turn.

    Attributes
    ----------
    degree : of the polynomials phi_k, at least 1
    sticking : the surface is held across the press too; else it slides without friction
    """

    degree: int = 4
    sticking: bool = True

    def __post_init__(self) -> None:
        if self.degree < 1:
            raise MeshError(f"a rigid tip's polynomials have degree 1 or more, got {self.degree}")

    def constraints(self, surface: PressedSurface, contacts: Contacts, j: int) -> np.ndarray:
        """Vectors (k, n, 3); fewer on a coarse mesh, which cannot resolve all polynomials."""
        if contacts.profile != "flat":
            raise MeshError(f"a rigid flat tip presses with profile 'flat', not "
                            f"'{contacts.profile}'; a dead pressure goes with any")  # fmt: skip
        points, weighted = disc_polynomials(self.degree, contacts.profile_code)
        radius = float(contacts.radius_m[j])
        frame = contact_frame(contacts.directions[j])
        under = surface.under(contacts.points_m[j], frame, points * radius, radius)
        shape = shape_functions(under.barycentric, surface.order)
        used, inverse = np.unique(surface.faces[under.face], return_inverse=True)
        inverse = inverse.reshape(shape.shape)
        scalar = np.zeros((len(weighted), len(used)))
        for k, weight in enumerate(weighted):
            np.add.at(scalar[k], inverse, shape * weight[:, None])
        parts = [_independent(scalar[1:])[:, :, None] * frame[2]]
        if self.sticking:
            held = _independent(scalar)[:, :, None]
            parts += [held * frame[0], held * frame[1]]
        rows = np.concatenate(parts)
        result = np.zeros((len(rows), len(surface.nodes), 3))
        result[:, used] = rows
        return result


def disc_polynomials(degree: int, profile: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal polynomials phi_k, the constant first, at the points of `disc_quadrature`.

    Returns
    -------
    The points of the unit disc (p, 2), and phi_k times the points' weights (k, p).
    """
    points, weights = disc_quadrature(profile)
    powers = [(a, n - a) for n in range(degree + 1) for a in range(n + 1)]
    monomials = np.stack([points[:, 0] ** a * points[:, 1] ** b for a, b in powers], axis=1)
    orthogonal, _ = np.linalg.qr(np.sqrt(weights)[:, None] * monomials)
    return points, (orthogonal * np.sqrt(weights)[:, None]).T


def _independent(rows: np.ndarray) -> np.ndarray:
    """Orthonormal rows that span the rows (k, t), nearly dependent ones dropped."""
    _, size, right = np.linalg.svd(rows, full_matrices=False)
    return right[size > _INDEPENDENT * size.max()]
