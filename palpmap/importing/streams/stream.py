"""A raw stream of force and pose: messages in order, units, frames, gaps and re-tares."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from models import InputError
from palpmap.importing.mapping.columns import continuous, matrices, numbers, rotated, seconds
from palpmap.importing.mapping.orientation import USUAL, quaternions
from palpmap.importing.mapping.rig import Clock, Pose, Rig
from palpmap.importing.readers.recording import Recording, Table
from palpmap.importing.readers.units import factor

FEWEST_MESSAGES = 100
MOST_EMPTY = 0.2  # of the rows
GAP_STEPS = 5.0  # of the usual time step: a longer one is a gap
FROZEN_ROWS = 5
JUMP_STEPS = 2.5  # steps behind it: with a longer one, a pose that was frozen goes on
SELDOM = 0.05  # share of equal neighbours below which a run of them is a frozen sensor
JUMP_NOISE = 8.0  # standard deviations of a sample: a re-tare, in one step
WINDOW = 12  # samples on either side of a jump
LONGEST_WINDOW = 400  # samples by which the size of a jump is known
AGREE = 2.5  # standard deviations: so close a wider fit must stay to all narrower ones
BESIDE, ALONE = 4, 2.5  # a jump is so much larger than the steps of so many samples on either side
STAIR = 8.0  # times the usual way from message to message around it: the tip goes a step


@dataclass(frozen=True, eq=False)
class Stream:
    """Values over time, without repeated or disordered messages.

    Attributes
    ----------
    time_s : (m,) rising
    values : (m, k)
    gaps : (g, 2) start and end of each pause in the messages, s
    """

    time_s: np.ndarray
    values: np.ndarray
    gaps: np.ndarray

    @property
    def step_s(self) -> float:
        """Usual time between two messages, s."""
        return float(np.median(np.diff(self.time_s)))

    def later(self, offset_s: float) -> Stream:
        """Return the stream with an offset added to its clock."""
        return Stream(self.time_s + offset_s, self.values, self.gaps + offset_s)

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the values (m, k) at other times, between two messages."""
        return np.column_stack([np.interp(time_s, self.time_s, v) for v in self.values.T])


def read_force(recording: Recording, rig: Rig, said: list[str]) -> Stream:
    """Return the force in N as the sensor has it, (m, 1) or (m, 3), sign applied."""
    names, key = rig.force.named
    values, table = numbers(recording, names, rig.force.unit, "force", key, True)
    time = _time(recording, table, rig.force.clock or rig.time, "force")
    return ordered(time, rig.force.sign * values, f"force ({table.name})", said)


def read_pose(recording: Recording, rig: Rig, pose: Pose, said: list[str]) -> Stream:
    """Return position in m and, where there is one, quaternion w, x, y, z, (m, 3) or (m, 7).

    Both are in the scan's frame; the position is that of the tip's end.
    """
    values, table = numbers(recording, pose.columns, pose.unit, "length", "pose.columns", True)
    time = _time(recording, table, pose.clock or rig.time, "pose")
    if pose.orientation:
        quaternion, home = numbers(recording, pose.orientation, "", "", "pose.orientation", True)
        if home is not table:
            raise InputError(
                f"key pose.orientation: stands in {home.name} and the position in {table.name}, "
                "expected columns of one table"
            )
        count = len(pose.orientation)
        scale = factor(pose.angle_unit, "angle", "pose.angle_unit") if count == 3 else 1.0
        quaternion, none = quaternions(scale * quaternion, pose.order or USUAL[count])
        bad = np.flatnonzero(none)
        if len(bad):
            raise InputError(
                f"{table.where(int(bad[0]))}, key pose.orientation: found "
                + (
                    f"a quaternion of length {np.linalg.norm(quaternion[bad[0]]):.3g}, expected 1"
                    if count == 4
                    else "a matrix that is no rotation"
                )
                + "; check the columns and their order"
            )
        values = np.hstack([values, continuous(quaternion)])
    stream = ordered(time, values, f"pose ({table.name})", said, may_rest=True)
    values = stream.values
    position = values[:, :3]
    if any(pose.tip_offset_m):
        position = position + matrices(values[:, 3:]) @ np.array(pose.tip_offset_m)
    values = np.hstack([rotated(rig, position, place=True), values[:, 3:]])
    return Stream(stream.time_s, values, stream.gaps)


def in_base(rig: Rig, force: Stream, pose: Stream) -> np.ndarray:
    """Return the force's three columns in the scan's frame, (m, 3)."""
    vectors = force.values
    if rig.force.frame == "tip":
        vectors = np.einsum("mij,mj->mi", matrices(pose.at(force.time_s)[:, 3:]), vectors)
    return rotated(rig, vectors, place=False)


