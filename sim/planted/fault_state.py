"""What all faults of single presses have: the presses, the moment, and sizes drawn anew."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

MOMENT_S = (0.2, 3.0)
"""After the begin of an attempt: way there, tare, approach, load, hold, unload."""


@dataclass
class Fault:
    """State of a fault in the running scan; the subclasses' hooks act while `active(t)`."""

    seed: int
    presses: Collection[int] | None
    attempts: int = 10**6
    tried: dict[int, int] = field(default_factory=dict)
    on: bool = False
    start_s: float = np.inf
    draw: np.random.Generator = field(default_factory=np.random.default_rng)

    def begin(self, press: int, time_s: float) -> None:
        """Draw whether, when and how an attempt at a press is befallen."""
        tried = self.tried.get(press, 0)
        self.tried[press] = tried + 1
        self.on = (self.presses is None or press in self.presses) and tried < self.attempts
        self.draw = np.random.default_rng([self.seed, press, 17])
        self.start_s = time_s + float(self.draw.uniform(*MOMENT_S))
        self.prepare()

    def prepare(self) -> None:
        """Draw the sizes of an attempt."""

    def active(self, time_s: float) -> bool:
        """Whether the fault acts at a time."""
        return self.on and time_s >= self.start_s

    def uniform(self, low: float, high: float, signed: bool = False) -> float:
        """Draw a size of this attempt, of either sign if `signed`."""
        value = float(self.draw.uniform(low, high))
        return value * float(self.draw.choice([-1, 1])) if signed else value
