"""The Pinocchio model of the arm, built from the compiled MuJoCo model.

The MJCF is the one source of truth. Pinocchio's own MJCF reader is not used: it silently drops
the pose of a base that is fixed with an offset, the place of sites on jointless bodies, and
masses of bodies beyond the first. Reading the compiled model leaves nothing to interpret.
"""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from collections.abc import Collection

import mujoco
import numpy as np
import pinocchio as pin


def placement(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """Pose from a position (3,) in m and a unit quaternion (4,) w, x, y, z."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, float))
    return pin.SE3(rotation.reshape(3, 3), np.array(position, float))


def pinocchio_model(model: mujoco.MjModel, mass_of: Collection[str] | None = None) -> pin.Model:
    """Build the Pinocchio model of all jointed and fixed bodies, with frames for bodies and sites.

    Parameters
    ----------
    model : compiled model with hinge and slide joints; mocap bodies are left out.
    mass_of : names of the bodies whose mass counts, default all. With the tool alone, inverse
        dynamics gives the force that the tool's own weight and inertia need.

    Returns
    -------
    Model whose joints stand in MuJoCo's order, with limits of angle and effort and with
    armature. Joint damping is not in it: `model.dof_damping` has to be added by hand.

    Raises
    ------
    ValueError
        A joint that is neither hinge nor slide, or one whose zero is shifted (`ref`).
    """
    result = pin.Model()
    result.gravity.linear = np.array(model.opt.gravity)
    armature = np.zeros(model.nv)
    located = {0: (0, pin.SE3.Identity())}  # body -> joint that moves it, body's pose in that joint
    for body in range(1, model.nbody):
        if model.body_mocapid[body] >= 0:
            continue
        joint, in_joint = located[int(model.body_parentid[body])]
        in_joint = in_joint * placement(model.body_pos[body], model.body_quat[body])
        first = int(model.body_jntadr[body])
        for j in range(first, first + int(model.body_jntnum[body])):
            joint, in_joint = _add_joint(result, model, j, joint, in_joint)
            armature[result.idx_vs[joint]] = model.dof_armature[model.jnt_dofadr[j]]
        located[body] = (joint, in_joint)
        name = model.body(body).name
        if model.body_mass[body] > 0 and (mass_of is None or name in mass_of):
            inertia = pin.Inertia(
                float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body])
            )
            principal = placement(model.body_ipos[body], model.body_iquat[body])
            result.appendBodyToJoint(joint, inertia, in_joint * principal)
        result.addFrame(pin.Frame(name, joint, 0, in_joint, pin.FrameType.BODY), False)
    result.armature = armature[: result.nv]
    _add_sites(result, model, located)
    return result


def _add_joint(
    result: pin.Model, model: mujoco.MjModel, j: int, parent: int, in_parent: pin.SE3
) -> tuple[int, pin.SE3]:
    """Append MuJoCo's joint `j`; return its index and the body's pose in the moving joint frame."""
    axis = model.jnt_axis[j].copy()
    if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE:
        kind = pin.JointModelRevoluteUnaligned(axis)
    elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
        kind = pin.JointModelPrismaticUnaligned(axis)
    else:
        raise ValueError(
            f"joint {model.joint(j).name!r}: only hinge and slide joints are supported"
        )
    if model.qpos0[model.jnt_qposadr[j]] != 0:
        raise ValueError(f"joint {model.joint(j).name!r}: a shifted zero (ref) is not supported")
    low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
    effort = np.abs(model.jnt_actfrcrange[j]).max() if model.jnt_actfrclimited[j] else np.inf
    anchor = pin.SE3(np.eye(3), model.jnt_pos[j].copy())
    index = result.addJoint(
        parent,
        kind,
        in_parent * anchor,
        model.joint(j).name,
        np.array([effort]),
        np.array([np.inf]),
        np.array([low]),
        np.array([high]),
    )
    return index, anchor.inverse()


def _add_sites(result: pin.Model, model: mujoco.MjModel, located: dict) -> None:
    """Append a frame for each site of a body that the model has."""
    for site in range(model.nsite):
        body = int(model.site_bodyid[site])
        if body not in located:
            continue
        joint, in_joint = located[body]
        pose = in_joint * placement(model.site_pos[site], model.site_quat[site])
        frame = pin.Frame(model.site(site).name, joint, 0, pose, pin.FrameType.OP_FRAME)
        result.addFrame(frame, False)
