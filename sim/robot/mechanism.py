"""Mechanisms in the loop, unknown to the robot: hooks at sensor, encoders, joints, body and clock.

A mechanism is planted where it acts: the arm is moved by it, the force control reacts to it and the
body answers it. Each hook is a function, or None where the mechanism does not act.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models import InputError, kinds_checked

if TYPE_CHECKING:
    from sim.robot.contact_coupling import PressedBody

Zero = Literal["touch", "plane"]
"""From where travel counts: first touch as found from the samples, or the planned surface."""

Tare = Literal["press", "scan", "never"]
"""When the force sensor is tared: before each approach, before the first one alone, or never."""
TARES: tuple[Tare, ...] = ("press", "scan", "never")


@dataclass
class Live:
    """Truth of the running scan, for mechanisms that depend on it; renewed in each step.

    Attributes
    ----------
    press : number of the press
    touched : true from first touch to the end of unloading
    contact_n : true contact force
    first_approach_s : when the first approach of the scan began, infinite before
    depth_of : (q) to the tip's depth along the press, m
    slope_of : (depth) to the turn of the joints for a metre of depth, (n,) rad/m
    """

    press: int = 0
    touched: bool = False
    contact_n: float = 0.0
    first_approach_s: float = math.inf
    depth_of: Callable[[np.ndarray], float] = lambda q: 0.0
    slope_of: Callable[[float], np.ndarray] = lambda depth: np.zeros(0)

    def since_first(self, time_s: float) -> float:
        """Time since the first approach began, 0 before."""
        return max(time_s - self.first_approach_s, 0.0)


@kinds_checked
@dataclass(frozen=True)
class Mechanism:
    """One mechanism or fault; times are true seconds since the scan began.

    Attributes
    ----------
    name : in reports
    begin : (press, t), called when an attempt at a press begins
    sensor : (t, wrench) to the wrench that the sensor reads: (6,) N and N m at the sensor, axes of
        the probe, pressing positive; with the tool's weight and inertia in it
    encoders : (t, q) to the joint angles (n,) rad that servo and kinematics read
    joint_torque : (t, q) to the torques (n,) N m that act beside the motors
    body_pose : (t, press) to the shift (3,) m of the surface under the tip, world frame
    body : the pressed body to one that yields otherwise
    clock : t to the time that is written beside the samples
    scene : changes the compiled MuJoCo model, of which the robot's own model knows nothing
    attach : called once with the truth of the running scan
    servo_by_motors : the encoders are read for the pose alone, not by the servo
    zero, tare : how the robot that suffers from it counts travel and tares
    zero_shift_m : by which first touch is called too late, m

    Examples
    --------
    >>> import palpmap as pm
    >>> late = pm.Mechanism("slow clock", clock=lambda t: 0.99 * t)
    >>> late.clock(100.0), late.tare
    (99.0, 'press')
    """

    name: str
    begin: Callable[[int, float], None] | None = None
    sensor: Callable[[float, np.ndarray], np.ndarray] | None = None
    encoders: Callable[[float, np.ndarray], np.ndarray] | None = None
    joint_torque: Callable[[float, np.ndarray], np.ndarray] | None = None
    body_pose: Callable[[float, int], np.ndarray] | None = None
    body: Callable[[PressedBody], PressedBody] | None = None
    clock: Callable[[float], float] | None = None
    scene: Callable[[Any], None] | None = None
    attach: Callable[[Live], None] | None = None
    servo_by_motors: bool = False
    zero: Zero = "touch"
    tare: Tare = "press"
    zero_shift_m: float = 0.0


@dataclass(frozen=True)
class Mechanisms:
    """All mechanisms of a scan, in the order in which they act on one reading."""

    parts: tuple[Mechanism, ...] = ()

    def begin(self, press: int, time_s: float) -> None:
        """Tell all of them that an attempt at a press begins."""
        for part in self.parts:
            if part.begin:
                part.begin(press, time_s)

    @property
    def sensor(self) -> Callable[[float, np.ndarray], np.ndarray] | None:
        """One after the other; None if none acts on the sensor."""
        return _chain([part.sensor for part in self.parts if part.sensor], "sensor", 6)

    @property
    def encoders(self) -> Callable[[float, np.ndarray], np.ndarray] | None:
        """One after the other; None if none acts on the encoders."""
        return _chain([part.encoders for part in self.parts if part.encoders], "encoders", None)

    @property
    def joint_torque(self) -> Callable[[float, np.ndarray], np.ndarray] | None:
        """Sum of the torques; None if there are none."""
        return _total([part.joint_torque for part in self.parts if part.joint_torque])

    @property
    def body_pose(self) -> Callable[[float, int], np.ndarray] | None:
        """Sum of the shifts; None if the body stays in its place."""
        return _total([part.body_pose for part in self.parts if part.body_pose])

    def pressed(self, body: PressedBody) -> PressedBody:
        """Return the body with all that makes it yield otherwise."""
        for part in self.parts:
            if part.body:
                body = part.body(body)
        return body

    def clock(self, time_s: float) -> float:
        """Time that is written beside a sample."""
        for part in self.parts:
            if part.clock:
                time_s = float(part.clock(time_s))
        return time_s

    @property
    def has_clock(self) -> bool:
        """True if the written times differ from the true ones."""
        return any(part.clock for part in self.parts)

    def change(self, model: Any) -> None:
        """Change the compiled model of the scene."""
        for part in self.parts:
            if part.scene:
                part.scene(model)

    @property
    def zero(self) -> Zero:
        """The planned surface if any of them needs it."""
        return "plane" if any(part.zero == "plane" for part in self.parts) else "touch"

    @property
    def tare(self) -> Tare:
        """The rarest that any of them needs."""
        return TARES[max((TARES.index(part.tare) for part in self.parts), default=0)]

    def attach(self, live: Live) -> None:
        """Let those that depend on it see the truth."""
        for part in self.parts:
            if part.attach:
                part.attach(live)

    @property
    def servo_by_motors(self) -> bool:
        """True if any of them is read for the pose alone."""
        return any(part.servo_by_motors for part in self.parts)

    @property
    def zero_shift_m(self) -> float:
        """Sum of the shifts of first touch."""
        return sum(part.zero_shift_m for part in self.parts)


def _chain(hooks: Sequence[Callable], name: str, size: int | None) -> Callable | None:
    if not hooks:
        return None

    def act(time_s: float, values: np.ndarray) -> np.ndarray:
        wanted = size or len(values)
        for hook in hooks:
            values = np.asarray(hook(time_s, values), float)
            if values.shape != (wanted,):
                raise InputError(
                    f"The planted {name}(t, ...) returned an array of shape {values.shape}; "
                    f"expected ({wanted},)."
                )
        return values

    return act


def _total(hooks: Sequence[Callable]) -> Callable | None:
    if not hooks:
        return None
    return lambda time_s, other: sum(np.asarray(hook(time_s, other), float) for hook in hooks)
