"""Readings: the used rows of a scan, in the order of pressing, as input of effects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from models import InputError, Scan

_MOST_PER_PRESS = 50  # ids for each press of the scan

_EVEN = 0.05  # of the length of a scan


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of a scan, by which laws of its readings are stated.

    A law that was found on one scan keeps them on another: a sensor that loses a tenth at 0.3 N
    loses it there, whatever force the other scan goes to.

    Attributes
    ----------
    force_n : largest peak force
    depth : largest travel over the tip's radius
    time_s, pace_s, press_s : length of the scan, mean time from one press to the next, and longest
        time from a touch to a reading of its press; 0 for a scan without time
    middle_m : (3,) middle of the contact points' box
    across : (2, 3) the widest directions of the points, over their largest distance from the middle
        along an axis
    """

    force_n: float
    depth: float
    time_s: float
    pace_s: float
    press_s: float
    middle_m: np.ndarray
    across: np.ndarray


@dataclass(frozen=True, eq=False)
class Readings:
    """The m used rows of a scan of j presses; read-only arrays. Each is a key of what it leads to.

    Attributes
    ----------
    press : (m,) index of the press, 0..j-1, in the order of the table
    order : (j,) place of each press in the order of pressing, from 0, with gaps for presses that
        are left out here
    time_s : (m,) absolute time, or None where the scan has none
    phase : (m,) "load", "hold" or "unload"
    point_m, direction : (m, 3) contact point and unit direction of pressing
    force_n : (m,) as the sensor read it
    radius_m : (m,) of the probe
    start_s : start of the scan's clock, if not the time of its first reading
    travel_from : "touch" or "plane", see `models.Scan`; empty where that is not known
    deepest : largest travel over the tip's radius in the scan
    stated : scales by which laws are stated, where they are those of another scan
    """

    press: np.ndarray
    order: np.ndarray
    time_s: np.ndarray | None
    phase: np.ndarray
    point_m: np.ndarray
    direction: np.ndarray
    force_n: np.ndarray
    radius_m: np.ndarray
    start_s: float | None = None
    travel_from: Literal["", "touch", "plane"] = ""
    deepest: float = 1.0
    stated: Scales | None = None

    @classmethod
    def of(cls, scan: Scan) -> Readings:
        """Return the readings of a scan's used rows (placed in the body's frame)."""
        rows = scan.used()
        return cls(
            press=rows.press_index,
            order=_order(rows.press_ids),
            time_s=rows.time_s if rows.has_time else None,
            phase=rows.phase,
            point_m=rows.point_m,
            direction=rows.direction,
            force_n=rows.force_n,
            radius_m=rows.probe_radius_m,
            travel_from=rows.travel_from,
            deepest=max(float(np.max(rows.displacement_m / rows.probe_radius_m)), 1e-3),
        )

    def __len__(self) -> int:
        return len(self.press)

    def some(self, presses: np.ndarray) -> Readings:
        """Return the readings of some presses, of rising indices (k,)."""
        rows = np.isin(self.press, presses)
        return replace(
            self,
            press=np.searchsorted(presses, self.press[rows]),
            order=self.order[presses],
            time_s=None if self.time_s is None else self.time_s[rows],
            phase=self.phase[rows],
            point_m=self.point_m[rows],
            direction=self.direction[rows],
            force_n=self.force_n[rows],
            radius_m=self.radius_m[rows],
            start_s=None if self.time_s is None else self.clock_start_s,
            stated=self.scales,
        )

    @cached_property
    def scales(self) -> Scales:
        """Scales by which laws are stated: `stated`, or these readings' own."""
        return self.stated or self.own_scales

    @property
    def own_scales(self) -> Scales:
        """Scales of these readings."""
        centres = self.point_m[self.first]
        middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
        widest = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)[2][:2]
        timed = self.time_s is not None
        length_s = float(self.elapsed_s.max()) if timed else 0.0
        return Scales(
            force_n=self.largest_force_n,
            depth=self.deepest,
            time_s=length_s,
            pace_s=length_s / self.presses,
            press_s=float(self.since_touch_s.max()) if timed else 0.0,
            middle_m=middle,
            across=widest / max(float(np.abs(centres - middle).max()), 1e-300),
        )

    @property
    def presses(self) -> int:
        """Number of presses j."""
        return len(self.order)

    @cached_property
    def presses_made(self) -> int:
        """Number of presses up to the last, with those left out here."""
        return int(self.order.max()) + 1

    @cached_property
    def even_pace(self) -> bool:
        """Whether order and time are nearly one: no press is far off an even pace."""
        if self.time_s is None or self.presses < 3:
            return False
        begins = self.timed_s[self.first]
        even = np.polyval(np.polyfit(self.order, begins, 1), self.order)
        return bool(np.abs(begins - even).max() < _EVEN * np.ptp(begins))

    @cached_property
    def first(self) -> np.ndarray:
        """Row of each press's first reading, (j,)."""
        return np.searchsorted(self.press, np.arange(self.presses))

    @cached_property
    def run(self) -> np.ndarray:
        """Number (m,) of each reading's phase of its press, rising over the scan."""
        same = (self.phase[1:] == self.phase[:-1]) & (self.press[1:] == self.press[:-1])
        return np.append(0, np.cumsum(~same))

    @cached_property
    def between_m(self) -> np.ndarray:
        """Distances between the points of the presses, (j, j) m."""
        points = self.point_m[self.first]
        return np.linalg.norm(points[:, None] - points[None, :], axis=2)

    @cached_property
    def in_plane(self) -> np.ndarray:
        """Contact points (m, 2) along the two widest directions of their presses.

        From the presses' middle, over the largest distance from it along an axis; of `scales`.
        """
        return (self.point_m - self.scales.middle_m) @ self.scales.across.T

    @cached_property
    def layers(self) -> tuple[np.ndarray, ...]:
        """Rows of all presses' first readings, of their second ones, and so on."""
        place = np.arange(len(self)) - self.first[self.press]
        by_place = np.argsort(place, kind="stable")
        return tuple(np.split(by_place, np.cumsum(np.bincount(place))[:-1]))

    def peak_of(self, force_n: np.ndarray) -> np.ndarray:
        """Largest force of each reading's press, (m,) N: the mean of its hold, if it has one."""
        held, count = self._held
        total = np.bincount(self.press[held], force_n[held], minlength=self.presses)
        peak = np.maximum.reduceat(force_n, self.first)
        return np.where(count > 0, total / np.maximum(count, 1), peak)[self.press]

    @cached_property
    def _held(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of all holds, and their number (j,) in each press."""
        held = np.flatnonzero(self.phase == "hold")
        return held, np.bincount(self.press[held], minlength=self.presses)

    @cached_property
    def peak_force_n(self) -> np.ndarray:
        """`peak_of` the force that the sensor read, (m,) N."""
        return self.peak_of(self.force_n)

    @cached_property
    def largest_force_n(self) -> float:
        """Largest peak force of the scan."""
        return float(self.peak_force_n.max())

    @property
    def clock_start_s(self) -> float:
        """Start of the scan's clock, s: its first reading, or `start_s`."""
        return float(self.timed_s[0]) if self.start_s is None else self.start_s

    @cached_property
    def elapsed_s(self) -> np.ndarray:
        """Time since the clock of the scan began, (m,) s."""
        return self.timed_s - self.clock_start_s

    @property
    def timed_s(self) -> np.ndarray:
        """`time_s`; raises ValueError for a scan without."""
        if self.time_s is None:
            raise ValueError("the scan has no time stamps")
        return self.time_s

    @cached_property
    def sampling_step_s(self) -> float:
        """Median time between two readings of a press."""
        return float(np.median(np.diff(self.timed_s)[np.diff(self.press) == 0]))

    @cached_property
    def press_length_s(self) -> float:
        """Median time from the first to the last reading of a press."""
        last = np.append(self.first[1:], len(self)) - 1
        return float(np.median(self.timed_s[last] - self.timed_s[self.first]))

    @cached_property
    def touch_time_s(self) -> np.ndarray:
        """Time of first touch of each press, (j,) s: its first ramp continued back to no force.

        Never earlier than one sampling step before the first reading.
        """
        time_s = self.timed_s
        touch = np.empty(self.presses)
        for j, start in enumerate(self.first):
            end = self.first[j + 1] if j + 1 < self.presses else len(self)
            rows = slice(start, min(start + 4, end))
            t, f = time_s[rows], self.force_n[rows]
            step = t[1] - t[0] if len(t) > 1 else 0.0
            slope = np.polyfit(t - t[0], f, 1)[0] if np.ptp(t) > 0 else 0.0
            back = f[0] / slope if slope > 0 else step
            touch[j] = t[0] - np.clip(back, 0.0, step)
        return touch

    @cached_property
    def since_touch_s(self) -> np.ndarray:
        """Time from the touch of its press to each reading, (m,) s."""
        return np.maximum(self.timed_s - self.touch_time_s[self.press], 0.0)

    def lacks(self, needs: Iterable[str]) -> str | None:
        """Return the unfulfilled needs in words, or None.

        Raises
        ------
        InputError
            An effect's needs are none of those that a scan can be asked about.
        """
        loaded = self.phase == "load"
        have = {
            "time": self.time_s is not None,
            "unloading": bool(np.any(self.phase == "unload")),
            "hold": bool(np.any(self.phase == "hold")),
            "several forces": bool(
                np.ptp(self.force_n) > 0.2 * max(np.abs(self.force_n).max(), 1e-300)
                and loaded.any()
            ),
            "several presses": self.presses >= 8,
        }
        says = {
            "time": "the scan has no time stamps",
            "unloading": "the scan has no unloading",
            "hold": "the scan has no hold",
            "several forces": "all readings were made at nearly one force",
            "several presses": f"the scan has only {self.presses} presses, 8 are needed",
        }
        if unknown := [need for need in needs if need not in have]:
            known = ", ".join(f'"{need}"' for need in have)
            raise InputError(
                f"needs: found '{unknown[0]}', expected a tuple of {known}; of one, such as "
                '("time",), with a comma'
            )
        missing = [says[need] for need in needs if not have[need]]
        return "; ".join(missing) if missing else None


def _order(press_ids: np.ndarray) -> np.ndarray:
    """Places (j,) of presses in the order of pressing, by their ids (j,).

    An id counts the presses, so that gaps mean presses left out; but ids with very few of the
    numbers in use are of another kind.
    """
    place = press_ids - press_ids.min()
    if place.max(initial=0) >= _MOST_PER_PRESS * len(place):
        place = np.argsort(np.argsort(press_ids))
    return place.astype(int)
