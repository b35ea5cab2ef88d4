"""Force and pose of a recording on one clock, in the scan's frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models import InputError
from palpmap.importing.mapping.columns import matrices, numbers, rotated, seconds
from palpmap.importing.mapping.rig import AXES, TRAVEL, Rig
from palpmap.importing.readers.recording import PART, Recording
from palpmap.importing.streams.clocks import rough_offsets, share_clock
from palpmap.importing.streams.contact import Contact, SpoiltPress
from palpmap.importing.streams.lag import Lag, find_lag
from palpmap.importing.streams.limit import limited_spans, without_spans
from palpmap.importing.streams.path import smooth_path
from palpmap.importing.streams.press import Window, rough_contact, window_of
from palpmap.importing.streams.spans import Way, check_way, way_along
from palpmap.importing.streams.stream import (
    Stream,
    in_base,
    noise_of_moving,
    read_force,
    read_pose,
    without_jumps,
)
from palpmap.importing.streams.weight import without_weight

ONE_DIRECTION_DEG = 2.0
MOST_ROUNDS, SETTLED_S = 4, 3.0e-3
ALIKE = 4.0  # times what the best offset of two clocks leaves unexplained: another as good
UNSEEN_S = 0.05  # error of the clocks' offset where no press shows the lag


@dataclass(frozen=True, eq=False)
class Aligned:
    """Force and pose on one clock, in the scan's frame.

    Attributes
    ----------
    sensor, unweighed, force : force in the sensor's axes; in the scan's frame; without the tool's
        weight and the sensor's bias, where the tip's turning shows them
    pose : of the tip's end, smoothed
    pose_noise_m : standard deviation of one reading of its position, the noisiest axis
    direction : (3,) mean direction of pressing
    spans : begin and end of each motion into the body and out again, s
    stated : direction of each press, see `palpmap.importing.streams.press.window_of`
    lag : of the force behind the pose, in s with rough offset; None where it is stated, or cannot
        be seen
    lag_error_s : its standard deviation; 0 where it is stated
    offset_s : rough offset of the clocks
    jumps_s : times at which the sensor was set to zero anew, s
    limits_s : begin and end of each stretch at the sensor's limit, which the force is without, s
    """

    sensor: Stream
    unweighed: Stream
    force: Stream
    pose: Stream
    pose_noise_m: float
    direction: np.ndarray
    spans: list[tuple[float, float]]
    stated: np.ndarray | Stream | None
    lag: Lag | None
    lag_error_s: float
    offset_s: float
    jumps_s: list[float]
    limits_s: list[tuple[float, float]]


def aligned(recording: Recording, rig: Rig, said: list[str]) -> Aligned:
    """Bring force and pose of a recording together, and take re-tares and the tool's weight out.

    Raises
    ------
    InputError
        A stream in which no presses are seen, with the key that would help.
    """
    assert rig.pose  # `Rig.needed` asks
    if rig.parts:
        return _of_parts(recording, rig, said)
    read = force = read_force(recording, rig, said)
    pose = read_pose(recording, rig, rig.pose, said)
    force, jumps = without_jumps(force, pose if share_clock(force, pose) else None)
    said += [
        f"At {time:.2f} s the force jumps by {size:.3g} N from one message to the next and stays: "
        "the sensor was set to zero anew; the force was run on."
        for time, size in jumps
    ]
    sensor = force
    force, pose, way, offset = _roughly_aligned(force, pose, rig)
    pose, offset = pose.later(way.offset_s), offset + way.offset_s
    mean_direction, spans = way.direction, way.spans
    stated = _stated_directions(recording, rig, pose, offset)
    lag, unweighed, words, limits = None, force, [], []
    turns = rig.force.frame == "tip" and force.values.shape[1] == 3
    for k in range(MOST_ROUNDS):  # where the contact begins depends on the lag, and it on that
        windows, contacts = _touching(force, pose, spans, mean_direction, stated)
        if turns:
            words = []
            if lag is None or lag.has_corners:  # a lag of soft stops is known no better than before
                unweighed = _in_base(sensor, pose, rig)
            force = without_weight(unweighed, pose, windows, contacts, words)
            if k == 0:  # until then a weight that turns looks like contact
                windows, contacts = _touching(force, pose, spans, mean_direction, stated)
        if k == 0 and (limits := limited_spans(read, windows, contacts, rig.force.named[0], said)):
            sensor, unweighed, force = (
                without_spans(stream, limits) for stream in (sensor, unweighed, force)
            )
            windows, contacts = _touching(force, pose, spans, mean_direction, stated)
        if rig.pose.clock_offset_s is not None:
            break
        more = _lag_of(windows, contacts, pose, mean_direction)
        if more is None:
            break
        pose = Stream(
            pose.time_s + more.at(pose.time_s), pose.values, pose.gaps + more.at(pose.gaps)
        )
        lag = more if lag is None else lag.and_then(more)
        if abs(more.lag_s) < SETTLED_S:
            break
    said += words
    lag_error_s = 0.0
    if rig.pose.clock_offset_s is None:
        said.append(_lag_words(lag, offset))
        lag_error_s = lag.error_s if lag else UNSEEN_S
    if rig.press.direction == TRAVEL:
        felt = zip(windows, contacts, strict=True)
        stated = _common_direction([w.direction for w, contact in felt if contact], said)
    noise = float(noise_of_moving(pose.values[:, :3]).max())
    path = smooth_path(pose)
    return Aligned(
        sensor, unweighed, force, path, noise, mean_direction, spans, stated, lag, lag_error_s,
        offset, [time for time, _ in jumps], limits,
    )  # fmt: skip


def _of_parts(recording: Recording, rig: Rig, said: list[str]) -> Aligned:
    """Presses in files of their own: each file is a span, and force and travel have one clock."""
    assert rig.pose
    read, pose = read_force(recording, rig, []), read_pose(recording, rig, rig.pose, [])
    force, _ = without_jumps(_in_base(read, pose, rig), pose)
    _, table = numbers(recording, rig.pose.columns, "m", "length", "pose.columns", True)
    time = seconds(recording, table, rig.time, "time")
    assert time is not None  # the force has been read by it
    part = table.columns.get(PART, np.zeros(len(table)))
    spans = [
        (float(time[part == k].min()), float(time[part == k].max())) for k in range(len(rig.parts))
    ]
    said.append(f"Each of the {len(spans)} files is one press, at the place that the mapping says.")
    stated = _stated_directions(recording, rig, pose, 0.0)
    assert isinstance(stated, np.ndarray)  # the mapping's own rule for parts
    touching = _touching(force, pose, spans, stated, stated)
    limits = limited_spans(read, *touching, rig.force.named[0], said)
    force = without_spans(force, limits)
    noise = float(noise_of_moving(pose.values[:, :3]).max())
    return Aligned(
        force, force, force, pose, noise, stated, spans, stated, None, 0.0, 0.0, [], limits
    )


def force_with_depth(recording: Recording, rig: Rig) -> float:
    """Return how closely force and depth rise together by a mapping, -1 to 1.

    Raises
    ------
    InputError
        If they do not at all, or against each other.
    """
    assert rig.pose  # the caller's mapping has one
    force, pose = read_force(recording, rig, []), read_pose(recording, rig, rig.pose, [])
    force, _ = without_jumps(force, pose if share_clock(force, pose) else None)
    return _roughly_aligned(force, pose, rig)[2].correlation


def _roughly_aligned(force: Stream, pose: Stream, rig: Rig) -> tuple[Stream, Stream, Way, float]:
    """Force and pose in the base's frame, the way into the body, and the clocks' rough offset."""
    assert rig.pose
    found = []
    for rough in rough_offsets(force, pose, rig.pose.clock_offset_s):
        moved = pose.later(rough.offset_s)
        turned = _in_base(force, moved, rig)
        found.append((turned, moved, way_along(turned, moved, rough.line), rough.offset_s))
    found.sort(key=lambda one: one[2].rest)
    alike = [one for one in found if one[2].rest <= ALIKE * found[0][2].rest]
    if len(alike) > 1:
        raise InputError(
            "key pose.clock_offset_s: force and pose have clocks of their own, and offsets of "
            f"{alike[0][3]:.2f} s and {alike[1][3]:.2f} s fit alike, as the presses follow each "
            "other evenly; state the offset that gives the force's clock"
        )
    turned, moved, way, offset_s = found[0]
    check_way(way, rig.force.sign)
    if rig.pose.clock_offset_s is not None:
        way = replace(way, offset_s=0.0)
    return turned, moved, way, offset_s


def _in_base(force: Stream, pose: Stream, rig: Rig) -> Stream:
    """Return the force in the base's frame; one column stays as it is."""
    if force.values.shape[1] == 1:
        return force
    return replace(force, values=in_base(rig, force, pose))


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


