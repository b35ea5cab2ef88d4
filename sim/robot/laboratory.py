"""The laboratory as one compiled MuJoCo model, with the Pinocchio models made from it."""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from models import SCENE_XML, InputError
from sim.robot.pinocchio_model import pinocchio_model

CAPSULE_M = 0.008  # length of a round tip's straight part


@dataclass(frozen=True)
class Placement:
    """Pose of the body's frame in the world frame (the arm's base).

    Attributes
    ----------
    position_m : (3,) m
    quaternion : (4,) unit, w, x, y, z
    """

    position_m: tuple[float, float, float] = (0.402, -0.048, 0.0)
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if abs(np.linalg.norm(self.quaternion) - 1) > 1e-6:
            raise InputError(
                f"The body's orientation {self.quaternion} is no unit quaternion (w, x, y, z): "
                "divide it by its norm."
            )

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) matrix that turns body coordinates into world coordinates."""
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, np.asarray(self.quaternion, float))
        return matrix.reshape(3, 3)

    def points_to_world(self, points_m: np.ndarray) -> np.ndarray:
        """World coordinates of points (..., 3) m given in the body frame."""
        return np.asarray(points_m) @ self.rotation.T + np.asarray(self.position_m)

    def vectors_to_world(self, vectors: np.ndarray) -> np.ndarray:
        """World components of vectors (..., 3) given in the body frame."""
        return np.asarray(vectors) @ self.rotation.T


@dataclass(frozen=True)
class Laboratory:
    """Arm, probe, table and body.

    Attributes
    ----------
    model : compiled MuJoCo model of the scene
    arm : Pinocchio model of the arm and the probe
    tool : the same joints with the mass of the probe alone
    home : (7,) rad, configuration from which a scan starts
    """

    model: mujoco.MjModel
    arm: pin.Model
    tool: pin.Model
    home: np.ndarray

    @property
    def speed_limit(self) -> np.ndarray:
        """Of the joints, (7,) rad/s."""
        return np.array(self.arm.velocityLimit)

    @property
    def acceleration_limit(self) -> np.ndarray:
        """Of the joints, (7,) rad/s^2."""
        return np.array(self.model.numeric("joint_acceleration_limit").data)


def build_laboratory(
    tip_radius_m: float = 0.005,
    body_size_m: tuple[float, float, float] = (0.096, 0.096, 0.048),
    body_in_world: Placement | None = None,
    timestep_s: float = 0.002,
    round_tip: bool = False,
) -> Laboratory:
    """Compile the scene with a tip, a body and a time step.

    Parameters
    ----------
    tip_radius_m : of the tip
    body_size_m : edges of the box that bounds the body; it starts at the body frame's origin
    body_in_world : where the body stands
    timestep_s : of the simulation
    round_tip : the tip ends in a ball of its radius

    Raises
    ------
    InputError
        A radius, size or time step that is not positive.
    """
    for name, value in (("tip radius", tip_radius_m), ("time step", timestep_s)):
        if not value > 0:
            raise InputError(f"The {name} is {value:g}; it has to be positive.")
    if not min(body_size_m) > 0:
        raise InputError(
            f"The body's size is {body_size_m}; three positive lengths in m are needed."
        )
    body_in_world = body_in_world or Placement()
    spec = mujoco.MjSpec.from_file(str(SCENE_XML))
    spec.option.timestep = timestep_s
    tip = spec.geom("probe_tip")
    tip.size = [tip_radius_m, *tip.size[1:]]
    if round_tip:  # a capsule whose end is where the cylinder's face was
        tip.type = mujoco.mjtGeom.mjGEOM_CAPSULE
        ball = float(tip.fromto[5]) - tip_radius_m
        tip.fromto = [0.0, 0.0, ball - CAPSULE_M, 0.0, 0.0, ball]
    half = np.asarray(body_size_m) / 2
    box = spec.geom("soft_body")
    box.pos, box.size = half, half
    body = spec.body("soft_body")
    body.pos, body.quat = body_in_world.position_m, body_in_world.quaternion
    model = spec.compile()
    home = np.array(model.numeric("home").data)
    home.flags.writeable = False
    return Laboratory(
        model, pinocchio_model(model), pinocchio_model(model, mass_of=("probe",)), home
    )
