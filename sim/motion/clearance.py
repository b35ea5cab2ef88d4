"""Distance of the arm from table, body and itself, by coal on their true shapes."""

# coal, mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import coal
import mujoco
import numpy as np

from sim.motion.body_surface import BodySurface
from sim.robot.laboratory import Laboratory, Placement

BODY = "soft_body"
TIP = ("probe_tip", "tip_contact")
FIRST = 2  # base and first link, which turns upright, never come nearer to table or body
NEIGHBOURS = 2  # links so near to each other along the arm are not tested against each other
ARM_APART_M = 0.002
"""Parts of the arm that are nearer than this in its home pose overlap as they are drawn."""


@dataclass(frozen=True)
class _Part:
    """A shape of the scene, fixed to a body of the model (0 stands still)."""

    name: str
    body: int
    shape: coal.CollisionGeometry
    position_m: np.ndarray
    rotation: np.ndarray
    radius_m: float


class Clearance:
    """Smallest distance of the arm's moving parts from table, body and its own links.

    Parameters
    ----------
    laboratory : compiled scene
    surface : of the body, body frame
    body_in_world : where the body stands
    """

    def __init__(
        self, laboratory: Laboratory, surface: BodySurface, body_in_world: Placement
    ) -> None:
        model = self._model = laboratory.model
        self._data = mujoco.MjData(model)
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        parts = list(_parts(model))
        self._arm = [part for part in parts if _joints_below(model, part.body) > 0]
        fixed = [part for part in parts if part.name.startswith(("table", "obstacle_"))]
        corners = body_in_world.points_to_world(surface.vertices_m)
        middle = corners.mean(axis=0)
        mesh = _mesh(BodySurface(corners - middle, surface.triangles))
        reach = float(np.linalg.norm(corners - middle, axis=1).max())
        fixed.append(_Part(BODY, 0, mesh, middle, np.eye(3), reach))
        self._all = self._arm + fixed
        self._radii = np.array([part.radius_m for part in self._all])
        links = np.array([_joints_below(model, part.body) for part in self._all])
        arm = len(self._arm)
        pairs = [
            (i, k)
            for i in range(arm)
            for k in range(i + 1, len(self._all))
            if (links[i] > FIRST if k >= arm else abs(links[i] - links[k]) > NEIGHBOURS)
        ]
        self._pairs = np.array(pairs)
        home = self._distances(laboratory.home, self._pairs, 1.0)
        apart = {i for i, distance in home if distance < ARM_APART_M and pairs[i][1] < arm}
        self._pairs = np.array([pair for i, pair in enumerate(pairs) if i not in apart])
        tip = [i for i, part in enumerate(self._all) if part.name in TIP]
        self._without_tip = self._pairs[
            ~(np.isin(self._pairs[:, 0], tip) & (self._pairs[:, 1] >= arm))
        ]

    def nearest(
        self, q: np.ndarray, tip_may_touch: bool = False, within_m: float = 0.05
    ) -> tuple[float, str, str]:
        """Smallest distance (m, negative inside), the arm's part and the obstacle.

        Parameters
        ----------
        q : (n,) rad
        tip_may_touch : leave the tip's distance from body and table out, as it is meant to press
        within_m : larger distances are returned as this number
        """
        pairs = self._without_tip if tip_may_touch else self._pairs
        best = (within_m, "", "")
        for i, distance in self._distances(q, pairs, within_m):
            if distance < best[0]:
                one, other = pairs[i]
                best = (distance, self._all[one].name, self._all[other].name)
        return best

    def _distances(
        self, q: np.ndarray, pairs: np.ndarray, within_m: float
    ) -> Iterator[tuple[int, float]]:
        """Numbers of the pairs that may be nearer than a distance, with their distances."""
        data = self._data
        data.qpos[: len(q)] = q
        mujoco.mj_kinematics(self._model, data)
        turns = [data.xmat[part.body].reshape(3, 3) for part in self._all]
        places = np.array([
            data.xpos[part.body] + turn @ part.position_m
            for part, turn in zip(self._all, turns, strict=True)
        ])  # fmt: skip
        away = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
        near = away - self._radii[pairs].sum(axis=1) < within_m
        poses = {}
        for i in np.flatnonzero(near):
            for k in pairs[i]:
                if k not in poses:
                    poses[k] = coal.Transform3s(turns[k] @ self._all[k].rotation, places[k])
            one, other = pairs[i]
            self._result.clear()
            distance = coal.distance(
                self._all[one].shape,
                poses[one],
                self._all[other].shape,
                poses[other],
                self._request,
                self._result,
            )
            yield int(i), float(distance)


def _parts(model: mujoco.MjModel) -> Iterator[_Part]:
    """Solid shapes of the model, the body's own and moved planes left out."""
    for geom in range(model.ngeom):
        shape, name = _shape(model, geom), model.geom(geom).name
        if shape is None or name == BODY:
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        yield _Part(
            name,
            int(model.geom_bodyid[geom]),
            shape,
            model.geom_pos[geom].copy(),
            rotation.reshape(3, 3),
            float(model.geom_rbound[geom]),
        )


def _joints_below(model: mujoco.MjModel, body: int) -> int:
    """Return 0 for what belongs to the world, 1 for the arm's base, one more for each joint."""
    if body == 0:
        return 0
    joints, top = 0, body
    while body:
        joints, top, body = (
            joints + int(model.body_dofnum[body]),
            body,
            int(model.body_parentid[body]),
        )
    arm = any(model.body_rootid[b] == top for b in range(model.nbody) if model.body_dofnum[b])
    return joints + 1 if arm else 0


def _shape(model: mujoco.MjModel, geom: int) -> coal.CollisionGeometry | None:
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return coal.Sphere(float(size[0]))
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return coal.Capsule(float(size[0]), 2 * float(size[1]))
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return coal.Cylinder(float(size[0]), 2 * float(size[1]))
        case mujoco.mjtGeom.mjGEOM_BOX:
            return coal.Box(*(2 * float(edge) for edge in size))
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _model_mesh(model, int(model.geom_dataid[geom]))
    return None


def _model_mesh(model: mujoco.MjModel, mesh: int) -> coal.CollisionGeometry:
    """Convex hull of a mesh of the model, as MuJoCo collides it."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    solid = _mesh(
        BodySurface(
            model.mesh_vert[first : first + count].astype(float),
            model.mesh_face[face : face + faces].astype(int),
        )
    )
    solid.buildConvexHull(True, "Qt")
    return solid.convex


def _mesh(surface: BodySurface) -> coal.BVHModelOBBRSS:
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(surface.triangles), len(surface.vertices_m))
    mesh.addVertices(np.asfortranarray(surface.vertices_m))
    mesh.addTriangles(np.asfortranarray(surface.triangles))
    mesh.endModel()
    return mesh
