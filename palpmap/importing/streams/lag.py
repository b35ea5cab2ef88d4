"""The lag between force and pose, by maximum likelihood over all presses at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from palpmap.importing.streams.clocks import smooth
from palpmap.importing.streams.contact import correlation_length
from palpmap.importing.streams.press_course import MEAN_S, RELAXATION_S, Course, course_of

CORNER_SMOOTHED_S = 0.08
CORNER_S = 0.08  # the speed changes by most of itself within twice this time at a corner
SHARPNESS, LAW_S = (0.7, 0.95), (7.0e-3, 5.0e-4)  # what the force's law adds to the lag's error
FAST = 3.0  # times the width of the average: a way in or out that bends within it
FURTHEST_S, SEARCH_STEP_S, LONGEST_STEP_S = 0.24, 0.008, 0.05
CORNER_SHARE = 0.1
RELAXING = (0.02, 0.1)  # weights to start from: an elastic and a viscous body
OUTLYING = 9.0  # times the usual variance: a press that does not count
MOST_PRESSES = 80  # of a recording, evenly over it
FOR_A_RATE = 6  # presses
MOST_STEPS, MOST_DAMPING = 40, 1e8
WITHIN_2_MS = 2e-3 / 2.58  # standard deviation of the lag, s: then 99 of 100 are
BESIDE_S = 4.0e-3  # at least so far beside the lag the likelihood is asked for its error
_WIDE = np.arange(-FURTHEST_S, FURTHEST_S + SEARCH_STEP_S / 2, SEARCH_STEP_S)
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

    @property
    def doubt(self) -> str:
        """Why the lag is not known to 2 ms, and what helps; empty if 99 of 100 such are."""
        if not self.has_corners:
            return (
                "not known to 2 ms, as no sharp start or stop is felt and viscosity looks like a "
                "lag then: let the tip stop sharply, or state pose.clock_offset_s"
            )
        if self.error_s > WITHIN_2_MS:
            return "not known to 2 ms: press faster, deeper or more often to know it better"
        return ""

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
    presses = list(zip(force_time, force, pose_time, travel, strict=True))
    even = np.linspace(0, len(presses) - 1, min(len(presses), MOST_PRESSES))
    chosen = [presses[int(k)] for k in even.round()]
    courses = [course_of(*one, pose_noise) for one in chosen]
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
    sharpness, ramp_s = np.median([_motion(tp, x, tf) for tf, _, tp, x in chosen], axis=0)
    # Of a fast press, the mean of the force is not that at the mean travel, as its law is bent
    bent_s = MEAN_S**2 / (24 * ramp_s) if ramp_s < FAST * MEAN_S else 0.0
    law_s = np.hypot(np.interp(sharpness, SHARPNESS, LAW_S), bent_s)
    return Lag(
        float(lag),
        float(grown / span),
        float(middle.mean()),
        float(np.hypot(error, law_s)),
        len(fit.kept),
        bool(sharpness > SHARPNESS[1]),
    )


def _motion(time: np.ndarray, travel: np.ndarray, felt: np.ndarray) -> tuple[float, float]:
    """Largest change of speed within twice `CORNER_S`, by the largest speed; time of a way, s.

    `felt` : times of the force; a corner without any tells no lag
    """
    speed = np.gradient(smooth(travel, time, CORNER_SMOOTHED_S), time)
    apart = max(1, round(CORNER_S / float(np.median(np.diff(time)))))
    inside = travel > CORNER_SHARE * travel.max()
    inside[: 2 * apart] = inside[-2 * apart :] = False
    for k in np.flatnonzero(np.diff(felt) > 2 * CORNER_S):
        inside &= (time < felt[k]) | (time > felt[k + 1])
    fastest = float(np.quantile(np.abs(speed), 0.95))
    way_s = float(travel.max()) / fastest
    if not inside.any():
        return 0.0, way_s
    change = np.zeros(len(speed))
    change[apart:-apart] = np.abs(speed[2 * apart :] - speed[: -2 * apart])
    return float(change[inside].max()) / fastest, way_s


def _start(courses: Sequence[Course]) -> tuple[float, float] | None:
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

    def __init__(self, courses: Sequence[Course], at: np.ndarray, lag: float, weight: float):
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
            if len(kept) < FOR_A_RATE:
                self.theta[1] = 0.0  # else that of a press that no longer counts would stay
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
        """Go down by damped steps (Levenberg): weights that are hardly known step far else."""
        now, damping = self._sum(self.theta, self.laws), 1e-3
        held = [0] * (not lag_too) + [1] * (len(self.kept) < FOR_A_RATE)
        for _ in range(MOST_STEPS):
            parts = {k: self._parted(k) for k in self.kept}
            matrix, gradient = np.zeros((_THETA, _THETA)), np.zeros(_THETA)
            for k, part in parts.items():
                matrix += self.scale[k] * part[1].T @ part[1]
                gradient += self.scale[k] * part[1].T @ part[0]
            matrix[held], matrix[:, held], gradient[held] = 0.0, 0.0, 0.0
            matrix[held, held] = 1.0
            while True:
                damped = matrix + damping * np.diag(np.diag(matrix))
                step = _bounded_step(damped, gradient, self.theta)
                step /= max(1.0, abs(step[0]) / LONGEST_STEP_S)
                theta, laws = self.theta + step, list(self.laws)
                for k, (_, _, alone, with_step) in parts.items():
                    laws[k] = laws[k] + alone + with_step @ step
                after = self._sum(theta, laws)
                if after < now:
                    break
                damping *= 10.0
                if damping > MOST_DAMPING:
                    return
            settled = now - after < 1e-3 and abs(step[0]) < 1e-4 and damping < 1
            self.theta, self.laws, now, damping = theta, laws, after, damping / 10
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
