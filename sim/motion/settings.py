"""Settings of a scan: times, speeds, noise, sampling."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from models import InputError, kinds_checked

FORCE_ERROR = 0.0025
"""Standard deviation of a held force by the sensor's noise, of the set one."""

LONGEST_HOLD_S = 10.0


@kinds_checked
@dataclass(frozen=True)
class ScanSettings:
    """Settings of the scan program; SI units.

    Attributes
    ----------
    seed : of all noise and of the pauses
    force_noise_n, displacement_noise_m : one standard deviation of a sample's force (each
        component) and of its displacement
    ramp_s, hold_s, unload_s : duration of the three parts of a press; ramp and unloading take
        longer where the arm could not speed up and slow down in that time, the hold where the force
        is weak, see `hold_of`
    load_samples, hold_samples, unload_samples : rows of the scan a press, evenly over each part
    pause_s : shortest and longest pause between two presses, drawn at random
    lift_m : height of the tip above the surface between presses
    approach_m_per_s, touch_m_per_s : speed of the tip far from the surface and within `slow_m` of
        it
    touch_force_n : measured force at which the robot says that it touches
    residual : part of the set force at which unloading ends, so that the tip is still in contact
    stiffness_n_per_m : the robot's first guess of the body's stiffness; it learns better ones as
        it presses
    depth_m : largest depth, None for 30 mm a newton of set force and at least 20 mm
    deepest_share : largest depth that a press may be expected to reach, of the body's thickness
        along it; at most 1, where the tip has come through the body
    force_limit_n : measured force at which a press is broken off, None for twice its set force and
        0.5 N
    on_fault : what follows a press that cannot be made or is broken off: "skip" goes on with the
        next one, "retry" tries it twice more before, "stop" ends the scan
    tip_change_s : the arm stands at home while a tip is changed
    friction : coefficient of friction between tip and body; a push further from the surface's
        normal than it holds is refused
    arm : name of an arm of palpmap, or its folder, see `models.read_arm`
    obstacles : boxes that the arm keeps clear of: edges and centre, (3,) m each, world frame
    timestep_s : of simulation and control
    frames_per_s : rate of the frames handed to `on_frame`

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.ScanSettings(hold_s=5.0).hold_s
    5.0
    """

    seed: int = 0
    force_noise_n: float = 5e-3
    displacement_noise_m: float = 2e-5
    ramp_s: float = 1.0
    hold_s: float = 2.0
    unload_s: float = 1.0
    load_samples: int = 8
    hold_samples: int = 8
    unload_samples: int = 6
    pause_s: tuple[float, float] = (0.1, 0.7)
    lift_m: float = 0.005
    slow_m: float = 0.0005
    approach_m_per_s: float = 0.02
    touch_m_per_s: float = 0.0015
    touch_force_n: float = 0.025
    residual: float = 0.06
    stiffness_n_per_m: float = 150.0
    depth_m: float | None = None
    deepest_share: float = 0.5
    force_limit_n: float | None = None
    on_fault: Literal["skip", "retry", "stop"] = "skip"
    tip_change_s: float = 10.0
    friction: float = 0.6
    arm: str = "panda"
    obstacles: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = ()
    timestep_s: float = 0.002
    frames_per_s: float = 25.0

    def __post_init__(self) -> None:
        may_be_zero = ("seed", "force_noise_n", "displacement_noise_m")
        for field in fields(self):
            value = getattr(self, field.name)
            if (
                field.name in (*may_be_zero, "pause_s", "on_fault", "arm", "obstacles")
                or value is None
            ):
                continue
            if not value > 0:
                raise InputError(
                    f"The scan setting {field.name} is {value}; it has to be positive."
                )
        for name in may_be_zero:
            if getattr(self, name) < 0:
                raise InputError(f"The scan setting {name} is negative; give zero or more.")
        if not 0 <= self.pause_s[0] <= self.pause_s[1]:
            raise InputError(
                f"The scan setting pause_s is {self.pause_s}; give the shortest and the "
                "longest pause in s."
            )
        if self.on_fault not in ("skip", "retry", "stop"):
            raise InputError(
                f"The scan setting on_fault is '{self.on_fault}'; give skip, retry or stop."
            )
        if self.deepest_share > 1:
            raise InputError(
                f"The scan setting deepest_share is {self.deepest_share:g}; give at most 1, the "
                "whole thickness of the body."
            )
        if self.touch_force_n < 4.5 * self.force_noise_n:
            raise InputError(
                f"A touch force of {self.touch_force_n:g} N is lost in a force noise of "
                f"{self.force_noise_n:g} N; set touch_force_n to five times the noise or more."
            )

    def streams(self) -> tuple[np.random.SeedSequence, ...]:
        """Seeds of the wrist's noise, of the encoders' noise, and of the pauses."""
        return tuple(np.random.SeedSequence(self.seed).spawn(3))

    def pauses(self, count: int) -> np.ndarray:
        """Rests before the presses of a plan without a program, (j,) s."""
        return np.random.default_rng(self.streams()[2]).uniform(*self.pause_s, size=count)

    def hold_of(self, force_n: float) -> float:
        """Duration of the hold at a set force without a program, s.

        The control follows the sensor: the mean over the second half of the hold, by which a press
        is judged, is off by the noise's own mean. A weak press is held until that is `FORCE_ERROR`
        of its force, but no longer than `LONGEST_HOLD_S`.
        """
        noise = self.force_noise_n * math.sqrt(self.timestep_s)
        enough = 2 * (noise / (FORCE_ERROR * force_n)) ** 2
        return max(self.hold_s, min(enough, LONGEST_HOLD_S))

    def largest_depth(self, force_n: float) -> float:
        """Depth in m that the plan provides for a set force."""
        return self.depth_m if self.depth_m is not None else max(0.02, 0.03 * force_n)
