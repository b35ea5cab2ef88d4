"""The lag between force and pose, by maximum likelihood over all presses at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from palpmap.importing.streams.clocks import smooth
from palpmap.importing.streams.contact import correlation_length
from palpmap.importing.streams.stream import noise_of_moving

GRID_S = 0.01
MEAN_S = 0.08  # force and travel are averaged alike, so that no corner is shifted
GAP_S = 0.03  # messages missing: the mean around them is not used
CORNER_SMOOTHED_S = 0.08
CORNER_S = 0.08  # the speed changes by most of itself within twice this time at a corner
SHARPNESS, LAW_S = (0.7, 0.95), (7.0e-3, 5.0e-4)  # what the force's law adds to the lag's error
FURTHEST_S, SEARCH_STEP_S, LONGEST_STEP_S = 0.24, 0.008, 0.05
TRIMMED_S = 0.03  # of both ends of a contact, where lag and touch mix
CONTACT_SHARE = 0.07  # of a press's travel: below it the touch itself disturbs
CORNER_SHARE = 0.1
POWERS, POWERS_OUT = (1.0, 1.5, 2.0, 3.0), (1.0, 2.0, 3.0)  # of the travel, and of the way out
RELAXATION_S = (0.1, 0.3, 1.0, 4.0)
RELAXING = (0.02, 0.1)  # weights to start from: an elastic and a viscous body
OUTLYING = 9.0  # times the usual variance: a press that does not count
MOST_PRESSES = 40  # of a recording, evenly over it
FOR_A_RATE = 6  # presses
BESIDE_S = 4.0e-3  # at least so far beside the lag the likelihood is asked for its error
_WIDE = np.arange(-FURTHEST_S, FURTHEST_S + SEARCH_STEP_S / 2, SEARCH_STEP_S)
_FREE = 1 + len(POWERS_OUT)  # columns that do not relax
_COLUMNS = _FREE + len(POWERS)
_THETA = 2 + len(RELAXATION_S)  # lag, its growth over the recording, weights of the relaxation


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
    has_corners : whether the tip stops and starts sharply, which fixes the lag to some 2 ms
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
    pose_noise: float,
) -> Lag | None:
    """Estimate the lag between force and travel from all presses; None if they do not show it.

    In each press the force is a smooth function of travel, other while the tip goes out than while
    it goes in. It relaxes at four rates, with weights that all presses share and that are not
    negative: a body's own viscosity is thus not mistaken for a lag, unless it relaxes faster than
    in 0.1 s. Lag, weights and laws are those of the greatest likelihood, with noise in force and
    travel (effective variance: Orear, Am. J. Phys. 50, 1982); corners of the motion decide the lag.

    Parameters
    ----------
    force_time, force : of each press, s and N, contact only
    pose_time, travel : of each press, s and m, from before the touch; even steps
    pose_noise : standard deviation of the travel's noise, m, times the square root of the time
        between its messages, s
    """
    every = max(1, -(-len(force) // MOST_PRESSES))
    chosen = list(zip(force_time, force, pose_time, travel, strict=True))[::every]
    courses = [_course(*one, pose_noise) for one in chosen]
    courses = [course for course in courses if course is not None]
    start = _start(courses) if courses else None
    if start is None:
        return None
    middle = np.array([course.middle_s for course in courses])
    span = max(float(np.ptp(middle)), 1.0)
    fit = _Fit(courses, (middle - middle.mean()).round(3) / span, *start)
    error, grown_error = fit.solve()
    lag, grown = fit.theta[:2]
    if not np.isfinite(error) or abs(lag) > FURTHEST_S:
        return None
    if abs(grown) < max(5 * grown_error, 1e-3):
        grown = 0.0
    sharpness = float(np.median([_sharpest(tp, x) for _, _, tp, x in chosen]))
    return Lag(
        float(lag),
        float(grown / span),
        float(middle.mean()),
        float(np.hypot(error, np.interp(sharpness, SHARPNESS, LAW_S))),
        len(fit.kept),
        sharpness > SHARPNESS[1],
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
    columns : (p, K, 1 + r) functions of travel, and the remainder of each at r rates of relaxation
    slopes : (p, K) their derivatives by the travel's share of its largest
    force_var, travel_var : noise of the averaged force, N^2, and of the travel's share
    """

    middle_s: float
    time_s: np.ndarray
    force_n: np.ndarray
    grid_s: np.ndarray
    columns: np.ndarray
    slopes: np.ndarray
    force_var: float
    travel_var: float

    def table(self, weights: np.ndarray) -> np.ndarray:
        """Relaxed columns (p, K) and, beside them, their slopes as the noise sees them."""
        gain = np.ones(_COLUMNS)
        gain[_FREE:] = np.sqrt(weights @ _NOISE_GAIN @ weights)
        return np.hstack([self.columns @ weights, self.slopes * gain])

    def at(self, lag_s: float, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return columns and slopes of a table, each (m, K), at a lag."""
        both = _at(self.time_s - lag_s, self.grid_s, table)
        return both[:, :_COLUMNS], both[:, _COLUMNS:]

    def least(self, lag_s: float, weights: np.ndarray) -> np.ndarray:
        """Coefficients (K,) of an ordinary least-squares fit."""
        columns, _ = self.at(lag_s, self.table(weights))
        size = np.linalg.norm(columns, axis=0) + 1e-9
        return np.linalg.lstsq(columns / size, self.force_n, rcond=1e-7)[0] / size

    def squares(self, lags_s: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return the sums of squares (l,) of ordinary least-squares fits."""
        table = self.columns @ weights
        columns = np.array([_at(self.time_s - lag, self.grid_s, table) for lag in lags_s])
        q = np.linalg.qr(columns / (np.linalg.norm(columns, axis=1, keepdims=True) + 1e-9))[0]
        return np.sum(
            (self.force_n - (q @ (q.swapaxes(1, 2) @ self.force_n)[:, :, None])[:, :, 0]) ** 2,
            axis=1,
        )

    def residual(self, lag_s: float, weights: np.ndarray, law: np.ndarray) -> np.ndarray:
        """Residuals (m,) in standard deviations."""
        columns, slopes = self.at(lag_s, self.table(weights))
        variance = self.force_var + self.travel_var * (slopes @ law) ** 2
        return (self.force_n - columns @ law) / np.sqrt(variance)

    def linear(
        self, lag_s: float, weights: np.ndarray, law: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (m,), derivatives by lag and weights (m, 1 + r) and by the law (m, K)."""
        step, table = 2e-3, self.table(weights)
        columns, slopes = self.at(lag_s, table)
        later, earlier = self.at(lag_s + step, table), self.at(lag_s - step, table)
        stiffness = slopes @ law
        variance = self.force_var + self.travel_var * stiffness**2
        root = np.sqrt(variance)
        residual = (self.force_n - columns @ law) / root
        tilt = residual * self.travel_var * stiffness / variance  # the variance follows the law

        def by(column: np.ndarray, slope: np.ndarray) -> np.ndarray:
            return -column / root - tilt * slope

        past = _at(
            self.time_s - lag_s,
            self.grid_s,
            self.columns[:, _FREE:, 1:].swapaxes(1, 2) @ law[_FREE:],
        )
        gain = (_NOISE_GAIN @ weights)[1:] / (weights @ _NOISE_GAIN @ weights)
        relaxing = slopes[:, _FREE:] @ law[_FREE:]
        by_lag = by((later[0] - earlier[0]) @ law, (later[1] - earlier[1]) @ law) / (2 * step)
        by_weights = [by(p, relaxing * g) for p, g in zip(past.T, gain, strict=True)]
        by_law = [by(c, s) for c, s in zip(columns.T, slopes.T, strict=True)]
        return residual, np.column_stack([by_lag, *by_weights]), np.column_stack(by_law)


def _course(
    force_time: np.ndarray,
    force: np.ndarray,
    pose_time: np.ndarray,
    travel: np.ndarray,
    pose_noise: float,
) -> _Course | None:
    """Average a press's force; None where too little of it lies between touch and release."""
    travel = moving_mean(pose_time, travel, pose_time, MEAN_S)
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
    if len(time) < 4 * _COLUMNS:
        return None
    even = moving_mean(force_time, force, time, MEAN_S)
    force_var = (
        noise_of_moving(force[:, None])[0] ** 2 * float(np.median(np.diff(force_time))) / MEAN_S
    )
    return _Course(
        float(force_time.mean()),
        time,
        even,
        pose_time,
        *_functions(pose_time, travel),
        float(force_var + (1e-5 * np.ptp(even)) ** 2),
        (pose_noise / travel.max()) ** 2 / MEAN_S,
    )


def _functions(time: np.ndarray, travel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (p, K, 1 + r) and slopes (p, K) of a course: a constant, the way out, the travel."""
    x = np.maximum(travel, 0.0) / travel.max()
    top = int(x.argmax())
    out = np.zeros(len(x))
    out[top:] = x.max() - x[top:]
    columns, slopes = (
        np.zeros((len(x), _COLUMNS, 1 + len(RELAXATION_S))),
        np.zeros((len(x), _COLUMNS)),
    )
    columns[:, 0, 0] = 1.0
    for k, power in enumerate(POWERS_OUT, start=1):
        columns[:, k, 0], slopes[top:, k] = out**power, -power * out[top:] ** (power - 1)
    step = float(np.median(np.diff(time)))
    for k, power in enumerate(POWERS, start=_FREE):
        columns[:, k, 0], slopes[:, k] = x**power, power * x ** (power - 1)
        columns[:, k, 1:] = _relaxed(x**power, step)
    return columns, slopes


def _relaxed(values: np.ndarray, step_s: float) -> np.ndarray:
    """Return the remainder of the changes of values (p,) at each rate of relaxation, (p, r)."""
    change = np.diff(values, prepend=values[0])
    decays = np.exp(-step_s / np.array(RELAXATION_S))
    return np.column_stack([lfilter([1.0], [1.0, -decay], change) for decay in decays])


def _noise_gain() -> np.ndarray:
    """Covariance (1 + r, 1 + r) of averaged white noise and its remainders after relaxation."""
    step = 1e-3
    kernel = np.zeros(round((MEAN_S + 4 * max(RELAXATION_S)) / step))
    kernel[1 : 1 + round(MEAN_S / step)] = 1.0
    kernels = np.column_stack([kernel, _relaxed(kernel, step)])
    return kernels.T @ kernels / kernel.sum()


_NOISE_GAIN = _noise_gain()


def _start(courses: Sequence[_Course]) -> tuple[float, float] | None:
    """Lag and weight of relaxation to start from, by least squares; None at the search's edge."""
    weights = [np.append(1.0, np.full(len(RELAXATION_S), weight)) for weight in RELAXING]
    sums = np.array(
        [np.column_stack([course.squares(_WIDE, w) for w in weights]) for course in courses]
    )
    sums /= sums.min(axis=(1, 2), keepdims=True) + 1e-30
    total = np.minimum(sums, OUTLYING).sum(axis=0)
    k, weight = np.unravel_index(total.argmin(), total.shape)
    if not 1 <= k < len(_WIDE) - 1:
        return None
    return float(_WIDE[k]), RELAXING[weight]


class _Fit:
    """Lag, its growth and the weights of relaxation of all presses, with a law of each press.

    The residuals are linearised; each press's law is eliminated from the normal equations.

    Attributes
    ----------
    theta : (2 + r,) lag in s, its growth over the recording in s, weights
    laws : of each press, (K,)
    kept : numbers of the presses that count
    """

    def __init__(self, courses: Sequence[_Course], at: np.ndarray, lag: float, weight: float):
        self.courses, self.at = courses, at
        self.theta = np.concatenate([[lag, 0.0], np.full(len(RELAXATION_S), weight)])
        self.kept = list(range(len(courses)))
        self.scale = np.ones(len(courses))
        self.laws = [c.least(*self._of(k, self.theta)) for k, c in enumerate(courses)]

    def solve(self) -> tuple[float, float]:
        """Fit, leave out presses that do not follow; return the errors of lag and growth, s."""
        for _ in range(3):
            self._descend()
            sums = np.zeros(len(self.courses))
            for k, course in enumerate(self.courses):
                if k not in self.kept:
                    self.laws[k] = course.least(*self._of(k, self.theta))
                sums[k] = np.mean(course.residual(*self._of(k, self.theta), self.laws[k]) ** 2)
            self.scale = 1 / np.maximum(sums, 0.3 * np.median(sums))
            kept = np.flatnonzero(sums < OUTLYING * np.median(sums)).tolist()
            if kept == self.kept:
                break
            self.kept = kept
        return self._errors()

    def _of(self, k: int, theta: np.ndarray) -> tuple[float, np.ndarray]:
        return float(theta[0] + theta[1] * self.at[k]), np.append(1.0, theta[2:])

    def _sum(self, theta: np.ndarray, laws: Sequence[np.ndarray]) -> float:
        return sum(
            self.scale[k]
            * float(np.sum(self.courses[k].residual(*self._of(k, theta), laws[k]) ** 2))
            for k in self.kept
        )

    def _parted(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Residual and Jacobian (m, 2 + r) less their part along the law, and the law's steps."""
        residual, shared, law = self.courses[k].linear(*self._of(k, self.theta), self.laws[k])
        grows = self.at[k] if len(self.kept) >= FOR_A_RATE else 0.0
        shared = np.column_stack([shared[:, 0], grows * shared[:, 0], shared[:, 1:]])
        steps = -np.linalg.pinv(law / (size := np.linalg.norm(law, axis=0) + 1e-12), rcond=1e-7)
        steps /= size[:, None]
        return (
            residual + law @ (steps @ residual),
            shared + law @ (steps @ shared),
            steps @ residual,
            steps @ shared,
        )

    def _descend(self, lag_too: bool = True) -> None:
        now = self._sum(self.theta, self.laws)
        for _ in range(25):
            parts = {k: self._parted(k) for k in self.kept}
            matrix, gradient = np.zeros((_THETA, _THETA)), np.zeros(_THETA)
            for k, part in parts.items():
                matrix += self.scale[k] * part[1].T @ part[1]
                gradient += self.scale[k] * part[1].T @ part[0]
            if not lag_too:
                matrix[0], matrix[:, 0], matrix[0, 0], gradient[0] = 0.0, 0.0, 1.0, 0.0
            step = _bounded_step(matrix, gradient, self.theta)
            step /= max(1.0, abs(step[0]) / LONGEST_STEP_S)
            for share in (1.0, 0.4, 0.15, 0.05, 0.02):
                theta, laws = self.theta + share * step, list(self.laws)
                for k, (_, _, alone, with_step) in parts.items():
                    laws[k] = laws[k] + share * (alone + with_step @ step)
                after = self._sum(theta, laws)
                if after < now:
                    break
            else:
                return
            settled = now - after < 1e-3 and abs(share * step[0]) < 1e-4
            self.theta, self.laws, now = theta, laws, after
            if settled:
                return

    def _errors(self) -> tuple[float, float]:
        """Return the standard deviations of lag and growth, by the sum of squares beside the lag.

        The normal equations do not give it: the noise of the tip's speed is in their Jacobian.
        """
        parts = [self._parted(k) for k in self.kept]
        lasting = float(np.median([correlation_length(part[0]) for part in parts]))
        matrix = sum(
            self.scale[k] * part[1].T @ part[1] for k, part in zip(self.kept, parts, strict=True)
        )
        alone = np.sqrt(lasting / (np.diag(np.asarray(matrix))[:2] + 1e-30))
        aside = max(4 * alone[0], BESIDE_S)
        for _ in range(3):
            theta, laws, least = self.theta, self.laws, self._sum(self.theta, self.laws)
            grown, beside = [], []
            for way in (-aside, aside):
                self.theta, self.laws = theta + way * np.eye(_THETA)[0], list(laws)
                self._descend(lag_too=False)
                grown.append(self._sum(self.theta, self.laws) - least)
                beside.append((self.theta, self.laws))
            if min(grown) > 0:
                break
            self.theta, self.laws = beside[int(np.argmin(grown))]  # a better fit: go on from there
            self._descend()
        self.theta, self.laws = theta, laws
        error = aside * np.sqrt(lasting / min(grown)) if min(grown) > 0 else np.inf
        return float(error), float(alone[1] * max(error / alone[0], 1.0))


def _bounded_step(matrix: np.ndarray, gradient: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Newton step (2 + r,) after which no weight of relaxation is negative."""
    scale = np.sqrt(np.diag(matrix)) + 1e-12
    normal = matrix / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    root = np.linalg.cholesky(normal).T
    wanted = np.linalg.solve(root.T, normal @ (theta * scale) - gradient / scale)
    found = nnls(np.column_stack([root, -root[:, :2]]), wanted)[0]
    found[:2] -= found[_THETA:]
    return found[:_THETA] / scale - theta


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


def _at(time: np.ndarray, grid: np.ndarray, basis: np.ndarray) -> np.ndarray:
    at = np.clip((time - grid[0]) / (grid[1] - grid[0]), 0, len(basis) - 1.000001)
    k = at.astype(int)
    part = (at - k)[:, None]
    return basis[k] * (1 - part) + basis[k + 1] * part
