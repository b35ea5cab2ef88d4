"""Detection limits: smallest visible amplitude of each effect, confusions, and bias of the map.

All from the derivatives at the present fit, for this scan or for one that is only planned:

    smallest amplitude seen    5 / |A_perp|   (5 standard errors, after the map took its share),
                               A the effect's own change of the readings at about that amplitude
    confused with              effects with a cosine of both A_perp above 0.9
    bias of the map            (G'G)^-1 G'A a: change of the fitted map if the effect is ignored

For a large bias, the map's own curvature decides on its absorption (in one case a ball's edge was
seen from 3.2 % on, not 1.9 %): the map is then fitted to the change itself, and |A_perp| is the
residual of that fit. Source: the same algebra as the score test, see `identify.select.score_test`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identify.design.settings import DETECTION, DetectionSettings
from identify.effects.base import BodyEffect, Effect, EffectParameter, advice
from identify.fit.result import FitResult
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.select.score_test import beyond, effect_patterns, fitted_basis, unavailable

_UNMOVED = 1e-9  # of the amplitudes' common pattern: rounding


@dataclass(frozen=True)
class Limit:
    """Detection limit of one effect in a scan.

    Attributes
    ----------
    name : of the effect
    smallest_share : size of 5 standard errors, rms over that of the signal; None if never seen
    largest_share : largest possible size of an effect that is not seen even then; else None
    shape : values of its shape parameters for this limit, such as a skin's thickness
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


@dataclass(frozen=True)
class _Seen:
    """The pattern of an effect at one candidate of its shape, in one direction.

    `most` is the largest possible share of the signal if too little to be seen, `length` its number
    of standard errors.
    """

    shape: Mapping[str, float]
    share: float  # of the signal at one standard error
    sizes: np.ndarray
    visible: float
    basis: np.ndarray
    bias: np.ndarray
    most: float | None = None
    length: float = 0.0


def detection_limits(
    fit: FitResult,
    catalogue: Sequence[Effect],
    settings: DetectionSettings = DETECTION,
) -> tuple[Limit, ...]:
    """Return the limits of every effect of a catalogue beyond those of the model."""
    return limits_at(fit.model, fit.at, fit.u, catalogue, settings)


def limits_at(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    catalogue: Sequence[Effect],
    settings: DetectionSettings = DETECTION,
) -> tuple[Limit, ...]:
    """Return the limits of a model linearised at scaled unknowns u (k,).

    Beside a free map those of the body's effects are linear: the map takes most of their bend, and
    each size would cost a solution of its finer mesh.
    """
    linear = model.map_uncertainty is not None
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    fitted = fitted_basis(at)
    normal = np.linalg.pinv(at.jacobian, rcond=1e-10)
    seen: dict[str, _Seen | str] = {}
    for effect in catalogue:
        if effect.name not in model.effect_names:
            found = _seen(model, at, effect, fitted, normal, signal, settings)
            if not isinstance(found, str):
                found = _middle(
                    _at_its_size(model, at, u, effect, one, fitted, normal, settings)
                    if one.share * settings.sigmas < settings.far_signal
                    and not (linear and isinstance(effect, BodyEffect))
                    else one
                    for one in found
                )
            seen[effect.name] = found
            if linear and effect.link == "body":  # models of the finer mesh, of hundreds of MB
                at.body.forget_other_models()
    bases = {n: s.basis for n, s in seen.items() if isinstance(s, _Seen) and s.share < np.inf}
    slope = model.unknowns.slope(u)
    limits = []
    for effect in catalogue:
        chosen = seen.get(effect.name)
        if chosen is None:
            continue
        if isinstance(chosen, str):
            limits.append(Limit(effect.name, None, {}, 0.0, (), {}, chosen))
            continue
        cosines = [
            (float(np.linalg.norm(chosen.basis @ other)), name)
            for name, other in bases.items()
            if name != effect.name and effect.name in bases
        ]
        alike = sorted((pair for pair in cosines if pair[0] > settings.alike), reverse=True)
        factor = settings.bias_share / chosen.share if chosen.share > 0 else 0.0
        typical = [
            p.typical for p in effect.bounded(model.readings, at.state) if p.null is not None
        ]
        sizes, reason = settings.sigmas * chosen.sizes * typical, None
        if chosen.most is not None:
            sizes *= chosen.length / settings.sigmas
            reason = (
                f"even the largest that is possible, {100 * chosen.most:.2g} % of the signal, "
                f"would be only {chosen.length:.2g} standard errors in this scan"
            )
        limits.append(
            Limit(
                effect.name,
                settings.sigmas * chosen.share
                if np.isfinite(chosen.share) and reason is None
                else None,
                dict(zip((p.name for p in effect.amplitudes), sizes.tolist(), strict=True)),
                chosen.visible,
                tuple(
                    name for cosine, name in sorted(alike, reverse=True) if cosine > settings.alike
                ),
                dict(zip(model.names, (factor * chosen.bias * slope).tolist(), strict=True)),
                reason,
                chosen.most,
                dict(chosen.shape),
            )
        )
    return tuple(limits)