def _time(recording: Recording, table: Table, clock: Clock | None, key: str) -> np.ndarray:
    if len(table) < FEWEST_MESSAGES:
        raise InputError(
            f"{table.where(0)}: found {len(table)} messages of the {key}, expected a stream of at "
            f"least {FEWEST_MESSAGES}"
        )
    time = seconds(recording, table, clock, "time")
    if time is None:
        raise InputError("key time.column: missing, expected the column of the time of the stream")
    return time


def ordered(
    time: np.ndarray, values: np.ndarray, name: str, said: list[str], may_rest: bool = False
) -> Stream:
    """Sort messages by time, leave out repeated and frozen ones, and find the gaps.

    `may_rest` : of a pose, which repeats a value where the tip stands still
    """
    arrived = np.diff(np.sort(time))  # also of rows that are left out below: these are not missing
    whole = np.all(np.isfinite(values), axis=1)
    if empty := int(np.sum(~whole)):
        if empty > MOST_EMPTY * len(whole):
            raise InputError(
                f"{name}: found cells that are empty or no finite number in {empty} of "
                f"{len(whole)} rows, expected numbers; check the columns"
            )
        rows = "1 row was" if empty == 1 else f"{empty} rows were"
        said.append(f"{name}: {rows} left out, with a cell that is empty or no finite number.")
        time, values = time[whole], values[whole]
    late = int(np.sum(np.diff(time) < 0))
    if late:
        said.append(f"{name}: {late} messages came out of order and were sorted by their time.")
        order = np.argsort(time, kind="stable")
        time, values = time[order], values[order]
    step = float(np.median(np.diff(time)))
    if step <= 0:
        raise InputError(
            f"{name}: found one time for most messages, expected a clock that runs; name another "
            "column"
        )
    first = np.append(True, np.diff(time) > 0.02 * step)
    if repeated := int(np.sum(~first)):
        said.append(f"{name}: {repeated} repeated messages were left out.")
        time, values = time[first], values[first]
    frozen = _frozen(time, values, may_rest)
    if count := int(np.sum(frozen)):
        said.append(f"{name}: {count} messages repeat a frozen value and were left out.")
        time, values = time[~frozen], values[~frozen]
    steps = np.diff(time)
    step = float(np.median(steps))
    long = np.flatnonzero(steps > GAP_STEPS * step)
    missing = int(np.sum(np.round(arrived[arrived > 1.5 * step] / step) - 1))
    if missing:
        longest = 1e3 * float(arrived.max())
        said.append(
            f"{name}: about {missing} of {missing + len(time)} messages are missing, the longest "
            f"gap is {longest:.0f} ms."
        )
    said.append(f"{name}: {len(time)} messages at {1 / step:.4g} Hz, {np.ptp(time):.4g} s.")
    return Stream(time, values, np.column_stack([time[long], time[long + 1]]))


