"""A raw stream cut into presses: the order of the steps, and the notes on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models import InputError, Scan
from palpmap.importing.mapping.rig import Rig
from palpmap.importing.readers.recording import Recording
from palpmap.importing.streams.alignment import Aligned, aligned
from palpmap.importing.streams.clocks import GRID_S, smooth
from palpmap.importing.streams.contact import SpoiltPress
from palpmap.importing.streams.press import CutPress, cut_press, window_of
from palpmap.importing.streams.stream import Stream

FELT = 0.4  # of the usual largest force
WEAK = 0.05  # of the usual largest force
LAW = 0.006  # of the travel: what the unknown law of the force adds to the touch's error
NEAR_S = 0.1  # a re-tare so close to touch or release: how large it is, and where they are, mix
SAME_PLACE_M = 1.0e-3
SURELY_IN = 0.2  # of the travel
SOON = 2.0  # times the duration of the press before: a viscous body has not recovered
UNRECOVERED = 0.05  # of the travel before: how deep the surface may still lie, one deviation


@dataclass(frozen=True, eq=False)
class Cut:
    """A stream cut into presses.

    Attributes
    ----------
    presses : in the order of time
    left_out : time in s of each omitted press, and the reason
    streams : force and pose on one clock
    said : what was found and assumed
    """

    presses: tuple[CutPress, ...]
    left_out: tuple[tuple[float, str], ...]
    streams: Aligned
    said: tuple[str, ...]

    @property
    def touch_error_m(self) -> float:
        """Standard deviation of the depth of first touch, rms over the presses, to two digits."""
        error = np.sqrt(np.mean([press.touch_error_m**2 for press in self.presses]))
        return float(f"{error:.1e}")

    @property
    def lag_error_s(self) -> float | None:
        """Standard deviation of the lag between force and pose, to two digits; None if stated."""
        return float(f"{self.streams.lag_error_s:.1e}") or None

    def scan(self, radius_m: float) -> Scan:
        """Return the scan of all presses; times count from the stream's begin."""
        counts = [len(press.time_s) for press in self.presses]

        def each(values: Sequence[np.ndarray]) -> np.ndarray:
            return np.repeat(np.array(values), counts, axis=0)

        def rows(name: str) -> np.ndarray:
            return np.concatenate([getattr(press, name) for press in self.presses])

        return Scan(
            press=np.repeat(np.arange(len(counts)), counts),
            time_s=rows("time_s"),
            phase=rows("phase"),
            point_m=each([press.point_m for press in self.presses]),
            direction=each([press.direction for press in self.presses]),
            force_n=rows("force_n"),
            displacement_m=rows("displacement_m"),
            probe_radius_m=np.full(sum(counts), radius_m),
        )


def cut_stream(recording: Recording, rig: Rig) -> Cut:
    """Cut a stream of force and pose into presses.

    Raises
    ------
    InputError
        A stream that cannot be cut, with the key that would help.
    """
    said: list[str] = []
    streams = aligned(recording, rig, said)
    presses, left_out, free = _cut_all(streams, rig)
    presses = _unrecovered([_widened(press) for press in presses], streams.pose, said)
    presses, weak = _without_weak(presses)
    left_out += weak
    if len(presses) < 2:
        reasons = "; ".join(sorted({reason for _, reason in left_out})) or "no force was felt"
        raise InputError(
            f"the stream holds {len(presses)} presses that can be used ({reasons}); check "
            "force.columns, force.frame, pose.columns and the units"
        )
    if free:
        said.append(f"{free} motions without contact were left out.")
    said += [f"The press at {time:.2f} s was left out: {reason}." for time, reason in left_out]
    error = 1e3 * np.array([press.touch_error_m for press in presses])
    said.append(
        f"The depth of first touch is known to {np.median(error):.2g} mm (standard deviation; the "
        f"worst press to {error.max():.2g} mm); travel counts from there."
    )
    said.insert(0, f"{len(presses)} presses were cut, {len(left_out)} were left out.")
    return Cut(tuple(presses), tuple(left_out), streams, tuple(said))


