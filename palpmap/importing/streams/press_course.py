"""The course of one press: its force, and the functions of travel that explain it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from palpmap.importing.streams.stream import noise_of_moving

GRID_S = 0.01
MEAN_S = 0.08  # force and travel are averaged alike, so that no corner is shifted
GAP_S = 0.03  # messages missing: the mean around them is not used
TRIMMED_S = 0.03  # of both ends of a contact, where lag and touch mix
CONTACT_SHARE = 0.07  # of a press's travel: below it the touch itself disturbs
POWERS, POWERS_OUT = (1.0, 1.5, 2.0, 3.0), (1.0, 2.0, 3.0)  # of the travel, and of the way out
RELAXATION_S = (0.1, 0.3, 1.0, 4.0)
_FREE = 1 + len(POWERS_OUT)  # columns that do not relax
_COLUMNS = _FREE + len(POWERS)


@dataclass(frozen=True, eq=False)
class Course:
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
    _last: list[np.ndarray] = field(default_factory=list, init=False, repr=False)

    def table(self, weights: np.ndarray) -> np.ndarray:
        """Relaxed columns (p, K) and, beside them, their slopes as the noise sees them."""
        if self._last and np.array_equal(self._last[0], weights):  # a step that was taken
            return self._last[1]
        table = np.empty((len(self.slopes), 2 * _COLUMNS))
        relaxed, slopes = table[:, :_COLUMNS], table[:, _COLUMNS:]
        relaxed[:] = self._relaxed(weights)
        slopes[:, :_FREE] = self.slopes[:, :_FREE]
        gain = np.sqrt(weights @ _NOISE_GAIN @ weights)
        np.multiply(self.slopes[:, _FREE:], gain, out=slopes[:, _FREE:])
        self._last[:] = weights, table
        return table

    def _relaxed(self, weights: np.ndarray) -> np.ndarray:
        """Relaxed columns (p, K); as one product, since numpy multiplies a stack row by row."""
        return (self.columns.reshape(-1, len(weights)) @ weights).reshape(self.slopes.shape)

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
        table = self._relaxed(weights)
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


def course_of(
    force_time: np.ndarray,
    force: np.ndarray,
    pose_time: np.ndarray,
    travel: np.ndarray,
    pose_noise: float,
) -> Course | None:
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
    return Course(
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
