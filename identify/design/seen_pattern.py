"""The pattern of an effect at its null, beyond the fitted parameters, for its detection limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from identify.design.settings import DetectionSettings
from identify.effects.base import Effect, EffectParameter, advice
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.select.score_test import beyond, patterns_or_reason

_UNMOVED = 1e-9  # of the amplitudes' common pattern: rounding


@dataclass(frozen=True)
class SeenPattern:
    """The pattern of an effect at one candidate of its shape, in one direction.

    `most` is the largest possible share of the signal if too little to be seen, `length` its number
    of standard errors; `bend` is the share over that of the pattern at the null.
    """

    shape: Mapping[str, float]
    share: float  # of the signal at one standard error
    sizes: np.ndarray
    visible: float
    basis: np.ndarray
    bias: np.ndarray
    most: float | None = None
    length: float = 0.0
    bend: float = 1.0

    def bent(self, bend: float) -> SeenPattern:
        """Return the pattern at the null with the share of an effect whose law bends so much."""
        changed = {name: bend * getattr(self, name) for name in ("share", "sizes", "bias")}
        return replace(self, bend=bend, **changed)


def seen_patterns(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    fitted: np.ndarray,
    normal: np.ndarray,
    settings: DetectionSettings,
) -> list[SeenPattern] | str:
    """Return the typical candidate's pattern alone, or the reason for none.

    Of an effect with a bent law (`Advice.levels`), the best-seen pattern of each shape: the typical
    one shows only at their own sizes.
    """
    pattern = patterns_or_reason(model, at, effect, settings.candidates)
    if isinstance(pattern, str):
        return pattern
    left, _, visible = beyond(pattern, fitted)
    candidates, unmoved = [], False
    bounded = {p.name: p for p in effect.bounded(model.readings, at.state)}
    sides = _sides([bounded[p.name] for p in effect.amplitudes])
    for g in range(len(left)):
        if not left[g].any():
            continue
        direction = weakest_direction(left[g], pattern.change_m[g], sides)
        least = float(np.linalg.norm(pattern.columns[g] @ direction))
        if least <= _UNMOVED * float(np.linalg.norm(pattern.columns[g] * np.abs(direction))):
            unmoved = True
            continue
        weakest = direction / max(float(np.linalg.norm(left[g] @ direction)), 1e-300)
        column = pattern.columns[g] @ weakest
        share = float(np.sqrt(np.mean((pattern.change_m[g] @ weakest) ** 2))) / signal_m(at)
        if visible[g] < settings.visible or not np.isfinite(weakest).all():
            share = np.inf
        along = left[g] @ weakest
        basis = along / max(float(np.linalg.norm(along)), 1e-300)
        candidates.append(
            SeenPattern(
                pattern.shapes[g], share, weakest, float(visible[g]), basis, normal @ column
            )
        )
    if not candidates and unmoved:
        names = " and ".join(p.name for p in effect.amplitudes)
        return f"a combination of its {names} moves no reading of this scan"
    if not candidates:
        return "the scan does not show it at all"
    candidates.sort(key=lambda s: s.share)
    chosen = [candidates[len(candidates) // 2]]
    if advice(effect).levels(at.state):
        by_shape = {tuple(s.shape.items()): s for s in reversed(candidates)}
        chosen = list(by_shape.values())
    chosen = [s for s in chosen if np.isfinite(s.share)]
    return chosen or "the stiffness map absorbs it entirely"


def weakest_direction(left: np.ndarray, whole: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Possible direction of the amplitudes of which the least is seen for its size.

    The least ratio |left d| / |whole d| in the cone of possible directions d. On each face of the
    cone it is that of the last generalised singular vector, where this one lies in the cone.

    Parameters
    ----------
    left : (m, a) pattern of each amplitude beyond the fitted parameters
    whole : (m, a) change of the readings by each
    sides : (a,) the side to which an amplitude may go, 1 or -1; 0 for both

    Returns
    -------
    the direction (a,), of any length; one that moves no reading, where there is such a one

    Examples
    --------
    >>> left = np.array([[1.0, -0.9], [0.0, 0.1]])
    >>> free = weakest_direction(left, np.eye(2), np.array([0, 0]))
    >>> (free / free[1]).round(2)
    array([0.9, 1. ])
    >>> one_side = weakest_direction(np.abs(left), np.eye(2), np.array([1, 1]))
    >>> (one_side / one_side[1]).round(2)
    array([0., 1.])
    """
    seen, moved = (np.linalg.qr(columns)[1] for columns in (left, whole))
    found, least = np.zeros(len(sides)), np.inf
    for face in product((True, False), repeat=len(sides)):
        taken = np.array(face)
        if not taken.any() or (~taken & (sides == 0)).any():
            continue
        _, sizes, directions = np.linalg.svd(moved[:, taken], full_matrices=False)
        moves = sizes > _UNMOVED * max(float(sizes[0]), 1e-300)
        unit = directions[moves].T / sizes[moves]
        _, ratios, turned = np.linalg.svd(seen[:, taken] @ unit, full_matrices=False)
        options = [(0.0, direction) for direction in directions[~moves]]
        if moves.any():
            options.append((float(ratios[-1]), unit @ turned[-1]))
        for ratio, direction in options:
            one = np.zeros(len(sides))
            one[taken] = direction if (direction * sides[taken]).sum() >= 0 else -direction
            if ratio < least and (one * sides >= 0).all():
                found, least = one, ratio
    return found


def _sides(amplitudes: Sequence[EffectParameter]) -> np.ndarray:
    """Return the side of its null to which each amplitude may go, (a,): 1, -1, or 0 for both."""
    return np.array([int(p.lower == p.null) - int(p.upper == p.null) for p in amplitudes])


def signal_m(at: Linearised) -> float:
    """Root mean square of the predicted travel, m."""
    return float(np.sqrt(np.mean(at.predicted_m**2)))
