"""The scene of a virtual scan in its recording: arm, body, truth, and every frame."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from palpmap.recording.frames import Frame as DrawnFrame
from palpmap.recording.maps import map_views
from palpmap.recording.recorder import Recording
from palpmap.recording.scene import LinkShape, link_names
from palpmap.study.virtual_lab import Laboratory

if TYPE_CHECKING:
    import mujoco

    from sim.scan import Frame


def draw_scene(
    recording: Recording, laboratory: Laboratory, parameters: dict[str, float]
) -> "Callable[[Frame], None]":
    """Put arm, body and truth into the recording; return the drawer of a frame."""
    from sim.motion import plan_scene

    plan, body = laboratory.plan, laboratory.body
    place = plan.body_in_world
    arm = plan_scene(plan, laboratory.settings)
    shapes = arm_shapes(arm.model, arm.links)
    drawn = link_names(shapes)
    order = [arm.links.index(name) for name in drawn]
    modulus = laboratory.hidden.body.modulus  # with what is hidden in it
    views = map_views(modulus, plan.body.lowest_m, plan.body.lowest_m + plan.body.extent_m)
    recording.truth(views, parameters)
    recording.scene(
        body.surface_nodes_m,
        body.surface_triangles,
        links=shapes,
        body_modulus_pa=modulus(body.surface_nodes_m),
        body_position_m=place.position_m,
        body_quaternion=place.quaternion,
        arrow_m_per_n=0.02 / plan.force_n,
    )
    to_body = place.rotation.T

    def draw(frame: "Frame") -> None:
        touching = frame.phase in ("touch", "load", "hold", "unload")
        poses = np.hstack([frame.positions_m, frame.quaternions])[order]
        recording.frame(
            DrawnFrame(
                frame.time_s,
                poses,
                frame.force_n,
                max(frame.displacement_m, 0.0) if touching else 0.0,
                plan.points_m[frame.press],
                to_body @ frame.force_vector_n,
                lambda: body.surface_displacement(frame.press, max(frame.force_n, 0.0)),
            )
        )

    return draw


def arm_shapes(model: "mujoco.MjModel", links: tuple[str, ...]) -> list[LinkShape]:
    """Return the drawable geoms of the arm's links and the probe, from the compiled model."""
    import mujoco

    kinds = {
        mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
        mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
        mujoco.mjtGeom.mjGEOM_BOX: "box",
        mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
        mujoco.mjtGeom.mjGEOM_MESH: "mesh",
    }
    shapes = []
    for geom in range(model.ngeom):
        link = model.body(model.geom_bodyid[geom]).name
        kind = kinds.get(mujoco.mjtGeom(model.geom_type[geom]))
        if link in links and kind and model.geom_group[geom] < 3:
            shapes.append(
                LinkShape(
                    link,
                    kind,
                    model.geom_size[geom].copy(),
                    model.geom_pos[geom].copy(),
                    model.geom_quat[geom].copy(),
                    model.geom_rgba[geom].copy(),
                    _mesh(model, geom) if kind == "mesh" else None,
                )
            )
    return shapes


def _mesh(model: "mujoco.MjModel", geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) m and triangles of a geom's mesh, in the geom's frame."""
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return (
        model.mesh_vert[first : first + count].copy(),
        model.mesh_face[face : face + faces].copy(),
    )
