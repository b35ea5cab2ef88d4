"""Detection limits: smallest visible amplitude of each effect, confusions, and bias of the map.

All from the derivatives at the present fit, for this scan or for one that is only planned:

    smallest amplitude seen    5 / |A_perp|   (5 standard errors, after the map took its share),
                               A the effect's own change of the readings at about that amplitude
    confused with              effects with a cosine of both A_perp above 0.9
    bias of the map            (G'G)^-1 G'A a: change of the fitted map if the effect is ignored

Source: the same algebra as the score test, see `identify.select.score_test`. The pattern A_perp is
that at the null (`identify.design.seen_pattern`), or at the limit's own size
(`identify.design.pattern_at_size`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from identify.design.pattern_at_size import at_its_size
from identify.design.seen_pattern import SeenPattern, seen_patterns
from identify.design.settings import DETECTION, DetectionSettings
from identify.effects.base import Effect, changes_body
from identify.effects.units import digits, percent
from identify.fit.result import FitResult
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.select.score_test import fitted_basis


@dataclass(frozen=True)
class Limit:
    """Detection limit of one effect in a scan.

    Attributes
    ----------
    name : of the effect
    smallest_share : size of 5 standard errors, rms over that of the signal, in the direction of
        several amplitudes that is seen least for its size; None if never seen
    largest_share : largest possible size of an effect that is not seen even then; else None
    shape : values of its shape parameters for this limit, such as a skin's thickness
    bend : the limit over that by the pattern at the null, from which the effect's own law differs
    sizes : amplitudes at that size, or else at the largest, by parameter, in their units
    visible : share of the pattern beyond the map
    confused_with : effects with a pattern alike
    map_bias : by parameter, in its unit, bias of the map by an effect of 3 % of the signal
    untestable : reason why the scan cannot show it at all, or None
    """

    name: str
    smallest_share: float | None
    sizes: Mapping[str, float]
    visible: float
    confused_with: tuple[str, ...]
    map_bias: Mapping[str, float]
    untestable: str | None = None
    largest_share: float | None = None
    shape: Mapping[str, float] = field(default_factory=dict)
    bend: float = 1.0


def detection_limits(
    fit: FitResult,
    catalogue: Sequence[Effect],
    settings: DetectionSettings = DETECTION,
    known: Sequence[Limit] = (),
) -> tuple[Limit, ...]:
    """Return the limits of every effect of a catalogue beyond those of the model.

    `known` : of this scan beside another fit, whose bends serve here, too
    """
    return limits_at(fit.model, fit.at, fit.u, catalogue, settings, bends_of(known))


def bends_of(limits: Sequence[Limit]) -> dict[str, float]:
    """Return how the laws of effects bend, where their limits were found at their size."""
    return {limit.name: limit.bend for limit in limits if limit.smallest_share}


def limits_at(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    catalogue: Sequence[Effect],
    settings: DetectionSettings = DETECTION,
    bends: Mapping[str, float] | None = None,
) -> tuple[Limit, ...]:
    """Return the limits of a model linearised at scaled unknowns u (k,).

    Beside a free map those of the body's effects are linear: the map takes most of their bend, and
    each size would cost a solution of its finer mesh.

    Parameters
    ----------
    bends : `Limit.bend` of effects of the body in a scan of this body with these tips, where it is
        much the same, and finding it takes solutions of the body
    """
    free = model.map_uncertainty is not None
    fitted = fitted_basis(at)
    normal = np.linalg.pinv(at.jacobian, rcond=1e-10)
    seen: list[tuple[Effect, SeenPattern | str]] = []
    for effect in catalogue:
        if effect.name in model.effect_names:
            continue
        found = seen_patterns(model, at, effect, fitted, normal, settings)
        if not isinstance(found, str):
            bend = (bends or {}).get(effect.name, 1.0 if free else None)
            if not changes_body(effect):
                bend = None
            found = _middle(
                one
                if one.share * settings.sigmas >= settings.far_signal
                else at_its_size(model, at, u, effect, one, fitted, normal, settings)
                if bend is None
                else one.bent(bend)
                for one in found
            )
        seen.append((effect, found))
        if free and effect.link == "body":  # models of the finer mesh, of hundreds of MB
            at.body.forget_other_models()
    bases = {
        effect.name: one.basis
        for effect, one in seen
        if isinstance(one, SeenPattern) and one.share < np.inf
    }
    return tuple(
        Limit(effect.name, None, {}, 0.0, (), {}, one)
        if isinstance(one, str)
        else _limit(model, at, u, effect, one, bases, settings)
        for effect, one in seen
    )


def _limit(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    effect: Effect,
    seen: SeenPattern,
    bases: Mapping[str, np.ndarray],
    settings: DetectionSettings,
) -> Limit:
    """Return the limit of an effect from its pattern and the bases (m,) of all by name."""
    cosines = [
        (float(np.linalg.norm(seen.basis @ other)), name)
        for name, other in bases.items()
        if name != effect.name and effect.name in bases
    ]
    alike = sorted((pair for pair in cosines if pair[0] > settings.alike), reverse=True)
    factor = settings.bias_share / seen.share if seen.share > 0 else 0.0
    bias = factor * seen.bias * model.unknowns.slope(u)
    typical = [p.typical for p in effect.bounded(model.readings, at.state) if p.null is not None]
    sizes, reason = settings.sigmas * seen.sizes * typical, None
    if seen.most is not None:
        sizes *= seen.length / settings.sigmas
        reason = (
            f"even the largest that is possible, {percent(seen.most)} of the signal, "
            f"would be only {digits(seen.length)} standard errors in this scan"
        )
    is_seen = np.isfinite(seen.share) and reason is None
    return Limit(
        effect.name,
        settings.sigmas * seen.share if is_seen else None,
        dict(zip((p.name for p in effect.amplitudes), sizes.tolist(), strict=True)),
        seen.visible,
        tuple(name for _, name in alike),
        dict(zip(model.names, bias.tolist(), strict=True)),
        reason,
        seen.most,
        dict(seen.shape),
        seen.bend,
    )


def _middle(candidates: Iterable[SeenPattern]) -> SeenPattern:
    """Return the middle one by its visible share, those never seen last."""
    ranked = sorted(candidates, key=lambda s: np.inf if s.most is not None else s.share)
    return ranked[len(ranked) // 2]
