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
from sim.robot.mechanism import Live, Mechanisms

SERVO_RAD_PER_S = 60.0
"""Both poles of the joint servo."""

BLOCK = 4096

mujoco.set_mju_user_warning(lambda text: None)  # `unstable` tells; MuJoCo would write a log file


class SimulatedArm:
    """Arm in motion.

    Parameters
    ----------
    laboratory : the compiled scene
    force_noise_n : standard deviation of each component of the wrist's force, a sample
    rng : source of that noise
    mechanisms : that act on sensor, encoders, joints and scene, unknown to the robot

    Attributes
    ----------
    q, v : (n,) rad and rad/s, the state now
    q_seen : (n,) rad, configuration of the last step, to which its sensors and contact belong
    q_read : (n,) rad, the same as the encoders read it
    by_motors : true while the servo goes by the motors' own encoders, as it does where those at the
        joints give no number
    live : tells the mechanisms the true contact force
    tare_n : (3,) N, taken off the wrist's force
    sensor_n : (3,) N, what the sensor itself read, with the probe's weight and inertia in it
    time_s : since the simulation began
    tip_m : (3,) m, centre of the tip in the world during the last step
    wrist_n : (3,) N, measured force of the tip on the body during the last step, axes of the
        probe; the probe's weight and inertia are taken out by the model from measured q, v and
        acceleration
    contact_n : N, true contact force during the last step
    """

    def __init__(
        self,
        laboratory: Laboratory,
        force_noise_n: float,
        rng: np.random.Generator,
        mechanisms: Mechanisms | None = None,
    ) -> None:
        mechanisms = mechanisms or Mechanisms()
        model = laboratory.model
        mechanisms.change(model)
        self._sensor, self._encoders = mechanisms.sensor, mechanisms.encoders
        self._joint_torque = mechanisms.joint_torque
        self._offset: np.ndarray | None = None
        self._compared = not mechanisms.servo_by_motors
        self.laboratory, self.model = laboratory, model
        self.data = mujoco.MjData(model)
        self.dt = float(model.opt.timestep)
        self._arm, self._tool = laboratory.arm, laboratory.tool
        self._arm_data, self._tool_data = self._arm.createData(), self._tool.createData()
        self._damping = model.dof_damping.copy()
        self._limit = np.array(self._arm.effortLimit)
        self._hardest = 4 * laboratory.acceleration_limit
        wrist = self._arm.frames[self._arm.getFrameId("ft")]
        self._joint, self._to_probe = wrist.parentJoint, wrist.placement.rotation.T.copy()
        force, torque = (int(model.sensor(name).adr[0]) for name in ("ft_force", "ft_torque"))
        self._raw = self.data.sensordata[force : force + 3]
        self._raw_torque = self.data.sensordata[torque : torque + 3]
        self._warnings = self.data.warning.number
        self._tip = self.data.site_xpos[model.site("tcp").id]
        self._force_noise, self._rng = force_noise_n, rng
        self._noise, self._drawn = np.zeros((BLOCK, 3)), BLOCK
        self._qpos, self._qvel, self._ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self._peak = np.zeros(model.nv)
        self.tare_n = np.zeros(3)
        self.time_s, self.by_motors, self.live = 0.0, False, Live()
        self.place(laboratory.home)

    def place(self, q: np.ndarray) -> None:
        """Put the arm at rest at a configuration (7,) rad."""
        self.data.qpos[:] = q
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        self.q, self.v = self.data.qpos.copy(), self.data.qvel.copy()
        self.q_seen = self.q_read = self.q
        self._v_seen = self.v
        self._a = np.zeros_like(self.v)
        self._torque, self._behind = np.zeros_like(self.v), np.zeros_like(self.v)
        self.tip_m = self._tip
        self.wrist_n, self.sensor_n, self.contact_n = np.zeros(3), np.zeros(3), 0.0

    def recover(self, q: np.ndarray) -> None:
        """Begin anew at a configuration (n,) rad after the simulation became unstable."""
        mujoco.mj_resetData(self.model, self.data)
        self.place(q)

    def tare(self, mean_n: np.ndarray) -> None:
        """Take the mean (3,) N of readings without contact off all later ones."""
        self.tare_n = self.tare_n + mean_n

    @property
    def unstable(self) -> bool:
        """True once MuJoCo has warned of a state without meaning."""
        return bool(self._warnings.any())

    def force_by_torque(self, lever: np.ndarray) -> float:
        """Contact force in N that the joints' torques of the last step show.

        Parameters
        ----------
        lever : (n,) m, the tip's Jacobian along the press direction
        """
        q, v = self.q_seen, self._v_seen
        free = pin.rnea(self._arm, self._arm_data, q, v, self._a) + self._damping * v
        return float(lever @ (self._torque - free) / (lever @ lever))

    @property
    def behind_rad(self) -> float:
        """Largest difference between a joint's command and its reading in the last step."""
        return float(np.abs(self._behind).max())

    @property
    def apart_rad(self) -> float:
        """Largest change between a joint's reading and its motor's since the first step.

        Encoders that serve the pose alone are not compared.
        """
        if self._offset is None or not self._compared:
            return 0.0
        return float(np.abs(self.q_read - self.q_seen - self._offset).max())

    @property
    def torque_share(self) -> float:
        """Largest part of a joint's torque limit that the last step asked for."""
        return float((np.abs(self._torque) / self._limit).max())

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
        read = q
        if self._encoders:
            self.q_read = self._encoders(self.time_s, q.copy())
            if self._offset is None:
                self._offset = self.q_read - q
            if not self.by_motors and np.isfinite(self.q_read).all():
                read = self.q_read
        else:
            self.q_read = q
        if self._joint_torque:
            data.qfrc_applied[:] = self._joint_torque(self.time_s, q)
        wanted = a_wanted + (gain * gain) * (q_wanted - read) + (2 * gain) * (v_wanted - v)
        if self._encoders:  # a plan stays below; a reading that jumps would not
            np.clip(wanted, -self._hardest, self._hardest, out=wanted)
        torque = pin.rnea(self._arm, self._arm_data, read, v, wanted) + self._damping * v
        self._ctrl[:] = torque
        mujoco.mj_step(self.model, data)
        q_next, v_next = self._qpos.copy(), self._qvel.copy()
        self.contact_n = float(data.efc_force[-1]) if data.ncon else 0.0
        self.live.contact_n = self.contact_n
        self._a = (v_next - v) / self.dt
        self.wrist_n = self._contact_from_wrist(read, v, self._a)
        self.q_seen, self._v_seen, self.q, self.v = q, v, q_next, v_next
        self._torque, self._behind = torque, q_wanted - read
        self.time_s += self.dt
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
        read = self._raw + noise
        if self._sensor:
            read = self._sensor(self.time_s, np.concatenate([read, self._raw_torque]))[:3]
        self.sensor_n = read
        return read - own - self.tare_n
