"""One press in a stream: free before, in contact, free after; its tare and its first touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar, nnls

from palpmap.importing.streams.clocks import SMOOTHED_S, smooth

NOISE_LEVELS = 5.0
LEAST_CONTACT = 0.03  # of the press's largest force
SHALLOW = 0.2  # share of a side's free samples, the shallowest, by which contact is first told
TARE_S, TARE_STEPS = 0.4, 12  # of free samples next to the contact: whichever lasts longer
FEWEST_FREE = 6
RETURNED = 0.03  # of the stroke: less above the deepest point, the recording ends there
AGAIN = 0.2  # of the largest force: felt outside the contact, the tip touched twice
TOUCH_SHARE = 0.6  # of the travel: the part of the way in from which the touch is found


class SpoiltPress(Exception):
    """A press that cannot be used; the message says why."""


@dataclass(frozen=True)
class Contact:
    """Where in a press's samples the tip is in contact.

    Attributes
    ----------
    touch, release : first and last sample in contact
    tare_n : (m,) the force without contact, a line from before to after
    jump_n : by how much the force after differs from that before, N
    returns : false for a recording that ends where the tip is deepest
    """

    touch: int
    release: int
    tare_n: np.ndarray
    jump_n: float
    returns: bool = True


def find_contact(
    time: np.ndarray, force: np.ndarray, depth: np.ndarray, free_n: float | None = None
) -> Contact | None:
    """Find the contact in the samples of one press; None where the tip feels nothing.

    Parameters
    ----------
    time, force, depth : (m,) s, N along the direction, m along it
    free_n : force before the contact; found where the tip is shallowest, if not given

    Raises
    ------
    SpoiltPress
        No free samples before it, or the tip touched more than once.
    """
    even, even_depth = smooth(force, time), smooth(depth, time)
    top = int(even_depth.argmax())
    returns = bool(even_depth[-1] < even_depth[top] - RETURNED * np.ptp(even_depth))
    before = free_n if free_n is not None else _free_level(even, depth, slice(0, top))
    after = _free_level(even, depth, slice(top, len(force))) if returns else before
    if before is None or after is None:
        return None
    peak = float(even.max()) - before
    noise = 1.4826 * np.median(np.abs(np.diff(force))) / np.sqrt(2)
    count = max(1, int(SMOOTHED_S / np.median(np.diff(time))))
    threshold = max(NOISE_LEVELS * noise / np.sqrt(count), LEAST_CONTACT * peak)
    most = int(even.argmax())
    if peak < 2 * threshold or peak < NOISE_LEVELS * noise:
        return None
    off = np.flatnonzero(even[:most] < before + threshold)
    if not len(off):
        raise SpoiltPress("the recording begins in contact")
    touch = int(off[-1]) + 1
    off = np.flatnonzero(even[most:] < after + threshold)
    if returns and not len(off):
        raise SpoiltPress("the recording ends in contact")
    release = most + int(off[0]) - 1 if returns else len(force) - 1
    as_deep = depth > depth[touch] - 0.05 * np.ptp(depth)
    felt = max(AGAIN * peak, 2 * threshold)  # noise crosses the threshold itself
    again = np.concatenate(
        [even[:touch] > before + felt, even[release + 1 :] > after + felt]
    ) & np.concatenate([as_deep[:touch], as_deep[release + 1 :]])
    if np.sum(again) > 0.03 / np.median(np.diff(time)):
        raise SpoiltPress("the tip touched more than once")
    return _tared(time, force, touch, release, count, returns)


def _free_level(even: np.ndarray, depth: np.ndarray, side: slice) -> float | None:
    if side.stop - side.start < FEWEST_FREE:
        return None
    d, f = depth[side], even[side]
    shallow = d <= d.min() + SHALLOW * np.ptp(d)
    return float(np.median(f[shallow]))


def _tared(
    time: np.ndarray, force: np.ndarray, touch: int, release: int, margin: int, returns: bool
) -> Contact:
    """Tare on the free samples next to the contact, a margin away from it."""
    first, last, width = touch - margin, release + 1 + margin, tare_s(time)
    early = (time >= time[touch] - width) & (np.arange(len(time)) < first)
    late = (time <= time[release] + width) & (np.arange(len(time)) > last)
    sides = [(early, "approach", "tare the force"), (late, "retreat", "see the sensor's drift")]
    for free, way, use in sides if returns else sides[:1]:
        if np.sum(free) < FEWEST_FREE:
            raise SpoiltPress(
                f"fewer than {FEWEST_FREE} samples of the {way} are free of contact, too few to "
                f"{use}: press from higher above the body, move slower or log faster"
            )
    start = float(force[early].mean())
    if not returns:
        return Contact(touch, release, np.full(len(time), start), 0.0, returns)
    end = float(force[late].mean())
    share = np.clip((time - time[early].mean()) / (time[late].mean() - time[early].mean()), 0, 1)
    return Contact(touch, release, start + (end - start) * share, end - start)


def tare_s(time: np.ndarray) -> float:
    """Duration of the free samples next to a contact that count, s, for samples at times (m,) s."""
    return max(TARE_S, TARE_STEPS * float(np.median(np.diff(time))))


def tared_at(
    contact: Contact, time: np.ndarray, force: np.ndarray, depth: np.ndarray, touch_m: float
) -> Contact:
    """Tare again by the samples above the touch: the rough threshold leaves some in contact out.

    Parameters
    ----------
    touch_m : depth of first touch
    """
    above = depth < touch_m
    first = np.flatnonzero(above[: contact.touch + 1]).max(initial=0)
    behind = np.flatnonzero(above[contact.release :])
    last = contact.release + int(behind[0]) if len(behind) else len(time)
    return _tared(time, force, int(first), min(last, len(time) - 1), 0, contact.returns)


def find_touch(
    depth: np.ndarray, force: np.ndarray, travel_guess: float
) -> tuple[float, float, float]:
    """Return the depth of first touch, its standard deviation in m, and the fit's residual in N.

    The force on the way in is taken to be constant up to the touch and then to rise by a sum of a
    concave, a linear and two convex functions of the travel, none negative. A threshold on the
    force would find the touch too late on a soft body.

    Parameters
    ----------
    depth, force : (m,) of the way in, free samples included, force tared
    travel_guess : m, of the whole press
    """

    def law(touch: float) -> tuple[np.ndarray, np.ndarray, float]:
        x = np.maximum(depth - touch, 0.0) / travel_guess
        columns = np.column_stack([x - 0.6 * x**2, x, x**1.5, x**2.5])
        columns -= columns.mean(axis=0)
        return columns, *nnls(columns, centred)

    def fitted(touch: float) -> float:
        return law(touch)[2]

    centred = force - force.mean()
    deepest = float(depth.max())
    grid = np.linspace(deepest - 1.6 * travel_guess, deepest - 0.15 * travel_guess, 40)
    losses = [fitted(touch) for touch in grid]
    k = int(np.clip(np.argmin(losses), 1, len(grid) - 2))
    # Any: scipy's stubs say object
    best: Any = minimize_scalar(fitted, bounds=(grid[k - 1], grid[k + 1]), method="bounded",
                           options={"xatol": 1e-4 * travel_guess})  # fmt: skip
    columns, weights, _ = law(best.x)
    independent = len(depth) / correlation_length(centred - columns @ weights)
    # a sum of squares that grows slowly further away makes the error larger than it is near
    aside = 0.01 * travel_guess * np.arange(1, 81)
    grown = [np.array([fitted(best.x + way * d) for d in aside]) ** 2 for way in (1, -1)]
    error = 0.0
    for deviations in (2, 4):
        limit = best.fun**2 * (1 + deviations**2 / max(independent - 5, 1))
        beyond = [np.flatnonzero(sums > limit) for sums in grown]
        width = max(aside[k[0]] if len(k) else aside[-1] for k in beyond)
        error = max(error, width / deviations)
    return float(best.x), float(error), float(best.fun / np.sqrt(len(depth)))


def correlation_length(values: np.ndarray) -> float:
    """Return how many neighbours count as one independent value, at least 1.

    It is 1 + 2 sum of the autocorrelation, up to where pairs of it first fall below 0 (Geyer 1992,
    initial positive sequence).

    >>> rng = np.random.default_rng(0)
    >>> white = rng.standard_normal(4000)
    >>> round(correlation_length(white)), round(correlation_length(np.repeat(white, 5)))
    (1, 5)
    """
    centred = values - values.mean()
    n = len(centred)
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    course = np.fft.irfft(spectrum)[: n - n % 2]
    if course[0] <= 0:
        return 1.0
    pairs = course.reshape(-1, 2).sum(axis=1) / course[0]
    below = np.flatnonzero(pairs <= 0)
    end = int(below[0]) if len(below) else len(pairs)
    return max(1.0, 2 * float(pairs[:end].sum()) - 1)
