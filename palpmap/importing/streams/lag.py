"""The lag between force and pose, to a millisecond or two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from palpmap.importing.streams.clocks import smooth

GRID_S = 0.01
MEAN_S = 0.11  # both are averaged alike: a pose's remaining noise makes the force seem to lead
GAP_S = 0.03  # messages missing: the mean around them is not used
CORNER_SMOOTHED_S = 0.08
CORNER_S, CORNER = 0.08, 0.7  # a change of speed by this share in twice this time is a corner
SHARPNESS, LAW_S = (0.7, 0.95), (7.0e-3, 1.0e-3)  # what the force's law adds to the lag's error
FURTHEST_S, SEARCH_STEP_S = 0.24, 0.004
TRIMMED_S = 0.06  # of both ends of a contact, where lag and touch mix
CONTACT_SHARE = 0.07  # of a press's travel: below it the touch itself disturbs
CORNER_SHARE = 0.1
RELAXATION_S = (0.1, 0.3, 1.0, 4.0)
RELAXES = 4.0  # chi-square that eight common weights must take
OUTLYING = 9.0  # times the usual variance: a press that does not count
_WIDE = np.arange(-FURTHEST_S, FURTHEST_S + SEARCH_STEP_S, 2 * SEARCH_STEP_S)


@dataclass(frozen=True)
class Lag:
    """Correction of the pose's clock beyond the rough offset.

    Attributes
    ----------
    lag_s : at `middle_s`
    rate : seconds of lag gained in a second: the clocks' difference in speed, 0 if not seen
    middle_s : of the recording, on the pose's clock
    error_s : standard deviation of the lag
    presses : number of presses that determine it
    has_corners : whether the tip stops and starts sharply, which fixes the lag within some 2 ms
    """

    lag_s: float
    rate: float
    middle_s: float
    error_s: float
    presses: int
    has_corners: bool

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the lag at times of the pose's clock, s."""
        return self.lag_s + self.rate * (time_s - self.middle_s)

    def and_then(self, more: Lag) -> Lag:
        """Return the sum with what was found after this lag was taken out."""
        return replace(more, lag_s=self.lag_s + more.lag_s, rate=self.rate + more.rate)


def find_lag(
    force_time: Sequence[np.ndarray],
    force: Sequence[np.ndarray],
    pose_time: Sequence[np.ndarray],
    travel: Sequence[np.ndarray],
) -> Lag | None:
    """Estimate the lag between force and travel from all presses; None if no press shows it.

    In each press the force is taken to be a smooth function of travel, other while the tip goes
    out than while it goes in, plus its relaxation at four rates: a body's own viscosity is thus
    not mistaken for a lag, unless it relaxes faster than in 0.1 s. Where the tip stops sharply and
    all presses together show no relaxation, it is left out. The lag is where the sum of squares is
    least; corners of the motion decide it.

    Parameters
    ----------
    force_time, force : of each press, s and N, contact only
    pose_time, travel : of each press, s and m, from before the touch; even steps
    """
    courses = [_course(*one) for one in zip(force_time, force, pose_time, travel, strict=True)]
    courses = [course for course in courses if course is not None]
    sharp = [_sharpest(tp, x) for tp, x in zip(pose_time, travel, strict=True)]
    sharpness = float(np.median(sharp)) if sharp else 0.0
    # a soft motion does not tell: a lag then does as well as relaxation
    if courses and sharpness > CORNER and not _relaxes(courses):
        courses = [replace(course, relaxing=course.relaxing[:, :0]) for course in courses]
    middles, lags, errors = [], [], []
    for course in courses:
        found = _press_lag(course)
        if found is not None:
            middles.append(course.middle_s)
            lags.append(found[0])
            errors.append(found[1])
    if not lags:
        return None
    middle, lag, error = map(np.array, (middles, lags, errors))
    error = np.hypot(error, 0.3 * np.median(error))
    kept = np.ones(len(lag), dtype=bool)
    centre = float(middle.mean())
    design = np.column_stack([np.ones(len(lag)), middle - centre])
    line = np.zeros(2)
    for _ in range(4):
        columns = design if np.sum(kept) >= 6 else design[:, :1]
        weighted = columns[kept] / error[kept, None]
        line[:] = 0
        line[: columns.shape[1]] = np.linalg.lstsq(weighted, lag[kept] / error[kept], rcond=None)[0]
        off = lag - design @ line
        spread = 1.4826 * np.median(np.abs(off[kept])) + 1e-5
        kept = np.abs(off) < 4 * spread
    scale = spread / np.sqrt(np.sum(kept))
    rate_error = spread / np.sqrt(np.sum((middle[kept] - centre) ** 2) + 1e-12)
    if abs(line[1]) < 5 * rate_error or abs(line[1]) * np.ptp(middle) < 1e-3:
        line[:] = float(np.average(lag[kept], weights=error[kept] ** -2)), 0.0
    total = float(np.hypot(scale, np.interp(sharpness, SHARPNESS, LAW_S)))
    return Lag(
        float(line[0]), float(line[1]), centre, total, int(np.sum(kept)), sharpness > SHARPNESS[1]
    )


