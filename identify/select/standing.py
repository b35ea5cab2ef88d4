"""Standing of an effect beside a structured residual: whether the rest can be its cause.

Readings differ within presses, and presses differ between each other by an offset and a gain. An
effect whose evidence lies within the presses, where the residual is noise once it is in the model,
does not owe its name to a structure between the presses; nor the other way round. An effect that
shows only where structure remains may be the imitation of the unknown cause, and is not offered.
Nor are two causes that share a part: together they may be the imitation of a third.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from identify.effects.base import BodyEffect
from identify.fit.result import FitResult
from identify.residual.comparison import Comparison
from identify.residual.hypothesis_tests import orthonormal, score_test

_BETWEEN = ("place", "order", "press", "all_presses", "neighbours", "succession")
_STEPS = 6  # of the force, in a common course
_NOISE_P = 1e-3  # of the chi-square of a part, above which it is noise
_EVIDENCE = 50.0  # chi-square of an effect in a part that is noise: seven standard errors


@dataclass(frozen=True)
class Parts:
    """Split of whitened readings (m,) into a part between presses and one within them."""

    press: np.ndarray
    level: np.ndarray
    slope: np.ndarray

    @classmethod
    def of(cls, fit: FitResult) -> "Parts":
        """Return the split of a fit's readings, by an offset and a gain of each press."""
        press, sigma = fit.model.readings.press, fit.at.sigma_m
        level = _normalised(1 / sigma, press)
        slope = fit.at.latent_force_n / sigma
        slope = slope - level * np.bincount(press, level * slope)[press]
        return cls(press, level, _normalised(slope, press))

    def between(self, values: np.ndarray) -> np.ndarray:
        """Part (m,) of values (m,) that is an offset and a gain of each press."""
        return sum(
            column * np.bincount(self.press, column * values)[self.press]
            for column in (self.level, self.slope)
        )  # pyright: ignore[reportReturnType]


def standing(fit: FitResult, comparison: Comparison) -> frozenset[str]:
    """Return the effects of a fit that do not owe their name to the structure of its residual."""
    parts, residual = Parts.of(fit), fit.at.residual
    between = parts.between(residual)
    fires = {test.name for test in comparison.tests if test.fires}
    free, m = len(fit.u), len(residual)
    presses = 2 * fit.model.readings.presses
    noise = {
        "between": _is_noise(between, presses - free) and not fires & set(_BETWEEN),
        "within": _is_noise(residual - between, m - presses) and not _common_course(fit, parts),
    }
    if not any(noise.values()):
        return frozenset()
    shown: dict[str, dict[str, str]] = {"between": {}, "within": {}}
    for part in fit.model.effects:
        name, family = part.effect.name, part.effect.family
        pattern = effect_part(fit, name)
        shared = parts.between(pattern)
        if shared @ shared > _EVIDENCE:
            shown["between"][name] = family
        if np.sum((pattern - shared) ** 2) > _EVIDENCE:
            shown["within"][name] = family
    # Two causes in one part may together be the imitation of a third
    alone = [shown[part] for part in noise if noise[part] and len(set(shown[part].values())) == 1]
    return frozenset(name for names in alone for name in names)


def _common_course(fit: FitResult, parts: Parts) -> bool:
    """Return True for a residual with a course within the presses that all of them share.

    Steps of the force, phase by phase, as a length and as a share of the force.
    """
    readings, sigma, residual = fit.model.readings, fit.at.sigma_m, fit.at.residual
    peak = np.maximum(readings.peak_force_n, 1e-12)
    step = np.clip((_STEPS * fit.at.latent_force_n / peak).astype(int), 0, _STEPS - 1)
    phases = {name: i for i, name in enumerate(dict.fromkeys(readings.phase.tolist()))}
    kind = step + _STEPS * np.array([phases[name] for name in readings.phase.tolist()])
    _, kind = np.unique(kind, return_inverse=True)
    columns = (kind[:, None] == np.arange(kind.max() + 1)) / sigma[:, None]
    columns = np.hstack([columns, columns * fit.at.latent_force_n[:, None] / peak.max()])
    within = columns - np.column_stack([parts.between(column) for column in columns.T])
    found = score_test(residual - parts.between(residual), within, orthonormal(fit.at.jacobian))
    return found.p_value < _NOISE_P


def effect_part(fit: FitResult, name: str) -> np.ndarray:
    """Whitened change (m,) of the prediction by an effect, beyond map and other effects."""
    at, model = fit.at, fit.model
    (part,) = (part for part in model.effects if part.effect.name == name)
    absent = {**at.values, name: {**at.values[name], **part.effect.null}}
    if isinstance(part.effect, BodyEffect):
        dc, de = at.body.exact_change(model.state(absent))
        press = model.readings.press
        change = -(at.by_compliance * dc[press] + at.by_modulus * de[press])
    else:
        c, e, force = at.compliance, at.modulus, at.latent_force_n
        present, gone = (model.chain.predict(c, e, force, v) for v in (at.values, absent))
        change = present - gone
    own = [i for i, unknown in enumerate(model.names) if not unknown.startswith(f"{name}.")]
    fitted = orthonormal(at.jacobian[:, own])
    whitened = at.whitened(change, model.readings.press)
    return whitened - fitted @ (fitted.T @ whitened)


def _is_noise(values: np.ndarray, dof: int) -> bool:
    return float(chdtrc(max(dof, 1), values @ values)) > _NOISE_P


def _normalised(column: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Return a column (m,) of unit length within each press, 0 where it vanishes."""
    length = np.sqrt(np.bincount(press, column**2))[press]
    return np.divide(column, length, out=np.zeros_like(column), where=length > 1e-9 * length.max())
