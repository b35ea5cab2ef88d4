"""What the free parts of a stream, before and after each contact, say about the rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models import InputError
from palpmap.importing.mapping.columns import matrices
from palpmap.importing.mapping.rig import Rig
from palpmap.importing.readers.recording import Recording
from palpmap.importing.streams.cutting import Cut, cut_stream
from palpmap.importing.streams.lag import Lag
from palpmap.importing.streams.stream import noise_of
from palpmap.importing.streams.weight import turns

FREE_S = 0.4  # before the touch and after the release
APART_S = 0.05  # from both
FEWEST = 5  # samples on a side


@dataclass(frozen=True, eq=False)
class RigCheck:
    """Figures of a rig from approach and retreat alone; forces along the direction of pressing.

    Attributes
    ----------
    time_s, before_n, after_n : (j,) touch of each press, free force before and after it, with the
        tool's weight and the sensor's bias
    bias_n : mean free force of the sensor, three axes, in N; of one column, one
    drift_n_per_min, drift_error : slope of the free force over the recording, tool's weight taken
        out, and its standard deviation
    gravity_n : rms over the presses of what turns with the tip after the weight's removal; None
        where the tip does not turn
    hysteresis_n : median of the force after less the force before
    noise_n, noise_m : standard deviation of one sample of force and of depth
    lag : of the force behind the pose, None where it cannot be seen
    offset_s : between the clocks, without the lag
    force_n : median of the presses' largest forces
    said : sentences of the cutting
    """

    time_s: np.ndarray
    before_n: np.ndarray
    after_n: np.ndarray
    bias_n: np.ndarray
    drift_n_per_min: float
    drift_error: float
    gravity_n: float | None
    hysteresis_n: float
    noise_n: float
    noise_m: float
    lag: Lag | None
    offset_s: float
    force_n: float
    said: tuple[str, ...]


def check_rig(recording: Recording, rig: Rig) -> RigCheck:
    """Measure a rig by the approaches and retreats of a raw stream.

    Raises
    ------
    InputError
        Not a stream, or one that cannot be cut.
    """
    if rig.kind != "stream":
        raise InputError(
            'key kind: found "readings", expected "stream": a rig is checked by its raw recording '
            "of force and pose, approaches and retreats included"
        )
    cut = cut_stream(recording, rig)
    streams = cut.streams
    raw, clean, pose = streams.unweighed, streams.force, streams.pose
    rows, press_of, side = _free_stretches(raw.time_s, cut)
    both = [k for k in range(len(cut.presses)) if np.sum(press_of == k) == 2]
    if len(both) < 3:
        raise InputError(
            f"{len(both)} presses have free samples before and after the contact, expected at "
            "least 3; record approach and retreat too"
        )
    direction = np.array([cut.presses[k].direction for k in press_of])

    def along(values: np.ndarray) -> np.ndarray:
        means = np.array([values[r].mean(axis=0) for r in rows])
        return means[:, 0] if means.shape[1] == 1 else np.einsum("si,si->s", means, direction)

    def of(values: np.ndarray, which: int) -> np.ndarray:
        return np.array([values[(press_of == k) & (side == which)][0] for k in both])

    with_weight, free = along(raw.values), along(clean.values)
    time = np.array([raw.time_s[r].mean() for r in rows])
    slope, error = _slope(time[side == 0], free[side == 0])
    level = free - slope * (time - time.mean())
    turned = pose.values.shape[1] == 7 and turns(matrices(pose.at(time)[:, 3:]))
    return RigCheck(
        time_s=np.array([cut.presses[k].touch_s for k in both]),
        before_n=of(with_weight, 0),
        after_n=of(with_weight, 1),
        bias_n=streams.sensor.values[np.concatenate(rows)].mean(axis=0),
        drift_n_per_min=60 * slope,
        drift_error=60 * error,
        gravity_n=float(np.std(level[side == 0])) if turned else None,
        hysteresis_n=float(np.median(of(free, 1) - of(free, 0))),
        noise_n=float(np.median([noise_of(raw.values[r]).max() for r in rows])),
        noise_m=streams.pose_noise_m,
        lag=streams.lag,
        offset_s=streams.offset_s,
        force_n=float(np.median([press.force_n.max() for press in cut.presses])),
        said=cut.said,
    )


def _free_stretches(
    time_s: np.ndarray, cut: Cut
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Rows of the free stretches, the press of each, and its side: 0 before it, 1 after it."""
    rows, press_of, side = [], [], []
    for k, press in enumerate(cut.presses):
        for s, start in enumerate((press.touch_s - APART_S - FREE_S, press.release_s + APART_S)):
            found = np.flatnonzero((time_s >= start) & (time_s <= start + FREE_S))
            if len(found) >= FEWEST:
                rows.append(found)
                press_of.append(k)
                side.append(s)
    return rows, np.array(press_of, int), np.array(side, int)


def _slope(time: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Slope of a line through values (s,) and its standard deviation."""
    centred = time - time.mean()
    square = float(centred @ centred)
    slope = float(centred @ values) / square
    rest = values - values.mean() - slope * centred
    return slope, float(np.sqrt(rest @ rest / max(len(time) - 2, 1) / square))
