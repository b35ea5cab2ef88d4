"""What a scan can see of each effect, what it would take it for, and what ignoring it would do.

All from the derivatives at the present fit, for this scan or for one that is only planned:

    smallest amplitude seen    5 / |A_perp|   (5 standard errors, after the map took its share),
                               A the effect's own move of the readings at about that amplitude
    confused with              effects whose A_perp has a cosine above 0.9 with its own
    bias of the map            (G'G)^-1 G'A a: what the fitted map takes for the effect

Where that bias is large, the map's own curvature decides what it absorbs (in one case a ball's edge
was seen from 3.2 % on, not 1.9 %): the map is then fitted to the move itself, and |A_perp| is what
the fit leaves. Source: the same algebra as the score test, see `identify.select.score_test`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identify.effects.base import BodyEffect, Effect, EffectParameter
from identify.fit.result import FitResult
from identify.measurement.chain import Chain
from identify.measurement.model import Linearised, MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.select.diagnosis import ALIKE
from identify.select.score_test import beyond, effect_patterns, fitted_basis

SIGMAS = 5.0
SHARE = 0.03  # of the signal: the size at which a bias of the map is stated
_SAMPLE = 12  # candidates of a grid that are looked at
_NOTHING = 1e-5
_UNMOVED = 1e-9  # of what the amplitudes together move: beyond rounding, nothing
_TRIES = 8  # at the amplitude whose own pattern is 5 standard errors long
_EXACT = 0.1  # of that length
_FAR_MAP = 0.1  # of a scaled unknown: beyond it the map is fitted to an effect, not projected
_STEPS, _LONGEST = 4, 0.5  # of such a fit
_FAR = 0.5  # of the signal: beyond it, what the linear pattern says is good enough


@dataclass(frozen=True)
class Limit:
    """What a scan can see of one effect.

    Attributes
    ----------
    name : of the effect
    smallest_share : of the signal's rms that 5 standard errors are; None where nothing is seen
    largest_share : that the effect can have at all, where even that is not seen; else None
    shape : values of its other parameters, for which this holds: such as a skin's thickness
    sizes : amplitudes at that size, or else at the largest, by parameter, in their units
    visible : share of the pattern that the map leaves
    confused_with : effects that look the same to this scan
    map_bias : by parameter, in its unit, what ignoring the effect at 3 % of the signal does
    untestable : why the scan cannot show it at all, or None
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

    `most` is the share of the signal that is possible at all, where that is too little to be seen,
    `length` how many standard errors that would be.
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
    fit: FitResult, catalogue: Sequence[Effect], at: Linearised | None = None
) -> tuple[Limit, ...]:
    """Return the limits of every effect of a catalogue that the model does not have.

    Parameters
    ----------
    at : the model's linearisation; default the fit's own
    """
    return limits_at(fit.model, at or fit.at, fit.u, catalogue)


def limits_at(
    model: MeasurementModel, at: Linearised, u: np.ndarray, catalogue: Sequence[Effect]
) -> tuple[Limit, ...]:
    """Return the limits of a model linearised at scaled unknowns u (k,)."""
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    fitted = fitted_basis(at)
    normal = np.linalg.pinv(at.jacobian, rcond=1e-10)
    seen: dict[str, _Seen | str] = {}
    for effect in catalogue:
        if effect.name not in model.effect_names:
            found = _seen(model, at, effect, fitted, normal, signal)
            if not isinstance(found, str):
                found = _middle(
                    _at_its_size(model, at, u, effect, one, fitted, normal)
                    if one.share * SIGMAS < _FAR
                    else one
                    for one in found
                )
            seen[effect.name] = found
    bases = {n: s.basis for n, s in seen.items() if isinstance(s, _Seen) and s.share < np.inf}
    slope = model.unknowns.slope(u)
    limits = []
    for effect in catalogue:
        own = seen.get(effect.name)
        if own is None:
            continue
        if isinstance(own, str):
            limits.append(Limit(effect.name, None, {}, 0.0, (), {}, own))
            continue
        alike = [
            (float(np.linalg.norm(own.basis @ other)), name)
            for name, other in bases.items()
            if name != effect.name and effect.name in bases
        ]
        factor = SHARE / own.share if own.share > 0 else 0.0
        typical = [
            p.typical for p in effect.bounded(model.readings, at.state) if p.null is not None
        ]
        sizes, reason = SIGMAS * own.sizes * typical, None
        if own.most is not None:
            sizes *= own.length / SIGMAS
            reason = (
                f"even the largest that is possible, {100 * own.most:.2g} % of the signal, would "
                f"be only {own.length:.2g} standard errors in this scan"
            )
        limits.append(
            Limit(
                effect.name,
                SIGMAS * own.share if np.isfinite(own.share) and reason is None else None,
                dict(zip((p.name for p in effect.amplitudes), sizes.tolist(), strict=True)),
                own.visible,
                tuple(name for cosine, name in sorted(alike, reverse=True) if cosine > ALIKE),
                dict(zip(model.names, (factor * own.bias * slope).tolist(), strict=True)),
                reason,
                own.most,
                dict(own.shape),
            )
        )
    return tuple(limits)


