"""One press of a stream, as rows of a scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpmap.importing.mapping.rig import Rows
from palpmap.importing.streams.clocks import smooth
from palpmap.importing.streams.contact import (
    FEWEST_FREE,
    TOUCH_SHARE,
    Contact,
    SpoiltPress,
    find_contact,
    find_touch,
    tare_s,
    tared_at,
)
from palpmap.importing.streams.stream import Stream, noise_of

SIDEWAYS_M = 1.0e-3
SIDEWAYS = 0.2  # of the stroke
LONGEST_GAP_S = 0.1
LONGEST_GAP = 0.08  # of the contact
HOLD_SMOOTHED_S = 0.06  # at least: noise of the speed stops no tip
HOLD_SMOOTHED = 0.1  # of the way in
STILL = 0.25  # of the speed on the way in or out: slower, the tip holds
LEFT = 0.03  # of the travel: so far out, the hold is over
ROUGH_FIT = 0.05  # of the largest force: the way in is no smooth curve
RISEN = 0.05  # of the largest force, at TOUCH_SHARE of the way in
UNSURE = 0.2  # of the travel: a touch this uncertain (one standard deviation) is none
JUMP = 0.15  # of the largest force, between before and after


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
    touch_error_m : standard deviation of the depth of first touch
    point_m, direction : (3,)
    time_s, force_n, displacement_m, phase : rows of the scan
    """

    touch_s: float
    release_s: float
    touch_error_m: float
    point_m: np.ndarray
    direction: np.ndarray
    time_s: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    phase: np.ndarray


