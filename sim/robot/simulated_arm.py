"""The simulated arm, one step at a time: computed-torque servo, MuJoCo step, wrist force sensor.

Order within a step: the servo sees position q and velocity v, MuJoCo advances by one whole
`mj_step`, and the readings of sensors and contact then belong to q and v, not to the new
position. A whole step is taken, and never the halves `mj_step1`, `mj_step2`: after the first half
the list of contacts is new and their forces are still the old ones, which shows as a spike at
touch-down.
"""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from sim.robot.laboratory import Laboratory

SERVO_RAD_PER_S = 60.0
"""Both poles of the joint servo."""

BLOCK = 4096


class SimulatedArm:
    """Arm in motion.

    Parameters
    ----------
    laboratory : the compiled scene
    force_noise_n : standard deviation of each component of the wrist's force, a sample
    rng : source of that noise

    Attributes
    ----------
    q, v : (7,) rad and rad/s, the state now
    q_seen : (7,) rad, configuration of the last step, to which its sensors and contact belong
    tip_m : (3,) m, centre of the tip in the world during the last step
    wrist_n : (3,) N, measured force of the tip on the body during the last step, axes of the
        probe; the probe's weight and inertia are taken out by the model from measured q, v and
        acceleration
    contact_n : N, true contact force during the last step
    """

    def __init__(
        self, laboratory: Laboratory, force_noise_n: float, rng: np.random.Generator
    ) -> None:
        model = laboratory.model
        self.laboratory, self.model = laboratory, model
        self.data = mujoco.MjData(model)
        self.dt = float(model.opt.timestep)
        self._arm, self._tool = laboratory.arm, laboratory.tool
        self._arm_data, self._tool_data = self._arm.createData(), self._tool.createData()
        self._damping = model.dof_damping.copy()
        self._limit = np.array(self._arm.effortLimit)
        wrist = self._arm.frames[self._arm.getFrameId("ft")]
        self._joint, self._to_probe = wrist.parentJoint, wrist.placement.rotation.T.copy()
        start = int(model.sensor("ft_force").adr[0])
        self._raw = self.data.sensordata[start : start + 3]
        self._tip = self.data.site_xpos[model.site("tcp").id]
        self._force_noise, self._rng = force_noise_n, rng
        self._noise, self._drawn = np.zeros((BLOCK, 3)), BLOCK
        self._qpos, self._qvel, self._ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self._peak = np.zeros(model.nv)
        self.place(laboratory.home)

    def place(self, q: np.ndarray) -> None:
        """Put the arm at rest at a configuration (7,) rad."""
        self.data.qpos[:] = q
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        self.q, self.v = self.data.qpos.copy(), self.data.qvel.copy()
        self.q_seen = self.q
        self.tip_m = self._tip
        self.wrist_n, self.contact_n = np.zeros(3), 0.0

    @property
    def peak_torque(self) -> float:
        """Largest part of a joint's torque limit that was used."""
        return float((self._peak / self._limit).max())

    def step(
        self, q_wanted: np.ndarray, v_wanted: np.ndarray, a_wanted: np.ndarray | float = 0.0
    ) -> None:
        """Servo towards a configuration, velocity and acceleration for one time step."""
        q, v, data = self.q, self.v, self.data
        gain = SERVO_RAD_PER_S
        wanted = a_wanted + (gain * gain) * (q_wanted - q) + (2 * gain) * (v_wanted - v)
        torque = pin.rnea(self._arm, self._arm_data, q, v, wanted) + self._damping * v
        self._ctrl[:] = torque
        mujoco.mj_step(self.model, data)
        q_next, v_next = self._qpos.copy(), self._qvel.copy()
        self.contact_n = float(data.efc_force[-1]) if data.ncon else 0.0
        self.wrist_n = self._contact_from_wrist(q, v, (v_next - v) / self.dt)
        self.q_seen, self.q, self.v = q, q_next, v_next
        np.maximum(self._peak, np.abs(torque), out=self._peak)

    def _contact_from_wrist(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Force of the tip on the body: raw wrist force less the probe's weight and inertia."""
        pin.rnea(self._tool, self._tool_data, q, v, a)
        own = self._to_probe @ self._tool_data.f[self._joint].linear
        if self._drawn == BLOCK:
            self._noise = self._force_noise * self._rng.standard_normal((BLOCK, 3))
            self._drawn = 0
        noise = self._noise[self._drawn]
        self._drawn += 1
        return self._raw - own + noise
