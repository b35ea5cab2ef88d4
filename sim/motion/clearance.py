"""Distance of the arm from table and body, from MuJoCo's geometry."""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import mujoco
import numpy as np

FIXED = ("link0", "link1")  # stand on the table and cannot come nearer


class Clearance:
    """Smallest distance of the arm's moving parts from table and body.

    Parameters
    ----------
    model : the laboratory's compiled model
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._obstacles = [model.geom(name).id for name in ("table", "soft_body")]
        self._tip = {model.geom(name).id for name in ("probe_tip", "tip_contact")}
        self._moving = [
            g
            for g in range(model.ngeom)
            if model.body(model.geom_bodyid[g]).name.startswith(("link", "probe"))
            and model.body(model.geom_bodyid[g]).name not in FIXED
        ]

    def nearest(
        self, q: np.ndarray, tip_may_touch: bool = False, within_m: float = 0.05
    ) -> tuple[float, str, str]:
        """Smallest distance (m, negative inside), the arm's part and the obstacle.

        Parameters
        ----------
        q : (7,) rad
        tip_may_touch : leave the tip out, as it is meant to press
        within_m : larger distances are returned as this number
        """
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        best = (within_m, "", "")
        for geom in self._moving:
            if tip_may_touch and geom in self._tip:
                continue
            for obstacle in self._obstacles:
                distance = mujoco.mj_geomDistance(
                    self._model, self._data, geom, obstacle, within_m, None
                )
                if distance < best[0]:
                    best = (
                        float(distance),
                        self._model.geom(geom).name,
                        self._model.geom(obstacle).name,
                    )
        return best
