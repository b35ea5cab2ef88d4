"""The pattern of an effect at the size of its detection limit, by its own law.

For a large bias, the map's own curvature decides on its absorption (in one case a ball's edge was
seen from 3.2 % on, not 1.9 %): the map is then fitted to the change itself, and |A_perp| is the
residual of that fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from identify.design.seen_pattern import SeenPattern, signal_m
from identify.design.settings import DetectionSettings
from identify.effects.base import Effect, EffectParameter, changes_body
from identify.measurement.chain import OperatingPoint
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError


def at_its_size(
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    effect: Effect,
    linear: SeenPattern,
    fitted: np.ndarray,
    normal: np.ndarray,
    settings: DetectionSettings,
) -> SeenPattern:
    """Return the pattern at the amplitude of the detection limit, by the effect's own law.

    A skin's share falls off and a Poisson's ratio's grows with its size: the derivative at the null
    alone may be wrong by a factor of two.
    """
    sigmas = settings.sigmas
    parameters = {p.name: p for p in effect.bounded(model.readings, at.state)}
    amplitudes = [parameters[p.name] for p in effect.amplitudes]
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
        share = float(np.sqrt(np.mean(moved_m**2))) / signal_m(at) / length
        found = replace(
            linear,
            share=share,
            sizes=(values - nulls) / typical / length,
            basis=left / length,
            bend=share / linear.share,
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
    base = model.chain.predict(OperatingPoint(body.compliance, e, force, at.values))
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
    present, here = model.chain, at.point
    if changes_body(effect):
        c, e = at.compliance, at.modulus
        dc, de = at.body.exact_change(effect.body(at.state, **values), slack)
        if model.unit_compliance is not None:
            de = e / (1 + dc / c) - e
        moved = present.predict(here._replace(compliance=c + dc, modulus=e + de))
    else:
        chain = replace(present, effects=[*present.effects, effect])
        moved = chain.predict(here._replace(values={**at.values, effect.name: values}))
    return moved - present.predict(here)
