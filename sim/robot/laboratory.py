"""The laboratory as one compiled MuJoCo model, with the Pinocchio models made from it."""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from models import Arm, InputError, read_arm
from sim.robot.arm_spec import (
    PROBE,
    Boxes,
    add_obstacles,
    add_scene,
    add_touch_sensor,
    arm_spec,
)
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
    """Arm, probe, table and body; arrays are (n,) for n joints.

    Attributes
    ----------
    model : compiled MuJoCo model of the scene
    physics : the same without the shapes that touch nothing, a quarter faster
    arm : Pinocchio model of the arm and the probe
    tool : the same joints with the mass of the probe alone
    home : rad, configuration from which a scan starts
    speed_limit, acceleration_limit : of the joints, rad/s and rad/s^2
    links : names of the arm's bodies, the probe last
    """

    model: mujoco.MjModel
    physics: mujoco.MjModel
    arm: pin.Model
    tool: pin.Model
    home: np.ndarray
    speed_limit: np.ndarray
    acceleration_limit: np.ndarray
    links: tuple[str, ...]


def build_laboratory(
    tip_radius_m: float = 0.005,
    body_size_m: tuple[float, float, float] = (0.096, 0.096, 0.048),
    body_in_world: Placement | None = None,
    timestep_s: float = 0.002,
    round_tip: bool = False,
    arm: Arm | None = None,
    obstacles: Boxes = (),
) -> Laboratory:
    """Compile the scene with an arm, a tip, a body and a time step.

    Parameters
    ----------
    tip_radius_m : of the tip
    body_size_m : edges of the box that bounds the body; it starts at the body frame's origin
    body_in_world : where the body stands
    timestep_s : of the simulation
    round_tip : the tip ends in a ball of its radius
    arm : as `models.read_arm` reads it; None is the Panda
    obstacles : boxes that it keeps clear of

    Raises
    ------
    InputError
        A radius, size or time step that is not positive, an arm that cannot be built.
    """
    for name, value in (("tip radius", tip_radius_m), ("time step", timestep_s)):
        if not value > 0:
            raise InputError(f"The {name} is {value:g}; it has to be positive.")
    if not min(body_size_m) > 0:
        raise InputError(
            f"The body's size is {body_size_m}; three positive lengths in m are needed."
        )
    body_in_world, arm = body_in_world or Placement(), arm or read_arm()
    spec = arm_spec(arm)
    links = tuple(body.name for body in spec.bodies if body.name not in ("world", PROBE))
    add_scene(
        spec,
        np.asarray(body_size_m, float),
        np.asarray(body_in_world.position_m),
        np.asarray(body_in_world.quaternion),
    )
    add_obstacles(spec, obstacles)
    add_touch_sensor(spec)
    spec.option.timestep = timestep_s
    tip = spec.geom("probe_tip")
    tip.size = [tip_radius_m, *tip.size[1:]]
    if round_tip:  # a capsule whose end is where the cylinder's face was
        tip.type = mujoco.mjtGeom.mjGEOM_CAPSULE
        ball = float(tip.fromto[5]) - tip_radius_m
        tip.fromto = [0.0, 0.0, ball - CAPSULE_M, 0.0, 0.0, ball]
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"{arm.model}: MuJoCo cannot compile it ({error})") from error
    physics = _without_shapes(spec, model)
    order = tuple(model.joint(j).name for j in range(model.njnt))
    if order != arm.joints:
        raise InputError(
            f"{arm.model}: its joints from the base outwards are {', '.join(order)}; list them so "
            "in arm.toml"
        )
    whole, tool = pinocchio_model(model), pinocchio_model(model, mass_of=(PROBE,))
    return Laboratory(
        model,
        physics,
        whole,
        tool,
        arm.home_rad,
        arm.speed_limit,
        arm.acceleration_limit,
        (*links, PROBE),
    )


def _without_shapes(spec: mujoco.MjSpec, whole: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model with the geoms of its contact pairs alone; masses are those of `whole`."""
    bare = spec.copy()
    touching = {name for pair in bare.pairs for name in (pair.geomname1, pair.geomname2)}
    for geom in list(bare.geoms):
        if geom.name not in touching:
            bare.delete(geom)
    try:
        model = bare.compile()
    except ValueError:  # a mass that is made of the shapes
        return whole
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        getattr(model, name)[:] = getattr(whole, name)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