def _middle(candidates: Iterable[_Seen]) -> _Seen:
    """Return the middle one by what is seen of it, those that are never seen last."""
    ranked = sorted(candidates, key=lambda s: np.inf if s.most is not None else s.share)
    return ranked[len(ranked) // 2]


def _seen(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    fitted: np.ndarray,
    normal: np.ndarray,
    signal: float,
) -> list[_Seen] | str:
    """Return the typical candidate's pattern alone, or why there is none.

    Of an effect whose law bends (`Effect.levels`), the pattern that is seen best of each shape:
    which of them is typical shows only at their own sizes.
    """
    chain = model.chain
    reason = effect.untestable(model.readings) or effect.redundant(chain.profile, chain.nonlinear)
    if reason is not None:
        return reason
    try:
        pattern = effect_patterns(model, at, effect, _SAMPLE)
    except InadmissibleError as error:
        return str(error)
    if not pattern.shapes:
        return "the scan leaves no candidate of its shape to be told from another effect"
    left, _, visible = beyond(pattern, fitted)
    candidates, unmoved = [], False
    for g in range(len(left)):
        # The direction of the amplitudes that shows least
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
        if visible[g] < _NOTHING or not np.isfinite(weakest).all():
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
    if effect.levels(at.state):
        by_shape = {tuple(s.shape.items()): s for s in reversed(candidates)}
        chosen = list(by_shape.values())
    chosen = [s for s in chosen if np.isfinite(s.share)]
    return chosen or "the stiffness map absorbs it entirely"


def _at_its_size(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    effect: Effect,
    own: _Seen,
    fitted: np.ndarray,
    normal: np.ndarray,
) -> _Seen:
    """Return the pattern at the amplitude at which it is `SIGMAS` long, as the effect's law has it.

    A skin's share falls off and a Poisson's ratio's grows with its size: the derivative at the null
    alone may be wrong by a factor of two.
    """
    parameters = {p.name: p for p in effect.bounded(model.readings, at.state)}
    amplitudes = [parameters[p.name] for p in effect.amplitudes]
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    nulls = np.array([p.null for p in amplitudes], float)
    typical = np.array([p.typical for p in amplitudes])
    low, high = (np.array([getattr(p, end) for p in amplitudes]) for end in ("lower", "upper"))
    sizes = SIGMAS * _inward(own.sizes, amplitudes)
    found, growth, before = own, 1.0, (0.0, 0.0)
    for _ in range(_TRIES):
        values = np.clip(nulls + sizes * typical, low, high)
        named = dict(zip((p.name for p in amplitudes), values.tolist(), strict=True))
        try:
            moved_m = _moved(model, at, effect, {**effect.null, **own.shape, **named})
        except InadmissibleError:
            return found
        moved = at.whitened(moved_m, model.readings.press)
        left, bias = moved - fitted @ (fitted.T @ moved), normal @ moved
        linear = bias
        if np.abs(bias).max(initial=0.0) > _FAR_MAP:
            left, bias = _absorbed(model, at, u, moved_m) or (left, bias)
        length = float(np.linalg.norm(left))
        if not np.isfinite(length) or length < _NOTHING:
            return found
        share = float(np.sqrt(np.mean((moved * at.sigma_m) ** 2))) / signal / length
        found = replace(
            own,
            share=share,
            sizes=(values - nulls) / typical / length,
            basis=left / length,
            # stated at 3 %: at less than the limit, the derivative is nearer to the truth
            bias=(linear if share * SIGMAS > SHARE else bias) / length,
        )
        largest = not np.allclose(values, nulls + sizes * typical)  # that is possible
        if largest and length < SIGMAS:
            return replace(found, most=share * length, length=length)
        if abs(length / SIGMAS - 1) < _EXACT or (length < SIGMAS and share * length > _FAR):
            return found
        sizes = (values - nulls) / typical
        now = float(np.log(np.linalg.norm(sizes))), float(np.log(length))
        if before != (0.0, 0.0) and now[0] != before[0]:
            growth = float(np.clip((now[1] - before[1]) / (now[0] - before[0]), 0.3, 3.0))
        before = now
        sizes = sizes * float(np.clip((SIGMAS / length) ** (1 / growth), 0.25, 4.0))
    return found


def _absorbed(
    model: MeasurementModel, at: Linearised, u: np.ndarray, moved_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit all unknowns to the model's own readings, moved by (m,) m; None where that is impossible.

    By few Gauss-Newton steps, the last of which is small and only projected.

    Returns
    -------
    what is left (m,), whitened, and how far the unknowns went (k,), scaled
    """
    # At the latent forces, as the move is: at forces with noise, much of it would be noise, too
    force, body = at.latent_force_n, at.body
    base = model.chain.predict(body.compliance, body.local_modulus, force, at.values)
    readings = replace(model.readings, force_n=force)
    model = replace(model, readings=readings, displacement_m=base + moved_m)
    low, high = model.bounds
    here, residual, jacobian = u, at.whitened(moved_m, readings.press), at.jacobian
    for step_number in range(_STEPS + 1):
        step = np.linalg.pinv(jacobian, rcond=1e-10) @ residual
        longest = float(np.abs(step).max(initial=0.0))
        if longest <= _FAR_MAP or step_number == _STEPS:
            break
        here = np.clip(here + step * min(1.0, _LONGEST / longest), low, high)
        try:
            there = model.linearise(here)
        except InadmissibleError:
            return None
        residual, jacobian = there.residual, there.jacobian
    return residual - jacobian @ step, here + step - u


def _inward(sizes: np.ndarray, amplitudes: Sequence[EffectParameter]) -> np.ndarray:
    """Turn a direction of amplitudes to the side on which their bounds leave most room."""
    rooms = []
    for sign in (1.0, -1.0):
        room = []
        for size, p in zip(sign * sizes, amplitudes, strict=True):
            end = p.upper if size > 0 else p.lower
            room.append(abs(end - (p.null or 0.0)) / p.typical / max(abs(size), 1e-300))
        rooms.append(min(room))
    return sizes if rooms[0] >= rooms[1] else -sizes


def _moved(
    model: MeasurementModel, at: Linearised, effect: Effect, values: Mapping[str, float]
) -> np.ndarray:
    """Return what an effect of these values moves the readings by, (m,) m."""
    own, force = model.chain, at.latent_force_n
    c, e = at.body.compliance, at.body.local_modulus
    base = own.predict(c, e, force, at.values)
    if isinstance(effect, BodyEffect):
        dc, de = at.body.exact_change(effect.body(at.state, **values))
        moved = own.predict(c + dc, e + de, force, at.values)
    else:
        effects = [*own.effects, effect]
        chain = Chain(own.readings, effects, own.radius_m, own.profile, own.poisson_ratio)
        moved = chain.predict(c, e, force, {**at.values, effect.name: values})
    return moved - base
