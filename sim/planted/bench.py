"""The bench: a virtual block and its presses, the scene in which a planted effect acts.

A press follows its force program exactly: ramp to the peak force, hold, unload to zero, on a fine
grid in time (about 1 ms).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models import PressProgram
from sim.body.block_compliance import block_compliance
from sim.body.soft_body import DIVISIONS
from sim.body.true_body import HiddenBody

PARTS = ("load", "hold", "unload")
SAMPLES = (8, 8, 6)
STEP_S = 1e-3
_SHARES = np.linspace(0, 1, 60) ** 1.5  # of the set force, at which a ball's law is nearly straight


@dataclass(frozen=True)
class Bench:
    """Body, presses and timing: the scene in which a hidden effect acts.

    Attributes
    ----------
    program : the presses
    body : the block, with its hidden effects
    samples : rows of the scan a press in loading, holding and unloading, evenly in each
    divisions : of the truth's finer mesh
    """

    program: PressProgram
    body: HiddenBody
    samples: tuple[int, int, int] = SAMPLES
    divisions: tuple[int, int, int] = DIVISIONS

    @cached_property
    def _parts(self) -> list[np.ndarray]:
        """Duration of each part of each press, three of (j,) s."""
        return [self.program.ramp_s, self.program.hold_s, self.program.unload_s]

    @cached_property
    def _steps(self) -> list[int]:
        """Steps of a sample in each part: the same for all presses, so that arrays are full."""
        return [
            max(int(np.ceil(part.max() / count / STEP_S)), 1)
            for part, count in zip(self._parts, self.samples, strict=True)
        ]

    @cached_property
    def within_s(self) -> np.ndarray:
        """Time since the beginning of its press, (j, t) s, from 0."""
        columns = [np.zeros((len(self.program), 1))]
        for part, count, steps in zip(self._parts, self.samples, self._steps, strict=True):
            share = np.arange(1, count * steps + 1) / (count * steps)
            columns.append(columns[-1][:, -1:] + part[:, None] * share)
        return np.hstack(columns)

    @cached_property
    def time_s(self) -> np.ndarray:
        """Absolute time, (j, t) s."""
        return self.program.start_s[:, None] + self.within_s

    @property
    def begin_s(self) -> float:
        """Start of the first press, s."""
        return float(self.time_s[0, 0])

    @cached_property
    def part(self) -> np.ndarray:
        """Number of the part (see `PARTS`) at each step, (t,)."""
        counts = [c * s for c, s in zip(self.samples, self._steps, strict=True)]
        return np.concatenate([[0], np.repeat(np.arange(3), counts)])

    @cached_property
    def sampled(self) -> np.ndarray:
        """Steps that become rows of the scan, (s,)."""
        every = np.repeat(self._steps, self.samples)
        return np.cumsum(every)

    @cached_property
    def force_n(self) -> np.ndarray:
        """True force, (j, t) N."""
        ramp, hold, unload = (part[:, None] for part in self._parts)
        t = self.within_s
        share = np.minimum(t / ramp, np.clip((ramp + hold + unload - t) / unload, 0, 1))
        return self.program.force_n[:, None] * share

    def depth_m(self, force_n: np.ndarray) -> np.ndarray:
        """Elastic travel of each press under a force of its own, (j,) m."""
        if self.body.solved is None:
            return self.compliance() * force_n
        return np.array([law.at(f)[0] for law, f in zip(self.body.solved, force_n, strict=True)])

    @cached_property
    def elastic_m(self) -> np.ndarray:
        """Elastic travel of the tips, (j, t) m."""
        if self.body.solved is None:
            return self.compliance()[:, None] * self.force_n
        laws = zip(self.body.solved, self.program.force_n[:, None] * _SHARES, strict=True)
        known = [(force, [law.at(f)[0] for f in force]) for law, force in laws]
        return np.array([np.interp(f, *at) for f, at in zip(self.force_n, known, strict=True)])

    @property
    def points_m(self) -> np.ndarray:
        """Contact points on the top, (j, 2) m."""
        return np.column_stack([self.program.x_m, self.program.y_m])

    def compliance(
        self,
        radius_m: np.ndarray | None = None,
        profile: str = "flat",
        converged: bool = True,
        body: HiddenBody | None = None,
        upright: bool = False,
    ) -> np.ndarray:
        """Compliance of the presses, (j,) m/N; see `sim.body.block_compliance.block_compliance`.

        On a body of another shape, it is that at the set force.

        Parameters
        ----------
        radius_m : (j,) of the contacts, the tips' own if None
        body : another one than the bench's
        """
        if self.body.solved is not None:
            return self.depth_m(self.program.force_n) / self.program.force_n
        radius = self.program.radius_m if radius_m is None else radius_m
        return block_compliance(
            body or self.body, self.points_m, radius, profile, self.divisions, converged, upright
        )
