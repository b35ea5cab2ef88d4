"""Samples of one press, a row a time step, as they come and as a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.robot.simulated_arm import SimulatedArm


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


class PressRecorder:
    """Keeps the rows of a press as they come; `joints` is the number of the arm's joints."""

    def __init__(self, joints: int) -> None:
        numbers = ("time_s", "wanted_n", "true_force_n")
        vectors = {"wrist_n": 3, "tip_m": 3, "q": joints, "q_read": joints}
        row = [("phase", np.int8), *((name, float) for name in numbers)]
        row += [(name, float, size) for name, size in vectors.items()]
        self._rows, self._used = np.empty(8192, row), 0

    def begin(self) -> None:
        """Forget the rows of the press before."""
        self._used = 0

    def add(self, time_s: float, phase: int, wanted_n: float, rig: SimulatedArm) -> None:
        """Keep the step that the arm has just made."""
        if self._used == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._used] = (
            phase, time_s, wanted_n, rig.contact_n, rig.wrist_n, rig.tip_m, rig.q_seen, rig.q_read
        )  # fmt: skip
        self._used += 1

    def __getitem__(self, name: str) -> np.ndarray:
        """Column of the rows so far, by its name in `PressLog`."""
        return self._rows[name][: self._used]

    def columns(self) -> dict[str, np.ndarray]:
        """Return a copy of all columns, by their names in `PressLog`."""
        return {name: self[name].copy() for name in self._rows.dtype.names or ()}