def window_of(
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


def cut_press(
    window: Window,
    rows: Rows,
    force_gaps: np.ndarray,
    pose_gaps: np.ndarray,
    limits_s: Sequence[tuple[float, float]] = (),
) -> CutPress | None:
    """Tare the force, find the first touch and the hold, and take the rows; None without contact.

    Parameters
    ----------
    force_gaps, pose_gaps : (g, 2) begin and end of pauses in the messages, s
    limits_s : begin and end of each stretch at the sensor's limit, s; the window is without it, and
        the rows end there, as what the body did beyond is unknown

    Raises
    ------
    SpoiltPress
        With the reason why the press cannot be used.
    """
    time, depth = window.time_s, window.depth_m
    contact = rough_contact(window)
    if contact is None:
        return None
    force = window.force_n - contact.tare_n
    inside = slice(contact.touch, contact.release + 1)
    _refuse_gaps(time, contact, force_gaps, pose_gaps)
    even_depth, even_force = smooth(depth, time), smooth(force, time)
    peak = float(even_force[inside].max())
    noise = noise_of(window.force_n[:, None])[0]
    if abs(contact.jump_n) > max(JUMP * peak, 3 * noise):
        raise SpoiltPress(
            f"the force without contact differs by {contact.jump_n:.3g} N before and after"
        )
    travel, way_in = _way_in(time, even_depth, contact)
    touch, touch_error, rough = find_touch(depth[way_in], force[way_in], travel)
    if touch_error > UNSURE * travel:
        raise SpoiltPress(
            f"the depth of first touch is known to {1e3 * touch_error:.2g} mm only, of a travel of "
            f"{1e3 * travel:.2g} mm; deeper or slower presses show it better"
        )
    felt_until = contact.release
    contact = tared_at(contact, time, window.force_n, even_depth, touch)
    force = window.force_n - contact.tare_n
    even_force = smooth(force, time)
    if rough > 3 * noise + ROUGH_FIT * peak:
        raise SpoiltPress(f"the force on the way in is no smooth curve (off by {rough:.2g} N)")
    above = np.flatnonzero(even_depth[: way_in.stop] < touch)
    first = int(above[-1]) + 1 if len(above) else contact.touch
    # A viscous body stays behind: the tip leaves it before it is back where it touched
    ends = [start for start, _ in limits_s if time[first] < start < time[felt_until]]
    stop = int(np.searchsorted(time, min(ends))) if ends else felt_until + 1
    if stop - first < FEWEST_FREE:
        raise SpoiltPress("the sensor reaches its limit almost at the touch")
    touched = slice(first, stop)
    held = _hold(time[touched], depth[touched] - touch, contact.returns and not ends)
    loading = slice(first, first + held.start)
    beside = window.position_m[loading] - np.outer(depth[loading], window.direction)
    columns = np.column_stack([time, force, depth - touch])[touched]
    phase, averaged = _averaged(columns, held, rows)
    return CutPress(
        touch_s=float(time[first]),
        release_s=float(time[contact.release]),
        touch_error_m=touch_error,
        point_m=beside.mean(axis=0) + touch * window.direction,
        direction=window.direction,
        time_s=averaged[:, 0],
        force_n=averaged[:, 1],
        displacement_m=averaged[:, 2],
        phase=phase,
    )


def _refuse_gaps(
    time: np.ndarray, contact: Contact, force_gaps: np.ndarray, pose_gaps: np.ndarray
) -> None:
    start_s, end_s = time[contact.touch], time[contact.release]
    longest = min(LONGEST_GAP_S, LONGEST_GAP * (end_s - start_s))
    for gaps, name in ((force_gaps, "force"), (pose_gaps, "pose")):
        for start, end in gaps.tolist():
            if min(end, end_s) - max(start, start_s - 0.05) > longest:
                raise SpoiltPress(f"{1e3 * (end - start):.0f} ms of the {name} are missing")


def rough_contact(window: Window) -> Contact | None:
    """Find the contact of a press, anew where the force has not risen on most of the way in.

    High above the body, where the tip still turns, the free force may be another than next to it.
    """
    time, depth = window.time_s, window.depth_m
    contact = find_contact(time, window.force_n, depth)
    if contact is None:
        return None
    _, way_in = _way_in(time, smooth(depth, time), contact)
    force = smooth(window.force_n - contact.tare_n, time)
    if force[way_in.stop - 1] > RISEN * force[contact.touch : contact.release + 1].max():
        return contact
    return find_contact(time, window.force_n, depth, float(np.median(window.force_n[way_in])))


def _way_in(time: np.ndarray, depth: np.ndarray, contact: Contact) -> tuple[float, slice]:
    """Travel of a rough contact, m, and the samples from which its touch is found."""
    start = depth[contact.touch]
    travel = float(depth[contact.touch : contact.release + 1].max() - start)
    top = int(np.flatnonzero(depth >= start + TOUCH_SHARE * travel)[0])
    return travel, slice(int(np.searchsorted(time, time[contact.touch] - tare_s(time))), top + 1)


def _hold(time: np.ndarray, travel: np.ndarray, returns: bool) -> slice:
    """Return the samples in which the tip holds: after it has slowed, before it goes out.

    Parameters
    ----------
    time, travel : (m,) of the contact, s and m
    returns : false if it holds to the end, or goes in to the end
    """
    ramp = time[int(np.flatnonzero(smooth(travel, time) > 0.5 * travel.max())[0])] - time[0]
    even = smooth(travel, time, max(HOLD_SMOOTHED_S, HOLD_SMOOTHED * 2 * ramp))
    speed = np.gradient(even, time)
    deep = np.flatnonzero(even > 0.5 * even.max())
    going_in, going_out = int(deep[0]), int(deep[-1])
    usual_in = np.quantile(speed[: going_in + 1], 0.8)
    usual_out = np.quantile(-speed[going_out:], 0.8)
    slow = np.flatnonzero(speed[going_in:] < STILL * usual_in)
    still = np.flatnonzero(speed[: going_out + 1] > -STILL * usual_out)
    first = going_in + int(slow[0]) if len(slow) else len(time)
    last = int(still[-1]) + 1 if len(still) else 0
    if not returns:
        return slice(min(first, len(time)), len(time))
    if last - first < 2:  # no hold: the way in ends where it is deepest
        first = last = int(even.argmax()) + 1
    else:  # a tip that starts softly has left long before it is fast
        high = np.flatnonzero(even[:last] > np.quantile(even[first:last], 0.9) - LEFT * even.max())
        last = max(int(high[-1]) + 1, first + 2)
    return slice(first, last)


def _averaged(columns: np.ndarray, held: slice, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Phase (r,) and rows (r, k) of a press's samples in contact (m, k), averaged."""
    parts = (
        ("load", 0, held.start, rows.load),
        ("hold", held.start, held.stop, rows.hold),
        ("unload", held.stop, len(columns), rows.unload),
    )
    means = [_means(columns, low, high, count) for _, low, high, count in parts]
    names = [name for name, *_ in parts]
    return np.repeat(np.array(names), [len(mean) for mean in means]), np.concatenate(means)


def _means(values: np.ndarray, low: int, high: int, count: int) -> np.ndarray:
    """Means (count, k) over short stretches, evenly over the samples low to high, the end included.

    A stretch covers a quarter of the way to the next, so that a curved course is not flattened.
    """
    n = high - low
    if n < 2 or count == 0:
        return values[:0]
    count = min(count, n)
    ends = low + np.arange(1, count + 1) * n // count - 1
    half = n // count // 8
    return np.array([values[max(end - 2 * half, low) : end + 1].mean(axis=0) for end in ends])