def _sharpest(time: np.ndarray, travel: np.ndarray) -> float:
    """Return the largest change of speed within twice `CORNER_S`, by the largest speed."""
    speed = np.gradient(smooth(travel, time, CORNER_SMOOTHED_S), time)
    apart = max(1, round(CORNER_S / float(np.median(np.diff(time)))))
    inside = travel > CORNER_SHARE * travel.max()
    inside[: 2 * apart] = inside[-2 * apart :] = False
    if not inside.any():
        return 0.0
    change = np.zeros(len(speed))
    change[apart:-apart] = np.abs(speed[2 * apart :] - speed[: -2 * apart])
    return float(change[inside].max() / np.quantile(np.abs(speed), 0.95))


@dataclass(frozen=True, eq=False)
class _Course:
    """One press: its force, and the functions of travel that it is made of.

    Attributes
    ----------
    middle_s : of the press
    time_s, force_n : (m,) averaged over `MEAN_S`
    grid_s : (p,) even
    free, relaxing : (p, 7) and (p, r) on the grid, see `_bases`; the latter in N
    """

    middle_s: float
    time_s: np.ndarray
    force_n: np.ndarray
    grid_s: np.ndarray
    free: np.ndarray
    relaxing: np.ndarray

    def parted(self, lag_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Relaxing columns (m, r) and force (m,) of a lag, less their part along the free ones."""
        time = self.time_s - lag_s
        q, _ = np.linalg.qr(_at(time, self.grid_s, self.free))
        columns = _at(time, self.grid_s, self.relaxing)
        return columns - q @ (q.T @ columns), self.force_n - q @ (q.T @ self.force_n)

    @property
    def freedom(self) -> int:
        """Samples less columns."""
        return len(self.time_s) - self.free.shape[1] - self.relaxing.shape[1]


def _course(
    force_time: np.ndarray, force: np.ndarray, pose_time: np.ndarray, travel: np.ndarray
) -> _Course | None:
    """Average a press's force; None where too little of it lies between touch and release."""
    travel = moving_mean(pose_time, travel, pose_time, MEAN_S)
    free, relaxing = _bases(pose_time, travel)
    inside = travel > CONTACT_SHARE * travel.max()
    if not inside.any():
        return None
    first, last = pose_time[inside][[0, -1]]
    half = MEAN_S / 2
    time = np.arange(
        max(first + TRIMMED_S, force_time[0] + half), min(last - TRIMMED_S, force_time[-1] - half),
        GRID_S,
    )  # fmt: skip
    for k in np.flatnonzero(np.diff(force_time) > GAP_S):
        time = time[(time < force_time[k] - half) | (time > force_time[k + 1] + half)]
    if len(time) < 4 * (free.shape[1] + relaxing.shape[1]):
        return None
    even = moving_mean(force_time, force, time, MEAN_S)
    middle = float(force_time.mean())
    return _Course(middle, time, even, pose_time, free, float(np.ptp(even)) * relaxing)


def _relaxes(courses: Sequence[_Course]) -> bool:
    """Test for relaxation of the body's force, by one set of weights for all presses.

    Weights of each press alone, as none is negative, make relaxation out of noise, and then a lag.
    """
    alone = np.array([_squares(course, _WIDE) for course in courses])
    start = _WIDE[int(np.median(alone.argmin(axis=1)))]
    least = alone.min(axis=1) / [course.freedom for course in courses]
    usual = [k for k, one in enumerate(least) if one < OUTLYING * np.median(least)]
    elastic, relaxed = [], []
    for lag in start + SEARCH_STEP_S * np.arange(-4, 5):
        matrix, vector, square = 0.0, 0.0, 0.0
        for k in usual:
            columns, force = courses[k].parted(lag)
            columns, force = columns / np.sqrt(least[k]), force / np.sqrt(least[k])
            matrix, vector = matrix + columns.T @ columns, vector + columns.T @ force
            square += float(force @ force)
        elastic.append(square)
        relaxed.append(_least(np.asarray(matrix), np.asarray(vector), square))
    independent = MEAN_S / GRID_S  # so many of the averaged samples share their noise
    return (min(elastic) - min(relaxed)) / independent > RELAXES


def _squares(course: _Course, lags: np.ndarray) -> np.ndarray:
    """Least sums of squares of one press at some lags."""
    sums = []
    for lag in lags:
        columns, force = course.parted(lag)
        sums.append(_least(columns.T @ columns, columns.T @ force, float(force @ force)))
    return np.array(sums)


def _press_lag(course: _Course) -> tuple[float, float] | None:
    """Lag of one press and its standard deviation, s; None where it is at the search's edge."""
    k = int(_squares(course, _WIDE).argmin())
    if not 1 <= k < len(_WIDE) - 1:
        return None
    lags = _WIDE[k] + SEARCH_STEP_S * np.arange(-3, 4)
    near = _squares(course, lags)
    k = int(np.clip(near.argmin(), 2, 4))
    curve = np.polyfit(lags[k - 2 : k + 3], near[k - 2 : k + 3], 2)
    if curve[0] <= 0:
        return None
    best = float(np.clip(-curve[1] / (2 * curve[0]), lags[k - 1], lags[k + 1]))
    variance = near[k] / course.freedom
    return best, float(np.sqrt(variance / curve[0] * MEAN_S / GRID_S))


def moving_mean(time: np.ndarray, values: np.ndarray, at: np.ndarray, width_s: float) -> np.ndarray:
    """Return the mean over a width about each time, (p,), of samples (m,) joined by lines.

    Uneven and missing messages shift nothing, as they do where samples are counted.
    """
    whole = np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(time)))
    slope = np.diff(values) / np.diff(time)

    def integral(t: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(slope) - 1)
        past = t - time[k]
        return whole[k] + past * (values[k] + slope[k] * past / 2)

    low = np.maximum(at - width_s / 2, time[0])
    high = np.minimum(at + width_s / 2, time[-1])
    return (integral(high) - integral(low)) / (high - low)


