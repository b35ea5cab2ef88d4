"""Score every effect of a catalogue from the present fit, without refitting.

With the whitened residual r, the derivatives G by the fitted parameters and A by an effect's
amplitudes at their null, all at the latent force:

    A_perp = A - G (G'G)^-1 G'A        S = r' A_perp (A_perp'A_perp)^-1 A_perp' r ~ chi2_q

The bias of r by the map's curvature is subtracted first (`identify.fit.curvature_bias`). Shape
parameters are searched on a grid; the p-value counts the search (`NullSearch`). The part of a
pattern along the fitted parameters cannot be seen: `visible` is the share beyond them.
Source: Rao's score test; Neyman's C(alpha) for the projection.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identify.effects.base import Effect, EffectParameter, advice, changes_body
from identify.fit.result import FitResult
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.residual.hypothesis_tests import orthonormal
from identify.select.null_distribution import NullNoise, NullSearch
from identify.select.patterns import EffectPattern, effect_patterns, pattern_blocks
from identify.select.settings import DIAGNOSIS, DiagnosisSettings

_NOT_FINITE = "the model has no finite answer to it at this map"
_NO_SHAPE = "the scan leaves no candidate of its shape that differs from another effect"


@dataclass(frozen=True)
class Score:
    """Linear estimate of an effect and its evidence in the scan.

    Attributes
    ----------
    name : of the effect
    statistic : decrease of chi-square, to first order
    log_p : natural logarithm of the p-value, the search over the grid counted
    values : first estimate of all parameters
    sizes : (q,) amplitudes in typical sizes, `errors` their standard errors
    visible : share of the effect's pattern beyond the fitted parameters
    beyond : (m, q) orthonormal basis of that part
    rms_m : root mean square of the effect's contribution to the readings, m
    untestable : reason why the scan cannot show it, or None
    family : of the effect
    """

    name: str
    statistic: float
    log_p: float
    values: Mapping[str, float]
    sizes: np.ndarray
    errors: np.ndarray
    visible: float
    beyond: np.ndarray
    rms_m: float
    untestable: str | None = None
    family: str = ""

    @property
    def p_value(self) -> float:
        """P-value under pure noise, not less than 1e-300."""
        return float(np.exp(max(self.log_p, np.log(1e-300))))


def fitted_basis(at: Linearised) -> np.ndarray:
    """Orthonormal basis (m, r) of the derivatives by the fitted parameters."""
    return orthonormal(at.jacobian)


def beyond(
    pattern: EffectPattern, fitted: np.ndarray, settings: DiagnosisSettings = DIAGNOSIS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Project the fitted parameters out of a pattern.

    Returns
    -------
    columns (g, m, q) beyond, an orthonormal basis (g, m, r) of them (zero where the map absorbs a
    direction; r <= q directions that some candidate keeps), visible share (g,)
    """
    a = pattern.columns
    left = fitted @ (fitted.T @ a)
    np.subtract(a, left, out=left)
    length = np.sqrt(np.einsum("gmq,gmq->gq", a, a))
    kept = np.sqrt(np.einsum("gmq,gmq->gq", left, left))
    visible = np.sqrt(np.sum(kept**2, axis=1) / np.maximum(np.sum(length**2, axis=1), 1e-300))
    if a.shape[2] == 1:  # signed: a one-sided score asks for the side
        basis = left / np.maximum(kept, 1e-300)[:, None, :]
    else:  # a direction below the visible share is rounding, and no degree of freedom
        scale = 1 / np.maximum(length, 1e-300)
        products = (left.swapaxes(1, 2) @ left) * scale[:, :, None] * scale[:, None, :]
        square, directions = np.linalg.eigh(products)
        square, directions = square[:, ::-1], directions[:, :, ::-1]
        seen = square > settings.visible**2
        combined = scale[:, :, None] * directions * seen[:, None, :]
        basis = left @ (combined / np.sqrt(np.where(seen, square, 1.0))[:, None, :])
        basis = basis[:, :, : max(int(seen.sum(axis=1).max()), 1)]
    basis[visible < settings.visible] = 0.0
    return left, basis, visible


class _Candidate(NamedTuple):
    """Shape with the largest score so far, with its patterns and their visible parts."""

    signed: float
    shape: Mapping[str, float]
    change_m: np.ndarray
    left: np.ndarray
    basis: np.ndarray
    visible: float


