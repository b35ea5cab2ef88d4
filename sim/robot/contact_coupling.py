"""Two-way coupling of MuJoCo's contact with the finite element body: the matched contact.

The contact force of a step goes to the body, the body's displacement under that force comes back.
Moving the surface by it (a staggered exchange) diverges or oscillates for soft bodies, since
MuJoCo's own contact is orders of magnitude stiffer than they are. Here MuJoCo's contact takes
over the body's law instead, as a straight line:

- its stiffness is the body's tangent k = dF/du at the last exchanged pair (F_k, u_k);
- its surface (the pad) is placed so that the line passes through that pair: at depth u_k - F_k / k.

So the contact's law is f = F_k + k (depth - u_k), and whenever f has moved away from F_k by more
than a threshold the pair is renewed from the finite element model. At a settled pair the tip's
depth is the body's own displacement; for a linear body the line is exact at every force.

How the contact is made a plain spring: frictionless, with the least constant impedance that MuJoCo
takes, d = 0.0001, and no contact damping, in MuJoCo's direct format solref = (-k R d, 0). R, the
constraint's regularisation, is constant for this pair of bodies and is read once. Impedance that
small adds only 1/R = 0.7 g of virtual mass, and without damping no velocity enters a measured pair.

Stability. The spring acts on the arm's effective mass m = 4 to 5 kg under MuJoCo's semi-implicit
Euler step, which is stable for k dt^2 / m < 4, that is for k < 4 MN/m at dt = 2 ms; the joint
servo damps it. Tested from 50 N/m to 100 kN/m at 2 ms. There is no relaxation factor and no inner
iteration. For a stiffening law the threshold has to be small against the range of force over
which the tangent changes: 2 % of the force is taken, and where the law stayed on its line 2 % of
the set force.
"""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np

from sim.robot.laboratory import Laboratory

PAIR = "tip_on_pad"
IMPEDANCE = 1e-4
FAR_M = 1.0
RENEW_FRACTION, LEAST_FORCE_N = 0.02, 1e-5
STRAIGHT = 1e-6


class PressedBody(Protocol):
    """Soft body as the coupling needs it; `press` counts from 0."""

    def displacement(self, press: int, force_n: float) -> float:
        """Depth of the tip under a force, m."""
        ...

    def tangent(self, press: int, force_n: float) -> float:
        """Return the local stiffness dF/du at a force, N/m."""
        ...


@runtime_checkable
class BodyInTime(Protocol):
    """Soft body whose law changes with time: creep, breathing, a history.

    Attributes
    ----------
    in_time : false where it does not after all
    """

    in_time: bool

    def advance(self, press: int, time_s: float, force_n: float) -> bool:
        """Go on to a time under a force; True if the law is another one than before."""
        ...


class BodyLawError(Exception):
    """The pressed body answers with a displacement or a stiffness that no body has."""


