"""Evidence of an added effect: the residual before it beside the change of the model by it.

Along several axes (time in the press, force, order, ...) the readings are binned; the axis that is
shown is the one along which the change of the model shows most.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from identify.effects import Readings
from identify.select import AcceptedEffect, Explanation, Step

BINS = 12
_MOST_BINS = 24  # along the time or force within a press
_LEAST = 4  # readings that a bin must have
_SPLIT = 0.1  # share that a picture of several curves must show more to be preferred
_PHASES = ("load", "hold", "unload")


@dataclass(frozen=True)
class Axis:
    """Something along which residuals are shown.

    Attributes
    ----------
    name, label : `time`, "time since first touch, s"
    at : (m,) place of each reading on it
    group : (m,) index of the curve that each reading belongs to
    curves : names of the curves
    resolution : least width of a bin worth having
    within_press : about one bin a reading of a press, as all presses are sampled alike
    """

    name: str
    label: str
    at: np.ndarray
    group: np.ndarray
    curves: tuple[str, ...] = ("",)
    resolution: float = 0.0
    within_press: bool = False


@dataclass(frozen=True)
class Curve:
    """Bins of one curve: `at` (b,), and residual before, change of the model, residual after, m.

    `error_m` (b,) is one standard error of a bin's mean under pure noise.
    """

    name: str
    at: np.ndarray
    before_m: np.ndarray
    change_m: np.ndarray
    after_m: np.ndarray
    error_m: np.ndarray


@dataclass(frozen=True)
class Evidence:
    """Change by one addition, along the axis on which it shows best and the next best.

    Attributes
    ----------
    name : of the effect
    before, after : the steps on either side
    shown : (axis, its curves), the best first
    share : share of the change of the model, beyond its mean, that the best axis shows
    """

    name: str
    before: Step
    after: Step
    shown: tuple[tuple[Axis, tuple[Curve, ...]], ...]
    share: float

    @property
    def change_m(self) -> np.ndarray:
        """Change of the model by the effect, at the readings, (m,) m."""
        return self.before.fit.residual_m - self.after.fit.residual_m


def steps(explained: Explanation) -> Iterable[tuple[str, Step, Step]]:
    """Yield the name of each added effect, the step before and the step after it."""
    for before, after in zip(explained.ladder[:-1], explained.ladder[1:], strict=True):
        yield added_name(before, after), before, after


def added_name(before: Step, after: Step) -> str:
    """Return the first effect that a step adds."""
    return next(name for name in after.fit.effect_names if name not in before.fit.effect_names)


def added_names(before: Step, after: Step) -> tuple[str, ...]:
    """Return all effects that a step adds."""
    had = before.fit.effect_names
    return tuple(name for name in after.fit.effect_names if name not in had)


def kept(explained: Explanation, name: str) -> AcceptedEffect | None:
    """Return the addition of an effect, or None where it lost its place later."""
    return next((a for a in explained.accepted if a.name == name), None)


def evidences(explained: Explanation, origin_m: np.ndarray) -> tuple[Evidence, ...]:
    """Return the evidence of every step of the ladder, with places in the scan's frame."""
    found = steps(explained)
    return tuple(evidence_of(name, before, after, origin_m) for name, before, after in found)


def evidence_of(
    name: str, before: Step, after: Step, origin_m: np.ndarray, most: int = 2
) -> Evidence:
    """Find the axes along which a step of the ladder shows best.

    Parameters
    ----------
    origin_m : (3,) origin of the body's frame in the scan's frame
    """
    change = before.fit.residual_m - after.fit.residual_m
    weight = 1 / before.fit.at.sigma_m**2
    axes = axes_of(before, after.fit.at.values.get(name, {}), origin_m)
    press = before.fit.model.readings.press
    shares = [shown_share(bins_of(axis, press), change, weight) for axis in axes]
    worth = [s - _SPLIT * (len(a.curves) > 1) for s, a in zip(shares, axes, strict=True)]
    best = np.argsort(worth)[::-1][:most]
    shown = tuple((axes[i], curves_of(axes[i], before, after)) for i in best)
    return Evidence(name, before, after, shown, float(shares[best[0]]))