def _cut_all(streams: Aligned, rig: Rig) -> tuple[list[CutPress], list[tuple[float, str]], int]:
    """Presses, left-out ones with their reasons, and the number of motions without contact."""
    force, pose, mean_direction = streams.force, streams.pose, streams.direction
    presses: list[CutPress] = []
    left_out: list[tuple[float, str]] = []
    without: list[tuple[float, float]] = []
    for span in streams.spans:
        window = window_of(force, pose, span, mean_direction, streams.stated)
        try:
            press = window and cut_press(window, rig.rows, force.gaps, pose.gaps, streams.limits_s)
        except SpoiltPress as reason:
            left_out.append((_deepest(span, pose, mean_direction), str(reason)))
            continue
        if press is None:
            without.append(span)
        elif any(
            min(abs(t - press.touch_s), abs(t - press.release_s)) < NEAR_S for t in streams.jumps_s
        ):
            why = "the sensor was set to zero anew as the tip touched or left"
            left_out.append((press.touch_s, why))
        else:
            presses.append(press)
            left_out += _another(force, span, press, mean_direction)
    usual = float(np.median([press.force_n.max() for press in presses])) if presses else 0.0
    felt = [span for span in without if _rise(force, span, mean_direction) > FELT * usual > 0]
    left_out += [
        (_deepest(span, pose, mean_direction), "force was felt, but not along one line in and out")
        for span in felt
    ]
    return presses, left_out, len(without) - len(felt)


def _deepest(span: tuple[float, float], pose: Stream, direction: np.ndarray) -> float:
    time = np.arange(span[0], span[1], GRID_S)
    return float(time[(pose.at(time)[:, :3] @ direction).argmax()])


def _rise(force: Stream, span: tuple[float, float], direction: np.ndarray) -> float:
    """Return the range of the smoothed force along a direction in a span, N."""
    inside = (force.time_s >= span[0]) & (force.time_s <= span[1])
    if np.sum(inside) < 3:
        return 0.0
    values = force.values[inside]
    along = values[:, 0] if values.shape[1] == 1 else values @ direction
    return float(np.ptp(smooth(along, force.time_s[inside])))


def _another(
    force: Stream, span: tuple[float, float], press: CutPress, direction: np.ndarray
) -> list[tuple[float, str]]:
    """Say where the rest of a span holds another contact."""
    around = ((span[0], press.touch_s - 0.2), (press.release_s + 0.2, span[1]))
    return [
        ((part[0] + part[1]) / 2, "force was felt, but not along one line in and out")
        for part in around
        if _rise(force, part, direction) > FELT * press.force_n.max()
    ]


def _widened(press: CutPress) -> CutPress:
    """Add to the touch's error that of the law of the force."""
    travel = press.displacement_m[press.phase == "load"].max(initial=0.0)
    return replace(press, touch_error_m=float(np.hypot(press.touch_error_m, LAW * travel)))


def _unrecovered(presses: Sequence[CutPress], pose: Stream, said: list[str]) -> list[CutPress]:
    """Widen the touch's error of presses soon after another, cut or left out, at the same place."""
    found = []
    for press in presses:
        rows = pose.time_s < press.touch_s
        offset = pose.values[rows, :3] - press.point_m
        depth = offset @ press.direction
        beside = np.linalg.norm(offset - depth[:, None] * press.direction, axis=1)
        deep = SURELY_IN * float(press.displacement_m.max())
        inside = np.flatnonzero((beside < SAME_PLACE_M) & (depth > deep))
        rest = press.touch_s - float(pose.time_s[inside[-1]]) if len(inside) else np.inf
        if rest > SOON * len(inside) * pose.step_s:
            found.append(press)
            continue
        error = float(np.hypot(press.touch_error_m, UNRECOVERED * depth[inside].max()))
        found.append(replace(press, touch_error_m=error))
        said.append(
            f"The press at {press.touch_s:.2f} s follows another at the same place after "
            f"{rest:.2g} s: the body may not have recovered, so its depth of first touch is known "
            f"to {1e3 * error:.2g} mm only."
        )
    return found


def _without_weak(presses: Sequence[CutPress]) -> tuple[list[CutPress], list[tuple[float, str]]]:
    peaks = np.array([press.force_n.max() for press in presses])
    weak = peaks < WEAK * np.median(peaks) if len(peaks) else np.zeros(0, dtype=bool)
    kept = [press for press, is_weak in zip(presses, weak, strict=True) if not is_weak]
    left = [(press.touch_s, f"a force of {press.force_n.max():.2g} N is hardly a contact")
            for press, is_weak in zip(presses, weak, strict=True) if is_weak]  # fmt: skip
    return kept, left