def _bases(time: np.ndarray, travel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Functions of travel, (p, 7), and of its past, (p, r), that a press's force is made of.

    The latter relax; a body gives them only positive weights. Negative ones would make a lag.
    """
    x = np.maximum(travel, 0.0) / travel.max()
    top = int(x.argmax())
    going_out = np.zeros(len(x))
    going_out[top:] = x.max() - x[top:]
    free = [np.ones(len(x)), x, x**2, x**3, going_out, going_out**2, going_out**3]
    step = float(np.median(np.diff(time)))
    relaxing = [
        lfilter([1.0], [1.0, -np.exp(-step / tau)], np.diff(power, prepend=power[0]))
        for tau in RELAXATION_S
        for power in (x, x**2)
    ]
    return np.column_stack(free), np.column_stack(relaxing)


def _at(time: np.ndarray, grid: np.ndarray, basis: np.ndarray) -> np.ndarray:
    at = np.clip((time - grid[0]) / (grid[1] - grid[0]), 0, len(basis) - 1.000001)
    k = at.astype(int)
    part = (at - k)[:, None]
    return basis[k] * (1 - part) + basis[k + 1] * part


def _least(matrix: np.ndarray, vector: np.ndarray, square: float) -> float:
    """Least sum of squares with weights of at least zero, by the normal equations.

    Parameters
    ----------
    matrix, vector : (r, r), (r,)
    square : sum of squares with no weight
    """
    if not vector.size:
        return square
    scale = np.sqrt(np.diag(matrix)) + 1e-12
    factor = np.linalg.cholesky(matrix / np.outer(scale, scale) + 1e-9 * np.eye(len(scale)))
    y = np.linalg.solve(factor, vector / scale)
    return float(square - y @ y + nnls(factor.T, y)[1] ** 2)