def _middle(candidates: Iterable[_Seen]) -> _Seen:
    """Return the middle one by its visible share, those never seen last."""
    ranked = sorted(candidates, key=lambda s: np.inf if s.most is not None else s.share)
    return ranked[len(ranked) // 2]


def _seen(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    fitted: np.ndarray,
    normal: np.ndarray,
    signal: float,
    settings: DetectionSettings,
) -> list[_Seen] | str:
    """Return the typical candidate's pattern alone, or the reason for none.

    Of an effect with a bent law (`Advice.levels`), the best-seen pattern of each shape: the typical
    one shows only at their own sizes.
    """
    reason = unavailable(effect, model)
    if reason is not None:
        return reason
    try:
        pattern = effect_patterns(model, at, effect, settings.candidates)
    except InadmissibleError as error:
        return str(error)
    if not pattern.shapes:
        return "the scan leaves no candidate of its shape that differs from another effect"
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
        share = float(np.sqrt(np.mean((column * at.sigma_m) ** 2))) / signal
        if visible[g] < settings.visible or not np.isfinite(weakest).all():
            share = np.inf
        along = left[g] @ weakest
        basis = along / max(float(np.linalg.norm(along)), 1e-300)
        candidates.append(
            _Seen(pattern.shapes[g], share, weakest, float(visible[g]), basis, normal @ column)
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


def _at_its_size(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    effect: Effect,
    linear: _Seen,
    fitted: np.ndarray,
    normal: np.ndarray,
    settings: DetectionSettings,
) -> _Seen:
    """Return the pattern at the amplitude of the detection limit, by the effect's own law.

    A skin's share falls off and a Poisson's ratio's grows with its size: the derivative at the null
    alone may be wrong by a factor of two.
    """
    sigmas = settings.sigmas
    parameters = {p.name: p for p in effect.bounded(model.readings, at.state)}
    amplitudes = [parameters[p.name] for p in effect.amplitudes]
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    nulls = np.array([p.null for p in amplitudes], float)
    typical = np.array([p.typical for p in amplitudes])
    low, high = (np.array([getattr(p, end) for p in amplitudes]) for end in ("lower", "upper"))
    sizes = sigmas * _inward(linear.sizes, amplitudes)
    found, growth, before = linear, 1.0, (0.0, 0.0)
    for _ in range(settings.tries):
        values = np.clip(nulls + sizes * typical, low, high)
        named = dict(zip((p.name for p in amplitudes), values.tolist(), strict=True))
        try:
            given = {**effect.null, **linear.shape, **named}
            moved_m = _moved(model, at, effect, given, settings.slack)
        except InadmissibleError:
            return found
        moved = at.whitened(moved_m, model.readings.press)
        left, bias = moved - fitted @ (fitted.T @ moved), normal @ moved
        projected = bias
        if np.abs(bias).max(initial=0.0) > settings.far_map:
            left, bias = _absorbed(model, at, u, moved_m, settings) or (left, bias)
        length = float(np.linalg.norm(left))
        if not np.isfinite(length) or length < settings.visible:
            return found
        share = float(np.sqrt(np.mean((moved * at.sigma_m) ** 2))) / signal / length
        found = replace(
            linear,
            share=share,
            sizes=(values - nulls) / typical / length,
            basis=left / length,
            # stated at 3 %: at less than the limit, the derivative is nearer to the truth
            bias=(projected if share * sigmas > settings.bias_share else bias) / length,
        )
        largest = not np.allclose(values, nulls + sizes * typical)  # that is possible
        if largest and length < sigmas:
            return replace(found, most=share * length, length=length)
        far = length < sigmas and share * length > settings.far_signal
        if abs(length / sigmas - 1) < settings.accuracy or far:
            return found
        sizes = (values - nulls) / typical
        now = float(np.log(np.linalg.norm(sizes))), float(np.log(length))
        if before != (0.0, 0.0) and now[0] != before[0]:
            growth = float(np.clip((now[1] - before[1]) / (now[0] - before[0]), 0.3, 3.0))
        before = now
        sizes = sizes * float(np.clip((sigmas / length) ** (1 / growth), 0.25, 4.0))
    return found


def _absorbed(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    moved_m: np.ndarray,
    settings: DetectionSettings,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit all unknowns to the model's own readings, moved by (m,) m; None if impossible.

    By few Gauss-Newton steps, of which the last is small and only projected.

    Returns
    -------
    whitened residual (m,), and change of the scaled unknowns (k,)
    """
    # At the latent forces, like the change: at measured forces, much of it would be noise, too
    force, body, e = at.latent_force_n, at.body, at.body.local_modulus
    if model.unit_compliance is not None:
        e = model.unit_compliance / body.compliance
    base = model.chain.predict(body.compliance, e, force, at.values)
    readings = replace(model.readings, force_n=force)
    model = replace(model, readings=readings, displacement_m=base + moved_m)
    if uncertain := model.map_uncertainty:  # about the map, of which these readings are
        offset = np.zeros_like(uncertain.offset)
        model = replace(model, map_uncertainty=replace(uncertain, offset=offset))
    low, high = model.bounds
    here, residual, jacobian = u, at.whitened(moved_m, readings.press), at.jacobian
    for step_number in range(settings.fit_steps + 1):
        step = np.linalg.pinv(jacobian, rcond=1e-10) @ residual
        longest = float(np.abs(step).max(initial=0.0))
        if longest <= settings.far_map or step_number == settings.fit_steps:
            break
        here = np.clip(here + step * min(1.0, settings.longest_step / longest), low, high)
        try:
            there = model.linearise(here, settings.slack)
        except InadmissibleError:
            return None
        residual, jacobian = there.residual, there.jacobian
    return residual - jacobian @ step, here + step - u


def _inward(sizes: np.ndarray, amplitudes: Sequence[EffectParameter]) -> np.ndarray:
    """Turn a direction of amplitudes to the side of most room within their bounds."""
    rooms = []
    for sign in (1.0, -1.0):
        room = []
        for size, p in zip(sign * sizes, amplitudes, strict=True):
            end = p.upper if size > 0 else p.lower
            room.append(abs(end - (p.null or 0.0)) / p.typical / max(abs(size), 1e-300))
        rooms.append(min(room))
    return sizes if rooms[0] >= rooms[1] else -sizes


def _moved(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    values: Mapping[str, float],
    slack: float,
) -> np.ndarray:
    """Return the change of the readings by an effect of these values, (m,) m."""
    present, force = model.chain, at.latent_force_n
    c, e = at.compliance, at.modulus
    base = present.predict(c, e, force, at.values)
    if isinstance(effect, BodyEffect):
        dc, de = at.body.exact_change(effect.body(at.state, **values), slack)
        if model.unit_compliance is not None:
            de = e / (1 + dc / c) - e
        moved = present.predict(c + dc, e + de, force, at.values)
    else:
        chain = replace(present, effects=[*present.effects, effect])
        moved = chain.predict(c, e, force, {**at.values, effect.name: values})
    return moved - base
