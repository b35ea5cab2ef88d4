"""Results of a scan: frames while it runs, a result a press, and the whole at its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models import Scan, stack_scans
from sim.scan.outcome import Judgement, PressOutcome

PHASES = ("transit", "approach", "touch", "load", "hold", "unload", "retract")
"""Phases of the time series, in the order of their codes."""


@dataclass(frozen=True)
class Frame:
    """One picture of the running scan; all in the world frame.

    Attributes
    ----------
    time_s : simulated time
    press : number of the press
    phase : one of `PHASES`
    positions_m, quaternions : (l, 3) and (l, 4) w, x, y, z, of the laboratory's links
    tip_m : (3,)
    force_vector_n : (3,) contact force on the body
    force_n : contact force along the press direction
    wanted_n : set value of the force at this time
    displacement_m : depth of the tip beyond the planned surface
    """

    time_s: float
    press: int
    phase: str
    positions_m: np.ndarray
    quaternions: np.ndarray
    tip_m: np.ndarray
    force_vector_n: np.ndarray
    force_n: float
    wanted_n: float
    displacement_m: float


@dataclass(frozen=True)
class PressStatistics:
    """Quality of one press, judged by the simulator's truth.

    Attributes
    ----------
    press : its number in the scan
    set_force_n, force_n : wanted force, and its mean over the second half of the hold
    force_error : relative, of that mean
    overshoot : largest force over the set force, less one
    contact_error_m : sideways distance of the tip from the planned point at the end of the hold
    settle_s : time from the end of the ramp until the force stays within 1 %
    fem_calls : pairs exchanged with the soft body
    coupling_error : largest relative difference between the tip's depth and the body's own
        displacement under the same force, over the second half of the hold
    touch_error_m : error of the robot's point of first touch
    depth_share : largest depth, of the body's thickness along the press
    """

    press: int
    set_force_n: float
    force_n: float
    force_error: float
    overshoot: float
    contact_error_m: float
    settle_s: float
    fem_calls: int
    coupling_error: float
    touch_error_m: float
    depth_share: float


@dataclass(frozen=True)
class Series:
    """All samples of a press or of a whole scan, one row a time step (t rows).

    Attributes
    ----------
    time_s : (t,)
    press : (t,) its number in the scan
    phase : (t,) codes, see `PHASES`
    force_n : (t,) measured along the probe's axis
    displacement_m : (t,) measured travel since first touch; NaN where the tip is not in contact
    wanted_n : (t,) set value of the force
    q : (t, n) rad, joint angles
    true_force_n, true_depth_m : (t,) the simulator's contact force and depth beyond the
        undeformed surface
    """

    time_s: np.ndarray
    press: np.ndarray
    phase: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    wanted_n: np.ndarray
    q: np.ndarray
    true_force_n: np.ndarray
    true_depth_m: np.ndarray


@dataclass(frozen=True)
class PressResult:
    """A finished press.

    Attributes
    ----------
    statistics : how well it went
    scan : its rows of the table
    series : all its samples
    true_force_n, true_displacement_m : (m,) the simulator's truth for each row of `scan`
    judged : how well it went by the robot's own readings
    """

    statistics: PressStatistics
    scan: Scan
    series: Series
    true_force_n: np.ndarray
    true_displacement_m: np.ndarray
    judged: Judgement


@dataclass(frozen=True)
class ScanRun:
    """A finished scan.

    Attributes
    ----------
    presses : result of each press that was made
    simulated_s, wall_s : duration in the laboratory's time and of the computation, planning
        included
    peak_torque : largest part of a joint's torque limit that was used
    outcomes : what became of each planned press
    """

    presses: tuple[PressResult, ...]
    simulated_s: float
    wall_s: float
    peak_torque: float
    outcomes: tuple[PressOutcome, ...]

    @property
    def scan(self) -> Scan:
        """The whole table of the presses that were made."""
        return stack_scans([press.scan for press in self.presses])

    @property
    def statistics(self) -> tuple[PressStatistics, ...]:
        """Of all presses."""
        return tuple(press.statistics for press in self.presses)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second of computation."""
        return self.simulated_s / self.wall_s

    @property
    def series(self) -> Series:
        """All samples of the scan."""
        names = Series.__dataclass_fields__
        return Series(
            **{n: np.concatenate([getattr(p.series, n) for p in self.presses]) for n in names}
        )