def _frozen(time: np.ndarray, values: np.ndarray, may_rest: bool) -> np.ndarray:
    """Messages that repeat the one before in a run of at least `FROZEN_ROWS`, (m,) bool.

    Where neighbours are often equal, the readings are coarse and nothing is left out. A tip that
    stood still begins to move at the end of the run, or goes one step and stands still again; a
    frozen pose jumps over the missed motion, and moves on. A step over a pause tells nothing. A
    single column at its highest or lowest value is at the sensor's limit, and not frozen.
    """
    steps = np.diff(time)
    paused = steps > GAP_STEPS * np.median(steps)
    moved = np.linalg.norm(np.diff(values, axis=0), axis=1)
    same = np.append(False, np.all(values[1:] == values[:-1], axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    frozen, resting = np.zeros((2, len(values)), dtype=bool)
    ends = (values.min(), values.max()) if values.shape[1] == 1 else ()
    for start, end in edges.reshape(-1, 2):
        if end - start < FROZEN_ROWS:
            continue
        jump, after = moved[end - 1 : end].max(initial=0.0), moved[end : end + 3].max(initial=0.0)
        is_step = jump <= JUMP_STEPS * after or not after or paused[end - 1 : end].any()
        of_rest = (may_rest and is_step) or values[start] in ends
        (resting if of_rest else frozen)[start:end] = True
    rest = ~(frozen | resting)
    others = np.mean(same[rest]) if rest.any() else 1.0
    return frozen if others < SELDOM else np.zeros_like(frozen)


def noise_of(values: np.ndarray) -> np.ndarray:
    """Return the standard deviation of a sample's noise, (k,), by neighbours' differences."""
    return 1.4826 * np.median(np.abs(np.diff(values, axis=0)), axis=0) / np.sqrt(2)


def noise_of_moving(values: np.ndarray) -> np.ndarray:
    """Return the same, (k,), where the values change steadily: by second differences."""
    return noise_of(np.diff(values, axis=0)) / np.sqrt(3)


def without_jumps(
    force: Stream, pose: Stream | None = None
) -> tuple[Stream, list[tuple[float, float]]]:
    """Take out re-tares: jumps from one message to the next that stay.

    Parameters
    ----------
    pose : by the same clock, if given: where the tip goes a step and rests, so does the force

    Returns
    -------
    stream : the force, run on over each jump
    jumps : time in s and size in N of each
    """
    values = force.values
    m = len(values)
    if m < 4 * WINDOW:
        return force, []
    noise = np.maximum(noise_of(values), 1e-12 + 1e-6 * np.ptp(values, axis=0))
    step = np.diff(values, axis=0)
    doubtful = np.flatnonzero(np.max(np.abs(step) / noise, axis=1) > JUMP_NOISE)
    usual = np.diff(force.time_s) < GAP_STEPS * force.step_s
    if pose is not None:
        doubtful = doubtful[~_steps(pose.at(force.time_s)[:, :3])[doubtful]]
    jumps, offset = [], np.zeros_like(values)
    for i in doubtful[(doubtful >= WINDOW) & (doubtful < m - WINDOW - 1) & usual[doubtful]]:
        before, after = (
            _line_to(values[i - WINDOW + 1 : i + 1]),
            _line_to(values[i + WINDOW : i : -1]),
        )
        stays = after - before
        k = int(np.argmax(np.abs(stays) / noise))
        same = np.abs(step[i] - stays) < 0.4 * np.abs(stays) + 3 * noise
        beside = np.abs(np.concatenate([step[i - BESIDE : i, k], step[i + 1 : i + 1 + BESIDE, k]]))
        alone = np.abs(step[i, k]) > ALONE * beside.max()  # a tip that leaves fast is no jump
        if np.abs(stays[k]) > 0.6 * JUMP_NOISE * noise[k] and same[k] and alone:
            jumps.append((float(force.time_s[i + 1]), float(np.linalg.norm(stays))))
            offset[i + 1 :] += _size(values, i, noise)
    return Stream(force.time_s, values - offset, force.gaps), jumps


def _steps(position_m: np.ndarray) -> np.ndarray:
    """Whether the tip goes a step from each message (m, 3) to the next, and rests around, (m - 1,).

    Steps of single messages, ones beside it included, between much slower ones.
    """
    way = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    padded = np.pad(way, BESIDE, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * BESIDE + 1)
    step = way > STAIR * np.median(around, axis=1)
    return step | np.append(step[1:], False) | np.append(False, step[:-1])


def _size(values: np.ndarray, i: int, noise: np.ndarray) -> np.ndarray:
    """Size (k,) of the jump behind sample i, by as many samples on either side as agree."""
    fits, n = [], WINDOW
    while n <= min(i + 1, len(values) - 1 - i, LONGEST_WINDOW):
        apart = _line_to(values[i + n : i : -1]) - _line_to(values[i - n + 1 : i + 1])
        fits.append((apart, noise * np.sqrt(8 / n)))
        n *= 2
    return widest(fits)


def widest(fits: Iterable[tuple[np.ndarray, np.ndarray | float]]) -> np.ndarray:
    """Return of each value the widest fit that agrees with all narrower ones within the noise.

    Intersection of confidence intervals, Goldenshluger and Nemirovski 1997.

    Parameters
    ----------
    fits : the values (m,) and their standard deviations, the narrowest first
    """
    low, high, agrees, best = -np.inf, np.inf, True, np.zeros(0)
    for fit, deviation in fits:
        low = np.maximum(low, fit - AGREE * deviation)
        high = np.minimum(high, fit + AGREE * deviation)
        agrees = agrees & (low <= high)
        best = np.where(agrees, fit, best if len(best) else fit)
    return best


def _line_to(values: np.ndarray) -> np.ndarray:
    """Value at half a step behind the last of some samples, by a line through them."""
    n = len(values)
    at = np.arange(n) - (n - 1) / 2
    slope = at @ values / (at @ at)
    return np.median(values - np.outer(at, slope), axis=0) + slope * (n / 2)
