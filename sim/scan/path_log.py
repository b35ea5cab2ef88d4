"""Motion along a path through the air or over the body, as its rows come and as a result."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.motion.clearance import Clearance
from sim.robot.laboratory import Placement
from sim.scan.scan_program import Program

LOOK_S = 0.05  # between two looks at the clearance


@dataclass(frozen=True)
class Event:
    """What happened on a path: `kind` is start, touch, force, or end."""

    time_s: float
    kind: str
    text: str


@dataclass(frozen=True)
class PathResult:
    """Motion along a path, one row a time step (t rows); body frame.

    Attributes
    ----------
    time_s : (t,)
    tip_m, tip_axis : (t, 3) m and unit, the tip's centre and axis
    wrench_n : (t, 3) measured force of the tip on what it touches
    q : (t, n) rad
    wanted_n : (t,) set force, 0 where there is none
    clearance_m : (t,) distance of the arm, tip left out, from body, table and itself, as far as
        5 cm; seen every 0.05 s and held between
    events : in order
    """

    time_s: np.ndarray
    tip_m: np.ndarray
    tip_axis: np.ndarray
    wrench_n: np.ndarray
    q: np.ndarray
    wanted_n: np.ndarray
    clearance_m: np.ndarray
    events: tuple[Event, ...]

    @property
    def force_n(self) -> np.ndarray:
        """Measured force along the tip's axis, (t,)."""
        return np.einsum("ti,ti->t", self.wrench_n, self.tip_axis)


class PathLog:
    """Rows of a path as they come.

    Parameters
    ----------
    program : in which the arm moves
    clearance : of the arm
    place : of the body, in whose frame the result is
    """

    def __init__(self, program: Program, clearance: Clearance, place: Placement) -> None:
        self._program, self._look, self._place = program, clearance, place
        self._rows: list[tuple] = []
        self._events: list[Event] = []
        self._clearance, self._every = np.inf, max(1, round(LOOK_S / program.dt))

    def event(self, kind: str, text: str) -> None:
        """Note what happens now."""
        self._events.append(Event(self._program.time_s, kind, text))

    def add(self, wanted_n: float) -> float:
        """Keep the step just made; return the force along the tip."""
        program, rig = self._program, self._program.rig
        if len(self._rows) % self._every == 0:
            self._clearance = self._look.nearest(rig.q_seen, tip_may_touch=True)[0]
        turn = rig.data.site("tcp").xmat.reshape(3, 3)
        self._rows.append(
            (program.time_s, rig.tip_m.copy(), turn.copy(), rig.wrist_n.copy(), rig.q_seen.copy(),
             wanted_n, self._clearance)
        )  # fmt: skip
        return float(rig.wrist_n[2])

    def result(self) -> PathResult:
        """Return the rows and events so far."""
        when, tips, turns, forces, q, wanted, clear = map(np.array, zip(*self._rows, strict=True))
        to_body = self._place.rotation
        return PathResult(
            when,
            (tips - np.asarray(self._place.position_m)) @ to_body,
            turns[:, :, 2] @ to_body,
            np.einsum("tij,tj->ti", turns, forces) @ to_body,
            q,
            wanted,
            clear,
            tuple(self._events),
        )