def score_effect(
    fit: FitResult,
    effect: Effect,
    fitted: np.ndarray,
    noise: NullNoise | None = None,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Score:
    """Score one effect from a fit.

    Parameters
    ----------
    fitted : `fitted_basis(fit.at)`
    noise : from which the null is simulated; drawn anew without it
    """
    model, at = fit.model, fit.at
    count, sign = len(at.residual), side(effect.bounded(model.readings, at.state))
    if (reason := unavailable(effect, model)) is not None:
        return unscored(effect, reason, count)
    shapes, residual = effect.grid(model.readings, at.state), at.residual - fit.expected_residual
    levels = len(advice(effect).levels(at.state)) if changes_body(effect) else 0
    search = NullSearch(
        len(shapes) * (1 + levels),
        len(effect.amplitudes),
        sign != 0,
        noise or NullNoise(),
        settings,
    )
    best, most_visible = None, 0.0
    try:
        for second in (False, True):
            for pattern in pattern_blocks(model, at, effect, shapes, settings.block_bytes):
                if not np.isfinite(pattern.columns).all():
                    return unscored(effect, _NOT_FINITE, count)
                left, basis, visible = beyond(pattern, fitted, settings)
                most_visible = max(most_visible, float(visible.max()))
                t = np.einsum("gmq,m->gq", basis, residual)
                signed = np.sum(t**2, axis=1)
                if sign:  # a shape that the fit absorbs has no side
                    signed = np.where(visible < settings.visible, -np.inf, sign * t[:, 0])
                g = int(np.argmax(signed))
                if best is None or signed[g] > best.signed:
                    best = _Candidate(
                        float(signed[g]), pattern.shapes[g], pattern.change_m[g].copy(),
                        left[g].copy(), basis[g].copy(), float(visible[g]),
                    )  # fmt: skip
                search.add(sign * basis if sign else basis, best.signed)
            if second or best is None or len(shapes) < 2 or not search.is_certain(best.signed):
                break
            shapes = advice(effect).around(best.shape, model.readings)
            search.widen(len(shapes))
    except InadmissibleError as error:
        return unscored(effect, str(error), count)
    if best is None:
        return unscored(effect, _NO_SHAPE, count)
    if most_visible < settings.visible:
        return unscored(effect, "the stiffness map absorbs it entirely", count)
    return _score_of(effect, best, residual, at, sign, search.null(best.signed).log_p(best.signed))


def _score_of(
    effect: Effect,
    best: _Candidate,
    residual: np.ndarray,
    at: Linearised,
    sign: float,
    log_p: float,
) -> Score:
    """Return the score of the best shape, with its amplitudes by least squares."""
    left, signed = best.left, best.signed
    sizes, *_ = np.linalg.lstsq(left, residual, rcond=1e-10)
    errors = np.sqrt(np.diag(np.linalg.pinv(left.T @ left)))
    if sign and signed <= 0:
        sizes = np.zeros_like(sizes)
    values = dict(best.shape)
    for amplitude, size in zip(effect.amplitudes, sizes, strict=True):
        assert amplitude.null is not None
        values[amplitude.name] = amplitude.null + float(size) * amplitude.typical
    moved = best.change_m @ sizes
    return Score(
        name=effect.name,
        statistic=max(signed, 0.0) ** 2 if sign else signed,
        log_p=log_p,
        values=values,
        sizes=sizes,
        errors=errors,
        visible=best.visible,
        beyond=best.basis,
        rms_m=float(np.sqrt(np.mean(moved**2))),
        family=effect.family,
    )


def side(parameters: Sequence[EffectParameter]) -> float:
    """+1 or -1 where a single amplitude can only rise or fall from its null, else 0."""
    amplitudes = [p for p in parameters if p.null is not None]
    if len(amplitudes) != 1:
        return 0.0
    (only,) = amplitudes
    return 1.0 if only.null == only.lower else -1.0 if only.null == only.upper else 0.0


def patterns_or_reason(
    model: MeasurementModel, at: Linearised, effect: Effect, most: int | None = None
) -> EffectPattern | str:
    """Return `effect_patterns`, or the reason why an effect cannot be tested beside a model."""
    if (reason := unavailable(effect, model)) is not None:
        return reason
    try:
        pattern = effect_patterns(model, at, effect, most)
    except InadmissibleError as error:
        return str(error)
    if not np.isfinite(pattern.columns).all():
        return _NOT_FINITE
    if not pattern.shapes:
        return _NO_SHAPE
    return pattern


def unavailable(effect: Effect, model: MeasurementModel) -> str | None:
    """Return the reason why an effect cannot be tested beside a model, or None."""
    chain = model.chain
    if model.map_uncertainty is not None and _is_a_map(effect, model):
        return "a free map has every such form"
    return effect.untestable(model.readings) or advice(effect).redundant(
        chain.profile, chain.nonlinear
    )


def _is_a_map(effect: Effect, model: MeasurementModel) -> bool:
    """Return True for an effect that changes the modulus in the body and nothing else."""
    if not changes_body(effect):
        return False
    state = model.mechanics.state().changed(background_pa=model.space.start.background_pa)
    shapes = effect.grid(model.readings, state)
    sizes = {p.name: (p.null or 0.0) + 1e-3 * p.typical * (-1 if p.null == p.upper else 1)
             for p in effect.bounded(model.readings, state) if p.null is not None}  # fmt: skip
    changed = effect.body(state, **{**(shapes[0] if shapes else {}), **sizes}) if shapes else state
    same = changed.without_modulus_changes == state.without_modulus_changes
    return same and changed.modulus_changes != state.modulus_changes


def unscored(effect: Effect, reason: str, readings: int) -> Score:
    """Return the score of an effect that this scan cannot show."""
    none = np.zeros(len(effect.amplitudes))
    return Score(effect.name, 0.0, 0.0, effect.null, none, none, 0.0,
                 np.zeros((readings, len(none))), 0.0, reason, effect.family)  # fmt: skip


def cosine(one: Score, other: Score) -> float:
    """Largest cosine between two effects' patterns beyond the fitted parameters, 0 to 1."""
    product = one.beyond.T @ other.beyond
    return float(np.linalg.svd(product, compute_uv=False).max(initial=0.0))


def holm_significant(scores: Sequence[Score], alpha: float) -> set[str]:
    """Names of the effects that stay significant under Holm's correction over the catalogue."""
    tested = sorted((s for s in scores if s.untestable is None), key=lambda s: s.log_p)
    found: set[str] = set()
    for rank, score in enumerate(tested):
        if score.log_p > np.log(alpha / (len(tested) - rank)):
            break
        found.add(score.name)
    return found
