"""Outcome of a press: made, retried, skipped or aborted, with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Outcome = Literal["made", "retried", "skipped", "aborted"]
"""`made` at the first attempt, `retried` and made at a later one, `skipped` without having begun
(also where it cannot be made, which is known before the scan),
`aborted` after a fault. The scan holds the readings of presses that are made or retried."""

ATTEMPTS = 3
"""Attempts at a press with `retry`."""

LARGEST_FORCE_ERROR = 0.01
LARGEST_OVERSHOOT = 0.05
LARGEST_PLACE_ERROR_M = 2e-4
LARGEST_RISE_M, LARGEST_RISE = 2e-4, 0.03
"""Of the surface during a press, and of its travel."""

LARGEST_TOUCH_SD_M, LARGEST_TOUCH_SD = 1e-4, 0.05
"""Of the depth of first touch, and of the travel."""

LEAST_END_SHARE = 0.3
LARGEST_ZERO = 0.03
"""Of the set force, that may be read after a press."""


class PressFault(Exception):
    """A press cannot be made, or not go on.

    Parameters
    ----------
    kind : one word of `sim.scan.watchdog.KINDS`
    reason : sentence without the press's number
    """

    def __init__(self, kind: str, reason: str) -> None:
        super().__init__(reason)
        self.kind, self.reason = kind, reason


@dataclass(frozen=True)
class Fault:
    """A fault in one attempt at a press.

    Attributes
    ----------
    kind, reason : see `PressFault`
    phase : in which it was noticed
    time_s : since the scan began
    """

    kind: str
    reason: str
    phase: str
    time_s: float


@dataclass(frozen=True)
class Judgement:
    """Quality of a press as the robot's own readings show it.

    Attributes
    ----------
    force_n : mean of the force over the second half of the hold
    force_error : relative, of that mean
    overshoot : largest force, averaged over 50 ms and without the share of the noise in it, over
        the set force, less one
    place_error_m : sideways distance of the tip from the planned point, mean of the second half of
        the hold
    tare_n : taken off the force before the approach, along the probe
    zero_after_n : force that is read after the press, 0 where it is noise
    set_force_n : wanted force
    touch_sd_m : standard deviation of the depth of first touch, from which travel is counted
    rise_m : how much higher the tip stood while unloading than while loading under the same force,
        at most
    travel_m : largest travel in contact
    end_share : force at the end of unloading over that wanted there, its noise allowed for
    """

    force_n: float
    force_error: float
    overshoot: float
    place_error_m: float
    tare_n: float
    zero_after_n: float
    set_force_n: float
    touch_sd_m: float = 0.0
    rise_m: float = 0.0
    travel_m: float = 0.0
    end_share: float = 1.0

    @property
    def kept(self) -> bool:
        """True if force, overshoot and place are within what a scan promises."""
        return not self.shortfalls()

    def shortfalls(self) -> tuple[str, ...]:
        """Return what is outside, in words."""
        found = []
        if not abs(self.force_error) <= LARGEST_FORCE_ERROR:
            found.append(f"the held force is off by {100 * self.force_error:.1f} %")
        if not self.overshoot <= LARGEST_OVERSHOOT:
            found.append(f"the force overshot by {100 * self.overshoot:.1f} %")
        if not abs(self.zero_after_n) <= LARGEST_ZERO * self.set_force_n:
            found.append(f"the force reads {self.zero_after_n:.3g} N after the press")
        if not self.rise_m <= LARGEST_RISE_M + LARGEST_RISE * self.travel_m:
            found.append(
                f"the tip stood {1e3 * self.rise_m:.2g} mm higher at the same force on the way "
                "back: the body has risen, or the force comes late"
            )
        if not self.touch_sd_m <= LARGEST_TOUCH_SD_M + LARGEST_TOUCH_SD * self.travel_m:
            found.append(f"first touch is known to {1e3 * self.touch_sd_m:.2g} mm only")
        if not self.end_share >= LEAST_END_SHARE:
            found.append("the tip lost the body before the end of unloading")
        if not self.place_error_m <= LARGEST_PLACE_ERROR_M:
            found.append(f"the tip stood {1e3 * self.place_error_m:.2f} mm beside its place")
        return tuple(found)


@dataclass(frozen=True)
class PressOutcome:
    """Outcome of one planned press.

    Attributes
    ----------
    press : its number in the scan
    outcome : see `Outcome`
    set_force_n : wanted force
    faults : of its attempts, in their order
    judged : of a press with readings
    reason : why there are no readings, or what was not kept, or why its force is less than was
        asked for; empty if all is well
    peak_force_n : largest true force of all attempts, which only the simulator knows
    lowered : its force is less than was asked for
    """

    press: int
    outcome: Outcome
    set_force_n: float
    faults: tuple[Fault, ...] = ()
    judged: Judgement | None = None
    reason: str = ""
    peak_force_n: float = 0.0
    lowered: bool = False

    @property
    def delivered(self) -> bool:
        """True if the scan holds its readings."""
        return self.outcome in ("made", "retried")

    @property
    def kept(self) -> bool:
        """True if the readings are there and force, overshoot and place are as promised."""
        return self.delivered and self.judged is not None and self.judged.kept

    @property
    def sentence(self) -> str:
        """Return one line for terminal and recording."""
        why = f": {self.reason}" if self.reason else ""
        tries = f" at attempt {len(self.faults) + 1}" if self.outcome == "retried" else ""
        return f"Press {self.press} {self.outcome}{tries}{why}"
