"""Samples of one press, a row a time step, as they come and as a log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.robot.arm_steps import ArmState
from sim.robot.compiled import part


@dataclass(frozen=True)
class PressLog:
    """Raw samples of a press, t rows.

    Attributes
    ----------
    press, fem_calls : number of the press, pairs exchanged
    time_s, clock_s : (t,) true and written time
    phase, wanted_n, true_force_n : (t,)
    wrist_n : (t, 3) measured force on the body, axes of the probe
    tip_m : (t, 3) true tip centre, world
    q, q_read : (t, n) true joint angles, and as the encoders read them
    touch_depth_m : commanded depth at which touch was declared
    tare_n, zero_after_n : along the probe
    outcome : made, or retried
    """

    press: int
    fem_calls: int
    time_s: np.ndarray
    clock_s: np.ndarray
    phase: np.ndarray
    wanted_n: np.ndarray
    true_force_n: np.ndarray
    wrist_n: np.ndarray
    tip_m: np.ndarray
    q: np.ndarray
    q_read: np.ndarray
    touch_depth_m: float
    tare_n: float
    zero_after_n: float
    outcome: str


class Rows(NamedTuple):
    """Columns of a press as they come, by their names in `PressLog`; (N,) or (N, k), `used` of N.

    `by_torque_n` : force that the joints' torques show, NaN where it was not asked for
    """

    used: np.ndarray
    time_s: np.ndarray
    phase: np.ndarray
    wanted_n: np.ndarray
    true_force_n: np.ndarray
    by_torque_n: np.ndarray
    wrist_n: np.ndarray
    tip_m: np.ndarray
    q: np.ndarray
    q_read: np.ndarray


@part
def add_row(rows: Rows, time_s: float, phase: int, wanted_n: float, arm: ArmState) -> None:
    """Keep the step that the arm has just made."""
    i = rows.used[0]
    rows.time_s[i], rows.phase[i], rows.wanted_n[i] = time_s, phase, wanted_n
    rows.true_force_n[i], rows.by_torque_n[i] = arm.now[0].contact_n, np.nan
    for k in range(3):
        rows.wrist_n[i, k], rows.tip_m[i, k] = arm.wrist_n[k], arm.tip_m[k]
    for k in range(len(arm.q)):
        rows.q[i, k], rows.q_read[i, k] = arm.q_seen[k], arm.q_read[k]
    rows.used[0] = i + 1


class PressRecorder:
    """Keeps the rows of a press; `joints` is the number of the arm's joints."""

    def __init__(self, joints: int) -> None:
        count, vectors = 8192, (3, 3, joints, joints)
        self.rows = Rows(
            np.zeros(1, np.int64),
            np.empty(count),
            np.empty(count, np.int8),
            *np.empty((3, count)),
            *(np.empty((count, size)) for size in vectors),
        )

    def begin(self) -> None:
        """Forget the rows of the press before."""
        self.rows.used[0] = 0

    def make_room(self) -> bool:
        """Double the room if it is used up; true if it was."""
        used, *columns = self.rows
        if used[0] < len(columns[0]):
            return False
        self.rows = Rows(used, *(np.concatenate([c, np.empty_like(c)]) for c in columns))
        return True

    def __getitem__(self, name: str) -> np.ndarray:
        """Column of the rows so far, by its name in `Rows`."""
        return getattr(self.rows, name)[: self.rows.used[0]]

    def columns(self) -> dict[str, np.ndarray]:
        """Return a copy of all columns of `PressLog`."""
        names = set(Rows._fields) & set(PressLog.__dataclass_fields__)
        return {name: self[name].copy() for name in names}
