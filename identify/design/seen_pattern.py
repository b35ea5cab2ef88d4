"""The pattern of an effect at its null, beyond the fitted parameters, for its detection limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from identify.design.settings import DetectionSettings
from identify.effects.base import Effect, advice
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
    for g in range(len(left)):
        # The direction of the amplitudes with the shortest pattern
        _, singular, right = np.linalg.svd(left[g], full_matrices=False)
        if singular[0] == 0:
            continue
        least = float(np.linalg.norm(pattern.columns[g] @ right[-1]))
        if least <= _UNMOVED * float(np.linalg.norm(pattern.columns[g])):
            unmoved = True
            continue
        weakest = right[-1] / max(singular[-1], 1e-300)
        column = pattern.columns[g] @ weakest
        share = float(np.sqrt(np.mean((column * at.sigma_m) ** 2))) / signal_m(at)
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


def signal_m(at: Linearised) -> float:
    """Root mean square of the predicted travel, m."""
    return float(np.sqrt(np.mean(at.predicted_m**2)))
