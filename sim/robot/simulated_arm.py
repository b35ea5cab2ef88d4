"""The simulated arm, one step at a time: computed-torque servo, MuJoCo step, wrist force sensor.

Order within a step: the servo sees position q and velocity v, MuJoCo advances by one whole
`mj_step`, and the readings of sensors and contact then belong to q and v, not to the new
position. A whole step is taken, and never the halves `mj_step1`, `mj_step2`: after the first half
the list of contacts is new and their forces are still the old ones, which shows as a spike at
touch-down.
"""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import mujoco
import numpy as np

from sim.robot.arm_steps import (
    BLOCK,
    NOW,
    OF_JOINTS,
    ArmState,
    force_by_torque,
    read_wrist,
    servo_step,
)
from sim.robot.laboratory import Laboratory
from sim.robot.mechanism import Live, Mechanisms
from sim.robot.rigid_chain import rigid_chain

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
        model = laboratory.physics
        mechanisms.change(model)
        self._sensor, self._encoders = mechanisms.sensor, mechanisms.encoders
        self._joint_torque = mechanisms.joint_torque
        self.hooked = bool(self._sensor or self._encoders or self._joint_torque)
        self._offset: np.ndarray | None = None
        self._compared = not mechanisms.servo_by_motors
        self.laboratory, self.model = laboratory, model
        self.data = mujoco.MjData(model)
        self.dt = float(model.opt.timestep)
        self._force_noise, self._rng = force_noise_n, rng
        self.state = self._new_state()
        self.by_motors, self.live = False, Live()
        self.place(laboratory.home)

    def _new_state(self) -> ArmState:
        laboratory, model, data = self.laboratory, self.model, self.data
        arm = laboratory.arm
        wrist = arm.frames[arm.getFrameId("ft")]

        def sensor(name: str, size: int) -> np.ndarray:
            first = int(model.sensor(name).adr[0])
            return data.sensordata[first : first + size]

        self._raw_torque = sensor("ft_torque", 3)
        now = np.zeros(1, NOW)
        now["drawn"] = BLOCK
        return ArmState(
            model._address,
            data._address,
            rigid_chain(arm, laboratory.tool),
            self.dt,
            model.dof_damping.copy(),
            data.qpos,
            data.qvel,
            data.ctrl,
            data.site_xpos[model.site("tcp").id],
            sensor("ft_force", 3),
            sensor("touch", 1),
            data.warning.number,
            wrist.placement.rotation.T.copy(),
            np.array(arm.effortLimit),
            4 * laboratory.acceleration_limit,
            **dict(zip(OF_JOINTS, np.zeros((len(OF_JOINTS), model.nv)), strict=True)),
            raw_noise_n=np.zeros((BLOCK, 3)),
            sensor_n=np.zeros(3),
            wrist_n=np.zeros(3),
            tare_n=np.zeros(3),
            now=now,
        )

    def place(self, q: np.ndarray) -> None:
        """Put the arm at rest at a configuration (n,) rad."""
        self.data.qpos[:] = q
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        arm = self.state
        for part in (arm.q, arm.q_seen, arm.q_read, arm.read):
            part[:] = self.data.qpos
        for part in (arm.v, arm.v_seen, arm.a, arm.torque, arm.behind, arm.wrist_n, arm.sensor_n):
            part[:] = 0.0
        arm.now["contact_n"] = 0.0

    def recover(self, q: np.ndarray) -> None:
        """Begin anew at a configuration (n,) rad after the simulation became unstable."""
        mujoco.mj_resetData(self.model, self.data)
        self.place(q)

    def tare(self, mean_n: np.ndarray) -> None:
        """Take the mean (3,) N of readings without contact off all later ones."""
        self.state.tare_n[:] += mean_n

    def __getattr__(self, name: str) -> np.ndarray:
        if name in ("q", "v", "q_seen", "q_read", "tip_m", "sensor_n", "wrist_n", "tare_n"):
            return getattr(self.state, name)
        raise AttributeError(name)

    @property
    def time_s(self) -> float:
        """Since the simulation began."""
        return float(self.state.now["time_s"][0])

    @property
    def contact_n(self) -> float:
        """True contact force during the last step, N."""
        return float(self.state.now["contact_n"][0])

    @property
    def unstable(self) -> bool:
        """True once MuJoCo has warned of a state without meaning."""
        return bool(self.state.warnings.any())

    def force_by_torque(self, lever: np.ndarray) -> float:
        """Contact force in N that the joints' torques of the last step show.

        Parameters
        ----------
        lever : (n,) m, the tip's Jacobian along the press direction
        """
        return force_by_torque(self.state, lever, np.zeros_like(lever))

    @property
    def behind_rad(self) -> float:
        """Largest difference between a joint's command and its reading in the last step."""
        return float(np.abs(self.state.behind).max())

    @property
    def apart_rad(self) -> float:
        """Largest change between a joint's reading and its motor's since the first step.

        Encoders that serve the pose alone are not compared.
        """
        if self._offset is None or not self._compared:
            return 0.0
        return float(np.abs(self.q_read - self.q_seen - self._offset).max())

    @property
    def peak_torque(self) -> float:
        """Largest part of a joint's torque limit that was used."""
        return float((self.state.peak / self.state.limit).max())

    def step(
        self, q_wanted: np.ndarray, v_wanted: np.ndarray, a_wanted: np.ndarray | float = 0.0
    ) -> None:
        """Servo towards a configuration, velocity and acceleration for one time step."""
        arm = self.state
        arm.goal_q[:], arm.goal_v[:], arm.goal_a[:] = q_wanted, v_wanted, a_wanted
        self.renew_noise()
        self.look_at_joints()
        servo_step(arm, self.has_encoders)
        self.look_at_sensor()
        read_wrist(arm)

    def renew_noise(self) -> None:
        """Draw the noise of the next steps if it is used up."""
        if self.state.now["drawn"][0] == BLOCK:
            noise = self._rng.standard_normal((BLOCK, 3))
            self.state.raw_noise_n[:] = self._force_noise * noise
            self.state.now["drawn"] = 0

    @property
    def has_encoders(self) -> bool:
        """True if mechanisms act on the encoders."""
        return self._encoders is not None

    def look_at_joints(self) -> None:
        """Read the encoders before a step, and let torques beside the motors' act."""
        arm = self.state
        arm.q_read[:] = arm.read[:] = arm.q
        if self._encoders:
            arm.q_read[:] = self._encoders(self.time_s, arm.q.copy())
            if self._offset is None:
                self._offset = arm.q_read - arm.q
            if not self.by_motors and np.isfinite(arm.q_read).all():
                arm.read[:] = arm.q_read
        if self._joint_torque:
            self.data.qfrc_applied[:] = self._joint_torque(self.time_s, arm.q.copy())

    def look_at_sensor(self) -> None:
        """Let mechanisms act on the sensor's reading after a step."""
        arm = self.state
        self.live.contact_n = self.contact_n
        if self._sensor:
            wrench = np.concatenate([arm.sensor_n, self._raw_torque])
            arm.sensor_n[:] = self._sensor(self.time_s, wrench)[:3]