def axes_of(step: Step, values: Mapping[str, float], origin_m: np.ndarray) -> list[Axis]:
    """Return the axes that a scan has; forces are the best estimates of the true ones.

    Sorted by the measured force, pure noise shows a slope (`identify.residual.whitened`).

    Parameters
    ----------
    values : found for the effect; a frequency folds the time of the scan
    origin_m : (3,) origin of the body's frame in the scan's frame
    """
    fit, readings = step.fit, step.fit.model.readings
    none = np.zeros(len(readings.press), int)
    phase = np.array([_PHASES.index(p) for p in readings.phase])
    force = fit.at.latent_force_n
    order = readings.order[readings.press].astype(float)
    # The best estimate moves with the residual: within the force's noise, order means nothing
    least = 4 * fit.model.noise.force_n
    axes = [Axis("force", "true force (best estimate), N", force, phase, _PHASES, least, True)]
    if np.ptp(order) > 0:
        axes.append(Axis("order", "press, in the order of making", order, none))
    compliance = fit.at.body.compliance[readings.press]
    if np.ptp(compliance) > 1e-3 * compliance.mean():
        axes.append(
            Axis("softness", "softness of the place by the map, mm/N", 1e3 * compliance, none)
        )
    for axis in range(3):
        if np.ptp(readings.point_m[:, axis]) > 1e-3:
            where = 1e3 * (readings.point_m[:, axis] + origin_m[axis])
            axes.append(Axis("xyz"[axis], f"{'xyz'[axis]}, mm", where, none))
    if readings.time_s is not None:
        axes += _in_time(readings, phase, values)
    return axes


def _in_time(readings: Readings, phase: np.ndarray, values: Mapping[str, float]) -> list[Axis]:
    none = np.zeros(len(readings.press), int)
    since = readings.timed_s - readings.timed_s[readings.first][readings.press]
    label = "time since the press's first reading, s"
    axes = [Axis("time", label, since, none, within_press=True)]
    frequency = values.get("frequency_hz")
    if frequency:
        turn = np.mod(frequency * readings.elapsed_s, 1.0)
        label = f"place in the cycle of {1 / frequency:.3g} s"
        axes.append(Axis("cycle", label, turn, none))
    return axes


def bins_of(axis: Axis, press: np.ndarray) -> np.ndarray:
    """Bin (m,) of each reading: about evenly filled along the axis, curve by curve.

    Parameters
    ----------
    press : (m,) index of each reading's press
    """
    found = np.zeros(len(axis.at), int)
    number = 0
    for group in np.unique(axis.group):
        rows = np.flatnonzero(axis.group == group)
        bins = BINS
        if axis.within_press:
            own = np.bincount(press[rows])
            bins = int(np.clip(np.median(own[own > 0]), 1, _MOST_BINS))
        count = min(bins, max(len(rows) // _LEAST, 1))
        if axis.resolution > 0:
            count = int(np.clip(np.ptp(axis.at[rows]) / axis.resolution, 1, count))
        edges = np.unique(np.quantile(axis.at[rows], np.linspace(0, 1, count + 1)))
        own = np.clip(np.searchsorted(edges, axis.at[rows], side="right") - 1, 0, None)
        own = np.minimum(own, max(len(edges) - 2, 0))
        found[rows] = number + own
        number += max(len(edges) - 1, 1)
    return found


def shown_share(index: np.ndarray, change_m: np.ndarray, weight: np.ndarray) -> float:
    """Share of the weighted variance of a change (m,) that its means in bins show, bins paid for.

    Parameters
    ----------
    index : (m,) bin of each reading
    """
    total = np.bincount(index, weight)
    mean = np.bincount(index, weight * change_m) / np.where(total > 0, total, 1.0)
    overall = np.average(change_m, weights=weight)
    whole = np.sum(weight * (change_m - overall) ** 2)
    if whole <= 0:
        return 0.0
    left = np.sum(weight * (change_m - mean[index]) ** 2)
    m, k = len(change_m), int(np.sum(total > 0))
    return float(1 - left / whole * (m - 1) / max(m - k, 1))


def curves_of(axis: Axis, before: Step, after: Step) -> tuple[Curve, ...]:
    """Average residuals and change of the model in the bins of an axis."""
    index = bins_of(axis, before.fit.model.readings.press)
    weight = 1 / before.fit.at.sigma_m**2
    curves = []
    for group in np.unique(axis.group):
        rows = axis.group == group
        own, place = np.unique(index[rows], return_inverse=True)
        total = np.bincount(place, weight[rows], len(own))

        def mean(values: np.ndarray, rows=rows, place=place, total=total) -> np.ndarray:
            return np.bincount(place, weight[rows] * values[rows]) / total

        first, last = before.fit.residual_m, after.fit.residual_m
        curves.append(
            Curve(
                axis.curves[int(group)],
                mean(axis.at),
                mean(first),
                mean(first - last),
                mean(last),
                1 / np.sqrt(total),
            )
        )
    return tuple(curves)
