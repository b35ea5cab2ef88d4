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

from typing import NamedTuple

import mujoco
import numpy as np

from sim.robot.compiled import compiled
from sim.robot.laboratory import Laboratory
from sim.robot.mechanism import Live, Mechanisms
from sim.robot.mujoco_library import mj_step
from sim.robot.rigid_chain import Chain, inverse_dynamics, rigid_chain, tool_force

SERVO_RAD_PER_S = 60.0
"""Both poles of the joint servo."""

BLOCK = 4096

NOW = np.dtype([("time_s", float), ("contact_n", float), ("drawn", np.int64)])
"""Time since the simulation began, true contact force of the last step, used rows of noise."""

OF_JOINTS = (
    "goal_q", "goal_v", "goal_a", "q", "v", "q_seen", "v_seen", "q_read", "read", "a", "torque",
    "behind", "peak",
)  # fmt: skip

mujoco.set_mju_user_warning(lambda text: None)  # `unstable` tells; MuJoCo would write a log file


class ArmState(NamedTuple):
    """The arm in motion, as the compiled steps see it; arrays are (n,) if nothing is said.

    Attributes
    ----------
    model, data : addresses of MuJoCo's model and data
    chain, damping : of the robot's own model
    dt : s
    qpos, qvel, ctrl, tip_m, raw_n, touch_n, warnings : MuJoCo's own memory
    to_probe : (3, 3), from the last joint's frame to the probe's axes
    limit, hardest : of torque, and of acceleration where encoders may jump
    goal_q, goal_v, goal_a : what the servo goes to
    q, v : the state now
    q_seen, v_seen, q_read, read, a, torque, behind : of the last step, see `SimulatedArm`; by
        `read` the servo went
    peak : largest torques so far
    raw_noise_n : (BLOCK, 3)
    sensor_n, wrist_n, tare_n : (3,)
    now : (1,) of `NOW`
    """

    model: int
    data: int
    chain: Chain
    dt: float
    damping: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    tip_m: np.ndarray
    raw_n: np.ndarray
    touch_n: np.ndarray
    warnings: np.ndarray
    to_probe: np.ndarray
    limit: np.ndarray
    hardest: np.ndarray
    goal_q: np.ndarray
    goal_v: np.ndarray
    goal_a: np.ndarray
    q: np.ndarray
    v: np.ndarray
    q_seen: np.ndarray
    v_seen: np.ndarray
    q_read: np.ndarray
    read: np.ndarray
    a: np.ndarray
    torque: np.ndarray
    behind: np.ndarray
    peak: np.ndarray
    raw_noise_n: np.ndarray
    sensor_n: np.ndarray
    wrist_n: np.ndarray
    tare_n: np.ndarray
    now: np.ndarray


@compiled
def servo_step(arm: ArmState, clipped: bool) -> None:
    """Servo by `read` towards the goal and advance MuJoCo by a step; `sensor_n` is the new reading.

    `clipped` : the acceleration is bounded. A plan stays below; a reading that jumps would not.
    """
    gain = SERVO_RAD_PER_S
    for i in range(len(arm.q)):
        arm.behind[i] = arm.goal_q[i] - arm.read[i]
        wanted = arm.goal_a[i] + (gain * gain) * arm.behind[i]
        wanted += (2 * gain) * (arm.goal_v[i] - arm.v[i])
        if clipped and not abs(wanted) <= arm.hardest[i] and wanted == wanted:
            wanted = arm.hardest[i] if wanted > 0 else -arm.hardest[i]
        arm.a[i] = wanted
    inverse_dynamics(arm.chain, arm.read, arm.v, arm.a, arm.torque)
    for i in range(len(arm.q)):
        arm.torque[i] += arm.damping[i] * arm.v[i]
        arm.ctrl[i] = arm.torque[i]
        arm.q_seen[i], arm.v_seen[i] = arm.q[i], arm.v[i]
        size = abs(arm.torque[i])
        if size > arm.peak[i]:
            arm.peak[i] = size
    mj_step(arm.model, arm.data)
    for i in range(len(arm.q)):
        arm.q[i], arm.v[i] = arm.qpos[i], arm.qvel[i]
        arm.a[i] = (arm.v[i] - arm.v_seen[i]) / arm.dt
    now = arm.now[0]
    now.contact_n = arm.touch_n[0]
    for k in range(3):
        arm.sensor_n[k] = arm.raw_n[k] + arm.raw_noise_n[now.drawn, k]
    now.drawn += 1


@compiled
def read_wrist(arm: ArmState) -> None:
    """End the step: the tip's force is the sensor's less the probe's weight and inertia."""
    own = tool_force(arm.chain, arm.read, arm.v_seen, arm.a)
    for k in range(3):
        part = arm.to_probe[k, 0] * own[0] + arm.to_probe[k, 1] * own[1]
        part += arm.to_probe[k, 2] * own[2]
        arm.wrist_n[k] = arm.sensor_n[k] - part - arm.tare_n[k]
    arm.now[0].time_s += arm.dt


@compiled
def force_by_torque(arm: ArmState, lever: np.ndarray, free: np.ndarray) -> float:
    """See `SimulatedArm.force_by_torque`; `free` is room for (n,) torques."""
    inverse_dynamics(arm.chain, arm.q_seen, arm.v_seen, arm.a, free)
    force = length = 0.0
    for i in range(len(lever)):
        force += lever[i] * (arm.torque[i] - free[i] - arm.damping[i] * arm.v_seen[i])
        length += lever[i] * lever[i]
    return force / length


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
