"""Closed-loop inverse kinematics (CLIK) of the tip: centre and axis, the spin left free."""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from sim.robot.rigid_chain import rigid_chain, tip_poses

DAMPING = 1e-3
LIMIT_MARGIN_RAD = 1e-3
LARGEST_STEP_RAD = 0.3


@dataclass(frozen=True)
class Reached:
    """Outcome of one inverse kinematics solution.

    Attributes
    ----------
    q : (n,) rad, configuration, inside the limits also where the goal was not reached
    converged : true if `error` is below the tolerance
    error : largest component of position error (m) and axis error (rad)
    """

    q: np.ndarray
    converged: bool
    error: float


class TipKinematics:
    """Forward and inverse kinematics of one frame whose z axis is the tip's axis.

    Parameters
    ----------
    arm : Pinocchio model with position limits
    frame : name of the frame at the tip's centre, z outwards along the probe

    Attributes
    ----------
    low, high : (n,) rad, limits less a margin
    shoulder_m, reach_m : place (3,) of the first joint, and the length from there to the tip that
        the arm would have if all its parts were in one line
    """

    def __init__(self, arm: pin.Model, frame: str = "tcp") -> None:
        self.arm = arm
        self._data = arm.createData()
        self._frame = arm.getFrameId(frame)
        self._chain = rigid_chain(arm, arm, frame)
        self.low = np.array(arm.lowerPositionLimit) + LIMIT_MARGIN_RAD
        self.high = np.array(arm.upperPositionLimit) - LIMIT_MARGIN_RAD
        lengths = [np.linalg.norm(place.translation) for place in arm.jointPlacements]
        tip = np.linalg.norm(arm.frames[self._frame].placement.translation)
        self.shoulder_m = np.array(arm.jointPlacements[1].translation)
        self.reach_m = float(sum(lengths[2:]) + tip)

    def pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) m and rotation (3, 3) of the tip in the world."""
        pin.framesForwardKinematics(self.arm, self._data, q)
        found = self._data.oMf[self._frame]
        return found.translation.copy(), found.rotation.copy()

    def poses(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (t, 3) m and rotations (t, 3, 3) at configurations (t, n) rad."""
        places, rotations = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
        tip_poses(self._chain, q, places, rotations)
        return places, rotations

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian of the tip's position in world axes, (3, n) m/rad."""
        kind = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return pin.computeFrameJacobian(self.arm, self._data, q, self._frame, kind)[:3].copy()

    def mass(self, q: np.ndarray) -> np.ndarray:
        """Mass matrix of the joints, (n, n) kg m^2."""
        return np.array(pin.crba(self.arm, self._data, q))

    def reach(
        self,
        point_m: np.ndarray,
        axis: np.ndarray,
        seed: np.ndarray,
        posture: np.ndarray | None = None,
        tolerance: float = 1e-9,
        iterations: int = 200,
    ) -> Reached:
        """Find a configuration with the tip's centre at a point and its axis along a direction.

        Damped least squares on the five errors in the tip's frame, the damping fading with the
        error; steps are bounded and clamped to the limits.

        Parameters
        ----------
        point_m : (3,) m in the world
        axis : (3,) unit, in the world
        seed : (n,) rad, where the iteration starts
        posture : (n,) rad that the two free directions are drawn to; None takes the shortest steps
        tolerance : of the largest error component, m and rad
        """
        q = np.clip(seed, self.low, self.high)
        for _ in range(iterations):
            pin.framesForwardKinematics(self.arm, self._data, q)
            tip = self._data.oMf[self._frame]
            error = _tip_error(tip, point_m, axis)
            size = float(np.abs(error).max())
            if size < tolerance:
                return Reached(q, True, size)
            jacobian = pin.computeFrameJacobian(
                self.arm, self._data, q, self._frame, pin.ReferenceFrame.LOCAL
            )[:5]
            normal = jacobian @ jacobian.T
            normal[np.diag_indices(5)] += (DAMPING * min(1.0, size)) ** 2 + 1e-14
            inverse = np.linalg.solve(normal, jacobian).T
            step = inverse @ error
            if posture is not None:
                pull = 0.05 * (posture - q)
                step += pull - inverse @ (jacobian @ pull)
            step *= min(1.0, LARGEST_STEP_RAD / np.abs(step).max())
            q = np.clip(q + step, self.low, self.high)
        error = _tip_error(self._forward(q), point_m, axis)
        size = float(np.abs(error).max())
        return Reached(q, size < tolerance, size)

    def _forward(self, q: np.ndarray) -> pin.SE3:
        pin.framesForwardKinematics(self.arm, self._data, q)
        return self._data.oMf[self._frame]


def _tip_error(tip: pin.SE3, point_m: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Position error and the rotation about x and y that is missing, in the tip's frame, (5,)."""
    rotation = tip.rotation
    goal = rotation.T @ axis  # the wanted axis in the tip's frame; there it is (0, 0, 1)
    sine = np.hypot(goal[0], goal[1])
    angle = np.arctan2(sine, goal[2])
    turn = np.array([-goal[1], goal[0]]) * (angle / sine if sine > 1e-12 else 1.0)
    return np.concatenate([rotation.T @ (point_m - tip.translation), turn])