class MatchedContact:
    """The pad under the tip, kept on the tangent of the body's law.

    Parameters
    ----------
    laboratory, data : of the running simulation; the contact parameters of the pair are changed in
        place
    body : the soft body

    Attributes
    ----------
    calls : number of pairs exchanged in the present press
    band_n : contact forces between which the last pair holds
    in_time : whether the body has to be asked in each step
    """

    def __init__(self, laboratory: Laboratory, data: mujoco.MjData, body: PressedBody) -> None:
        model = laboratory.physics
        self._model, self._data, self._body = model, data, body
        self._in_time = body if isinstance(body, BodyInTime) and body.in_time else None
        self.in_time = self._in_time is not None
        self._pair = model.pair(PAIR).id
        model.pair_solimp[self._pair, :2] = IMPEDANCE
        self._regularisation = _regularisation(laboratory)
        self._press, self._set_force, self._force, self._stiffness = 0, 0.0, 0.0, 1.0
        self._point, self._normal = np.zeros(3), np.array([0.0, 0.0, 1.0])
        self._shift, self._line_m = np.zeros(3), 0.0
        self.calls = 0
        self.release()

    def start(self, press: int, point_m: np.ndarray, direction: np.ndarray, force_n: float) -> None:
        """Bring the pad under the tip for a press.

        Parameters
        ----------
        press : number of the press in the body's contacts
        point_m, direction : (3,) m and unit into the body, world frame
        force_n : set force; the pair is renewed each time the force moved by 2 % of itself, on a
            straight law by 2 % of the set force
        """
        self._press, self._point, self._normal = press, point_m, -direction
        self._set_force = force_n
        self._data.mocap_quat[0] = _quaternion_of_normal(self._normal)
        self.calls, self._line_m, self._shift = 0, 0.0, np.zeros(3)
        self._exchange(0.0)

    def follow(self, force_n: float, time_s: float) -> None:
        """Renew the pair where the contact force has moved away from the last one."""
        moved = self._in_time and self._in_time.advance(self._press, time_s, force_n)
        if moved or not self.band_n[0] <= force_n <= self.band_n[1]:
            self._exchange(force_n)

    def shift(self, by_m: np.ndarray) -> None:
        """Move the undeformed surface to (3,) m beside its planned place, world frame."""
        self._shift = by_m
        self._place()

    def carry(self, point_m: np.ndarray, direction: np.ndarray) -> None:
        """Move the contact along the surface to another point (3,) m; the law is asked again."""
        self._point, self._normal = point_m, -direction
        self._data.mocap_quat[0] = _quaternion_of_normal(self._normal)
        self._exchange(self._force)

    def release(self) -> None:
        """Take the pad away, so that the arm moves freely."""
        self._data.mocap_pos[0] = self._point - FAR_M * self._normal
        self.band_n = -np.inf, np.inf

    def _exchange(self, force_n: float) -> None:
        """Give the body a force; put its displacement and tangent into the contact."""
        depth = self._body.displacement(self._press, force_n)
        stiffness = self._body.tangent(self._press, force_n)
        if not (math.isfinite(depth) and math.isfinite(stiffness) and stiffness > 0):
            raise BodyLawError(
                f"the body answers {force_n:.3g} N with a travel of {depth:.3g} m and a stiffness "
                f"of {stiffness:.3g} N/m; a positive stiffness is needed"
            )
        foreseen = self._line_m + force_n / self._stiffness
        straight = self.calls > 0 and abs(depth - foreseen) < STRAIGHT * abs(depth)
        moved = self._set_force if straight else max(force_n, LEAST_FORCE_N)
        moved = RENEW_FRACTION * min(moved, self._set_force)
        self.band_n = force_n - moved, force_n + moved
        self._force, self._stiffness = force_n, stiffness
        self.calls += 1
        self._model.pair_solref[self._pair] = (-stiffness * self._regularisation * IMPEDANCE, 0.0)
        self._line_m = depth - force_n / stiffness
        self._place()

    def _place(self) -> None:
        self._data.mocap_pos[0] = self._point + self._shift - self._line_m * self._normal


def _regularisation(laboratory: Laboratory) -> float:
    """R of the pair's constraint, from a pad put 0.5 mm into the tip; the same everywhere."""
    model = laboratory.physics
    data = mujoco.MjData(model)
    data.qpos[:] = laboratory.home
    mujoco.mj_forward(model, data)
    axis = data.site("tcp").xmat.reshape(3, 3)[:, 2]
    data.mocap_pos[0] = data.site("tcp").xpos - 5e-4 * axis
    data.mocap_quat[0] = _quaternion_of_normal(-axis)
    mujoco.mj_forward(model, data)
    return float(data.efc_R[data.contact[0].efc_address])


def _quaternion_of_normal(normal: np.ndarray) -> np.ndarray:
    """Quaternion (w, x, y, z) that turns z onto a unit normal."""
    quaternion = np.zeros(4)
    mujoco.mju_quatZ2Vec(quaternion, np.array(normal, float))
    return quaternion
