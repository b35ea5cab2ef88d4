"""A raw stream cut into presses: the order of the steps, and what is said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import find_peaks

from models.errors import InputError
from models.scan import Scan
from palpmap.importing.alignment import (
    GRID_S,
    Lag,
    closer_offset,
    find_lag,
    rough_offset,
    smooth,
    smoothed,
)
from palpmap.importing.columns import numbers, rotated
from palpmap.importing.contact import (
    TARE_S,
    TOUCH_SHARE,
    Contact,
    SpoiltPress,
    find_contact,
    find_touch,
    tared_at,
)
from palpmap.importing.readings import hold_of
from palpmap.importing.recording import Recording
from palpmap.importing.rig import AXES, TRAVEL, Rig, Rows
from palpmap.importing.rotation import matrices
from palpmap.importing.stream_data import (
    Stream,
    in_base,
    noise_of,
    read_force,
    read_pose,
    without_jumps,
)
from palpmap.importing.weight import without_weight

TOGETHER = 0.6
SHALLOW_STROKE = 0.15
PROMINENT = 0.3  # of the usual stroke
SIDEWAYS_M = 1.0e-3
SIDEWAYS = 0.2  # of the stroke
LONGEST_GAP_S = 0.1
LONGEST_GAP = 0.08  # of the contact
PLATEAU = 0.985
ONE_DIRECTION_DEG = 2.0
WEAK = 0.05  # of the usual largest force
ROUGH_FIT = 0.05  # of the largest force: the way in is no smooth curve
JUMP = 0.05  # of the largest force, between before and after


@dataclass(frozen=True, eq=False)
class Window:
    """The samples of one motion into the body and out again, on the force's messages.

    Attributes
    ----------
    time_s : (m,)
    position_m : (m, 3) of the tip
    force : (m, k) N, in the scan's frame if k is 3
    direction : (3,) of pressing
    """

    time_s: np.ndarray
    position_m: np.ndarray
    force: np.ndarray
    direction: np.ndarray

    @property
    def depth_m(self) -> np.ndarray:
        """Position along the direction, (m,) m."""
        return self.position_m @ self.direction

    @property
    def force_n(self) -> np.ndarray:
        """Force along the direction, (m,) N."""
        return self.force[:, 0] if self.force.shape[1] == 1 else self.force @ self.direction


@dataclass(frozen=True, eq=False)
class CutPress:
    """A press's readings and where it touched first.

    Attributes
    ----------
    touch_s, release_s : time of first touch and of the last contact
    point_m, direction : (3,)
    time_s, force_n, displacement_m, phase : rows of the scan
    """

    touch_s: float
    release_s: float
    point_m: np.ndarray
    direction: np.ndarray
    time_s: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True, eq=False)
class Cut:
    """A stream cut into presses.

    Attributes
    ----------
    presses : in the order of time
    left_out : time in s of each press that was left out, and the reason
    lag : of the force behind the pose, in s with rough offset; None where it cannot be seen
    offset_s : rough offset of the clocks
    said : what was found and assumed
    """

    presses: tuple[CutPress, ...]
    left_out: tuple[tuple[float, str], ...]
    lag: Lag | None
    offset_s: float
    said: tuple[str, ...]

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
    assert rig.pose  # `Rig.needed` asks
    said: list[str] = []
    force = read_force(recording, rig, said)
    pose = read_pose(recording, rig, rig.pose, said)
    force, jumps = without_jumps(force)
    said += [
        f"At {time:.2f} s the force jumps by {size:.3g} N from one message to the next and stays: "
        "the sensor was set to zero anew; the force was run on."
        for time, size in jumps
    ]
    rough = rough_offset(force, pose, rig.pose.clock_offset_s)
    pose = Stream(pose.time_s + rough.offset_s, pose.values, pose.gaps + rough.offset_s)
    if force.values.shape[1] == 3:
        force = replace(force, values=in_base(rig, force, pose))
    near, mean_direction, spans = _into_body(force, pose, rough.line, rig)
    pose = Stream(pose.time_s + near, pose.values, pose.gaps + near)
    offset = rough.offset_s + near
    stated = _stated_directions(recording, rig, pose, offset)
    windows = [_window(force, pose, span, mean_direction, stated) for span in spans]
    windows = [window for window in windows if window is not None]
    rough_contacts = [_contact_or_none(window) for window in windows]
    if rig.force.frame == "tip" and force.values.shape[1] == 3:
        force = without_weight(force, pose, windows, rough_contacts, said)
    lag = None
    if rig.pose.clock_offset_s is None:
        lag = _lag_of(windows, rough_contacts, pose)
        said.append(_lag_words(lag, offset))
        if lag is not None:
            pose = Stream(
                pose.time_s + lag.at(pose.time_s), pose.values, pose.gaps + lag.at(pose.gaps)
            )
    if rig.press.direction == TRAVEL:
        touching = [
            window.direction
            for window, contact in zip(windows, rough_contacts, strict=True)
            if contact is not None
        ]
        stated = _common_direction(touching, said)
    presses, left_out, free = [], [], 0
    for span in spans:
        window = _window(force, pose, span, mean_direction, stated)
        if window is None:
            continue
        try:
            press = _press(window, rig.rows, force.gaps, pose.gaps)
        except SpoiltPress as reason:
            left_out.append((float(window.time_s[window.depth_m.argmax()]), str(reason)))
            continue
        if press is None:
            free += 1
        else:
            presses.append(press)
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
    said.insert(0, f"{len(presses)} presses were cut, {len(left_out)} were left out.")
    return Cut(tuple(presses), tuple(left_out), lag, offset, tuple(said))


def _into_body(
    force: Stream, pose: Stream, line: np.ndarray, rig: Rig
) -> tuple[float, np.ndarray, list[tuple[float, float]]]:
    """Offset still to add to the pose's clock, mean direction of pressing, spans of the presses.

    Of the line's two directions that one points into the body along which force and depth rise
    together more closely.
    """
    found = []
    for direction in (line, -line):
        vectors = force.values
        along = vectors if vectors.shape[1] == 1 else vectors @ direction[:, None]
        spans = press_spans(pose, direction, force)
        offset, correlation = closer_offset(replace(force, values=along), pose, direction, spans)
        found.append((correlation, offset, direction, spans))
    correlation, offset, direction, spans = max(found, key=lambda one: abs(one[0]))
    if abs(correlation) < TOGETHER:
        raise InputError(
            "force and depth do not rise together in most motions (correlation "
            f"{correlation:.2f}); check force.columns, force.frame, pose.columns and "
            "pose.clock_offset_s"
        )
    if correlation < 0:
        raise InputError(
            f"key force.sign: found {rig.force.sign}, with which the force falls while the tip "
            f"goes into the body; give {-rig.force.sign}"
        )
    return (0.0 if rig.pose and rig.pose.clock_offset_s is not None else offset), direction, spans


def press_spans(pose: Stream, direction: np.ndarray, force: Stream) -> list[tuple[float, float]]:
    """Return begin and end in s of each motion into the body and out again.

    The tip's depth along the mean direction rises and falls once a press; two presses are parted
    in the middle of the shallow stretch between them.
    """
    start = max(pose.time_s[0], force.time_s[0])
    end = min(pose.time_s[-1], force.time_s[-1])
    time = np.arange(start, end, GRID_S)
    if len(time) < 10:
        raise InputError(
            "force and pose overlap by less than 0.1 s; check time.column, or state "
            "pose.clock_offset_s"
        )
    depth = smoothed(pose.at(time)[:, :3] @ direction[:, None], 5)[:, 0]
    padded = np.concatenate([[depth.min()], depth, [depth.min()]])
    peaks, found = find_peaks(padded, prominence=1e-4)
    if not len(peaks):
        raise InputError("the tip does not move; check pose.columns and pose.unit")
    usual = np.quantile(found["prominences"], 0.9)
    peaks = peaks[found["prominences"] > PROMINENT * usual] - 1
    edges = [float(time[0])]
    for a, b in pairwise(peaks.tolist()):
        between = depth[a:b]
        top = min(between[0], depth[b])
        low = np.flatnonzero(between < between.min() + SHALLOW_STROKE * (top - between.min()))
        edges.append(float(time[a + (low[0] + low[-1]) // 2]))
    edges.append(float(time[-1]))
    return list(pairwise(edges))


def _window(
    force: Stream,
    pose: Stream,
    span: tuple[float, float],
    mean_direction: np.ndarray,
    stated: np.ndarray | Stream | None,
) -> Window | None:
    """Cut out the samples of a span in which the tip moves along its line."""
    inside = (force.time_s >= span[0]) & (force.time_s <= span[1])
    time = force.time_s[inside]
    if len(time) < 20:
        return None
    position = pose.at(time)[:, :3]
    depth = smooth(position @ mean_direction, time)
    k = int(depth.argmax())
    stroke = depth[k] - max(depth[: k + 1].min(), depth[k:].min())
    deep = depth > depth[k] - 0.3 * stroke
    if isinstance(stated, Stream):
        direction = stated.at(time[deep]).mean(axis=0)
        direction /= np.linalg.norm(direction)
    elif stated is not None:
        direction = stated
    else:
        centred = position[deep] - position[deep].mean(axis=0)
        direction = np.linalg.svd(centred, full_matrices=False)[2][0]
        direction = direction * np.sign(direction @ mean_direction)
    offset = position - position[k]
    sideways = np.linalg.norm(offset - np.outer(offset @ direction, direction), axis=1)
    outside = np.flatnonzero(sideways > SIDEWAYS_M + SIDEWAYS * stroke)
    low = outside[outside < k].max(initial=-1) + 1
    high = outside[outside > k].min(initial=len(time))
    if high - low < 20:
        return None
    return Window(time[low:high], position[low:high], force.values[inside][low:high], direction)


def _stated_directions(
    recording: Recording, rig: Rig, pose: Stream, offset_s: float
) -> np.ndarray | Stream | None:
    """Directions of pressing that the mapping states: one, one a message, or None for travel."""
    stated = rig.press.direction
    if stated == TRAVEL:
        return None
    if stated in AXES:
        if pose.values.shape[1] == 3:
            raise InputError(
                f'key press.direction: found "{stated}", expected pose.orientation too, or "travel"'
            )
        axis = np.eye(3)["xyz".index(stated[-1])] * (1 if "+" in stated else -1)
        return Stream(pose.time_s, matrices(pose.values[:, 3:]) @ axis, pose.gaps)
    if isinstance(stated[0], str):
        values, _ = numbers(recording, stated, "", "", "press.direction")
        if len(values) != len(pose.time_s):
            raise InputError(
                "key press.direction: expected columns of the pose's table, without repeated rows"
            )
        return Stream(pose.time_s, rotated(rig, values, place=False), pose.gaps)
    direction = rotated(rig, np.array([stated], float), place=False)[0]
    return direction / np.linalg.norm(direction)


def _contact_or_none(window: Window) -> Contact | None:
    try:
        return find_contact(window.time_s, window.force_n, window.depth_m)
    except SpoiltPress:
        return None


def _lag_of(
    windows: Sequence[Window], contacts: Sequence[Contact | None], pose: Stream
) -> Lag | None:
    force_time, force, pose_time, travel = [], [], [], []
    for window, contact in zip(windows, contacts, strict=True):
        if contact is None:
            continue
        rows = slice(contact.touch, contact.release + 1)
        time = window.time_s[rows]
        step = max(min(pose.step_s, float(np.median(np.diff(time)))), 1e-3)
        grid = np.arange(time[0] - 0.1, time[-1] + 0.1, step)
        depth = pose.at(grid)[:, :3] @ window.direction
        force_time.append(time)
        force.append((window.force_n - contact.tare_n)[rows])
        pose_time.append(grid)
        travel.append(depth - window.depth_m[contact.touch])
    return find_lag(force_time, force, pose_time, travel)


def _lag_words(lag: Lag | None, offset_s: float) -> str:
    if lag is None:
        return (
            f"The offset of the clocks is {offset_s:.3f} s to {GRID_S * 1e3:.0f} ms; no press "
            "shows the lag between force and pose more closely."
        )
    total = offset_s + lag.lag_s
    size = f"{1e3 * total:.1f} ms" if abs(total) < 1 else f"{total:.4f} s"
    words = (
        f"The force lags the pose by {size} (standard deviation {1e3 * lag.error_s:.2g} ms, "
        f"{lag.presses} presses); the pose was moved by it."
    )
    if lag.rate:
        words += f" The clocks differ in speed by {1e6 * lag.rate:.0f} ppm, which was taken out."
    return words


def _common_direction(directions: Sequence[np.ndarray], said: list[str]) -> np.ndarray | None:
    """One direction where all presses go the same way, None where each has its own."""
    if not directions:
        return None
    mean = np.mean(directions, axis=0)
    mean /= np.linalg.norm(mean)
    angle = np.degrees(np.arccos(np.clip(np.array(directions) @ mean, -1, 1)))
    x, y, z = mean
    if np.quantile(angle, 0.9) < ONE_DIRECTION_DEG:
        said.append(f"All presses go along ({x:.4f}, {y:.4f}, {z:.4f}), by the tip's travel.")
        return mean
    said.append(f"Each press has the direction of its own travel, up to {angle.max():.0f} degrees "
                "from their mean.")  # fmt: skip
    return None


def _press(
    window: Window, rows: Rows, force_gaps: np.ndarray, pose_gaps: np.ndarray
) -> CutPress | None:
    time, depth = window.time_s, window.depth_m
    contact = find_contact(time, window.force_n, depth)
    if contact is None:
        return None
    force = window.force_n - contact.tare_n
    inside = slice(contact.touch, contact.release + 1)
    length = time[contact.release] - time[contact.touch]
    for gaps, name in ((force_gaps, "force"), (pose_gaps, "pose")):
        for start, end in gaps:
            overlap = min(end, time[contact.release]) - max(start, time[contact.touch] - 0.05)
            if overlap > min(LONGEST_GAP_S, LONGEST_GAP * length):
                raise SpoiltPress(f"{1e3 * (end - start):.0f} ms of the {name} are missing")
    even_depth, even_force = smooth(depth, time), smooth(force, time)
    peak = float(even_force[inside].max())
    noise = noise_of(window.force_n[:, None])[0]
    if abs(contact.jump_n) > max(JUMP * peak, 3 * noise) and _stands_out(contact.jump_n, peak):
        raise SpoiltPress(
            f"the force without contact differs by {contact.jump_n:.3g} N before and after"
        )
    travel = float(even_depth[inside].max() - even_depth[contact.touch])
    top = int(np.flatnonzero(even_depth >= even_depth[contact.touch] + TOUCH_SHARE * travel)[0])
    way_in = slice(int(np.searchsorted(time, time[contact.touch] - TARE_S)), top + 1)
    touch, rough = find_touch(depth[way_in], force[way_in], travel)
    contact = tared_at(contact, time, window.force_n, even_depth, touch)
    force = window.force_n - contact.tare_n
    even_force = smooth(force, time)
    if rough > 3 * noise + ROUGH_FIT * peak:
        raise SpoiltPress(f"the force on the way in is no smooth curve (off by {rough:.2g} N)")
    first = (
        int(np.flatnonzero(even_depth[: top + 1] < touch)[-1]) + 1
        if np.any(even_depth[: top + 1] < touch)
        else contact.touch
    )
    held = hold_of(even_depth[first : contact.release + 1] - touch,
                   even_force[first : contact.release + 1], PLATEAU)  # fmt: skip
    parts = (
        ("load", first, first + held.start, rows.load),
        ("hold", first + held.start, first + held.stop, rows.hold),
        ("unload", first + held.stop, contact.release + 1, rows.unload),
    )
    made = [
        (name, [means(values, low, high, count) for values in (time, force, depth - touch)])
        for name, low, high, count in parts
    ]
    loading = slice(first, first + held.start)
    beside = window.position_m[loading] - np.outer(depth[loading], window.direction)
    return CutPress(
        touch_s=float(time[first]),
        release_s=float(time[contact.release]),
        point_m=beside.mean(axis=0) + touch * window.direction,
        direction=window.direction,
        time_s=np.concatenate([columns[0] for _, columns in made]),
        force_n=np.concatenate([columns[1] for _, columns in made]),
        displacement_m=np.concatenate([columns[2] for _, columns in made]),
        phase=np.concatenate([np.full(len(columns[0]), name, "U8") for name, columns in made]),
    )


def _stands_out(jump: float, peak: float) -> bool:
    return abs(jump) > 0.15 * peak


def means(values: np.ndarray, low: int, high: int, count: int) -> np.ndarray:
    """Means over `count` short stretches, evenly over the samples low to high, the end included.

    A stretch covers a quarter of the way to the next, so that a curved course is not flattened.
    """
    n = high - low
    if n < 2 or count == 0:
        return np.zeros(0)
    count = min(count, n)
    ends = low + np.arange(1, count + 1) * n // count - 1
    half = n // count // 8
    return np.array([values[max(end - 2 * half, low) : end + 1].mean() for end in ends])


def _without_weak(presses: Sequence[CutPress]) -> tuple[list[CutPress], list[tuple[float, str]]]:
    peaks = np.array([press.force_n.max() for press in presses])
    weak = peaks < WEAK * np.median(peaks) if len(peaks) else np.zeros(0, dtype=bool)
    kept = [press for press, is_weak in zip(presses, weak, strict=True) if not is_weak]
    left = [(press.touch_s, f"a force of {press.force_n.max():.2g} N is hardly a contact")
            for press, is_weak in zip(presses, weak, strict=True) if is_weak]  # fmt: skip
    return kept, left
