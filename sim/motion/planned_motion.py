"""What planning a scan gives: presses that are ready to be made, and those that cannot be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models import InputError
from sim.motion.press_path import PressPath
from sim.motion.scan_plan import ScanPlan


@dataclass(frozen=True)
class Refusal:
    """A press that cannot be made.

    Attributes
    ----------
    press : its number in the scan
    point_m, direction : (3,) m and unit, in the frame of the scan
    force_n : set force
    reason : what stops it, and what to do
    """

    press: int
    point_m: np.ndarray
    direction: np.ndarray
    force_n: float
    reason: str

    @classmethod
    def of(cls, plan: ScanPlan, press: int, reason: str) -> Refusal:
        """Return the refusal of a press of a plan."""
        where = plan.points_m[press] + plan.origin_m, plan.directions[press]
        return cls(int(plan.ids[press]), *where, plan.force_of(press), reason)

    def __str__(self) -> str:
        direction = np.round(self.direction, 3).tolist()
        return (
            f"Press {self.press} at {in_mm(self.point_m)} mm, direction {direction}: {self.reason}"
        )


@dataclass(frozen=True)
class Motion:
    """Planned motion of a scan.

    Attributes
    ----------
    presses : ready to be made, in order
    refused : presses that cannot be made; `presses` are the others
    """

    presses: tuple[PlannedPress, ...]
    refused: tuple[Refusal, ...] = ()

    def require_all(self) -> tuple[PlannedPress, ...]:
        """Return the presses, or raise `InputError` for the first that cannot be made."""
        if self.refused:
            raise InputError(str(self.refused[0]))
        return self.presses


@dataclass(frozen=True)
class PlannedPress:
    """One press, ready to be made.

    Attributes
    ----------
    point_m, direction : (3,) m and unit, world frame
    path : the arm's configuration over depth
    approach : (n,) rad, above the surface, start and end of the press
    touch : (n,) rad, tip on the undeformed surface
    waypoints : configurations (n,) rad and durations (s) of the motion from the press before to
        `approach`
    clearance_m : smallest distance of the arm from body and table at `approach`
    """

    point_m: np.ndarray
    direction: np.ndarray
    path: PressPath
    approach: np.ndarray
    touch: np.ndarray
    waypoints: tuple[tuple[np.ndarray, float], ...]
    clearance_m: float


def refuse(refused: Sequence[Refusal], planned: int, skip: bool) -> None:
    """Raise `InputError` where no planned press can be made or, without `skip`, some cannot."""
    if refused and (len(refused) == planned or not skip):
        more = f" ({len(refused)} of {planned} presses cannot be made)" if len(refused) > 1 else ""
        raise InputError(f"{refused[0]}{more}")


def in_mm(point: np.ndarray) -> str:
    """Return a point (3,) m as text, mm."""
    return "(" + ", ".join(f"{value * 1e3:.1f}" for value in point) + ")"