def _touching(
    force: Stream,
    pose: Stream,
    spans: Sequence[tuple[float, float]],
    direction: np.ndarray,
    stated: np.ndarray | Stream | None,
) -> tuple[list[Window], list[Contact | None]]:
    """Motions into the body, and the contact in each."""
    windows = [window_of(force, pose, span, direction, stated) for span in spans]
    windows = [window for window in windows if window is not None]
    return windows, [_contact_or_none(window) for window in windows]


def _contact_or_none(window: Window) -> Contact | None:
    try:
        return rough_contact(window)
    except SpoiltPress:
        return None


def _lag_of(
    windows: Sequence[Window],
    contacts: Sequence[Contact | None],
    pose: Stream,
    direction: np.ndarray,
) -> Lag | None:
    force_time, force, pose_time, travel = [], [], [], []
    for window, contact in zip(windows, contacts, strict=True):
        if contact is None:
            continue
        rows = slice(contact.touch, contact.release + 1)
        time = window.time_s[rows]
        step = max(min(pose.step_s, float(np.median(np.diff(time)))), 1e-3)
        grid = np.arange(time[0] - 0.2, time[-1] + 0.2, step)
        depth = pose.at(grid)[:, :3] @ window.direction
        force_time.append(time)
        force.append((window.force_n - contact.tare_n)[rows])
        pose_time.append(grid)
        travel.append(depth - window.depth_m[contact.touch])
    along = pose.values[:, :3] @ direction[:, None]
    pose_noise = float(noise_of_moving(along)[0] * np.sqrt(pose.step_s))
    return find_lag(force_time, force, pose_time, travel, pose_noise)


def _lag_words(lag: Lag | None, offset_s: float) -> str:
    if lag is None:
        return (
            f"The offset of the clocks is {offset_s:.3f} s to some {UNSEEN_S * 1e3:.0f} ms; no "
            "press shows the lag between force and pose more closely."
        )
    total = offset_s + lag.lag_s
    size = f"{1e3 * total:.1f} ms" if abs(total) < 1 else f"{total:.4f} s"
    words = (
        f"The force lags the pose by {size} (standard deviation {1e3 * lag.error_s:.2g} ms, "
        f"{lag.presses} presses); the pose was moved by it."
    )
    if lag.doubt:
        words += f" It is {lag.doubt}."
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
    x, y, z = np.round(mean, 4) + 0.0  # no -0
    if np.quantile(angle, 0.9) < ONE_DIRECTION_DEG:
        said.append(f"All presses go along ({x:.4f}, {y:.4f}, {z:.4f}), by the tip's travel.")
        return mean
    said.append(f"Each press has the direction of its own travel, up to {angle.max():.0f} degrees "
                "from their mean.")  # fmt: skip
    return None
