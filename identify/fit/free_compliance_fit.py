"""Result of a fit of effects with one free compliance per press.

A few unexplained presses (beside a hard lump, a slip) must not choose the law of the others: a
press with chi-square X in n readings counts as a n ln(1 + X/(a n)), by weights renewed between fits
(Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 1989).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from identify.effects.base import Values
from identify.effects.readings import Readings
from identify.fit.settings import (
    FREE_COMPLIANCE,
    ContactLawSettings,
    FreeComplianceSettings,
)
from identify.measurement.effect_in_model import EffectInModel


@dataclass(frozen=True)
class FreeComplianceFit:
    """The best compliances of the presses beside some effects.

    Attributes
    ----------
    parts : the effects, with their parameters
    values : of their parameters, by effect and name
    press : (m,) index of each reading's press
    compliance : (j,) m/N
    residual : (m,) whitened
    residual_m : (m,) measured less modelled displacement
    residual_n : (m,) the same as a force, over the slope of the press's curve
    at_bound : names of parameters at a bound other than their null
    felt : (j,) bool, presses that met resistance; the others, of noise alone, count for nothing
    settings : of the fit
    on_any_body : (j,) least chi-square of each press on a body of any kind, see
        `identify.fit.free_compliance_start.on_any_body`; None where it was not asked for
    between, again : chi-square by which the compliances of presses of one place differ, and its
        degrees of freedom; 0 where no place is pressed again, or that was not asked for
    """

    parts: tuple[EffectInModel, ...]
    values: Mapping[str, Values]
    press: np.ndarray
    compliance: np.ndarray
    residual: np.ndarray
    residual_m: np.ndarray
    residual_n: np.ndarray
    at_bound: tuple[str, ...]
    felt: np.ndarray
    settings: FreeComplianceSettings = FREE_COMPLIANCE
    on_any_body: np.ndarray | None = None
    between: float = 0.0
    again: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(part.effect.name for part in self.parts)

    @property
    def unknowns(self) -> int:
        """Number of the effects' parameters."""
        return sum(len(part.parameters) for part in self.parts)

    @property
    def chi2(self) -> float:
        """Chi-square of the readings that count."""
        return float(np.sum(self.by_press[0][self.felt]))

    @property
    def dof(self) -> int:
        """Degrees of freedom: readings less compliances less parameters."""
        readings = int(np.sum(self.by_press[1][self.felt]))
        return max(readings - int(self.felt.sum()) - self.unknowns, 1)

    @property
    def chi2_per_dof(self) -> float:
        """Chi-square per degree of freedom."""
        return self.chi2 / self.dof

    @property
    def rms_m(self) -> float:
        """Root mean square of the residual, m."""
        return float(np.sqrt(np.mean(self.residual_m**2)))

    @property
    def rms_n(self) -> float:
        """Root mean square of the residual as a force, N."""
        return float(np.sqrt(np.mean(self.residual_n**2)))

    @property
    def typical_n(self) -> float:
        """Root mean square of the residual of the middle press, as a force, N."""
        squares, count = np.bincount(self.press, self.residual_n**2), np.bincount(self.press)
        return float(np.sqrt(np.median(squares / np.maximum(count, 1))))

    @cached_property
    def by_press(self) -> tuple[np.ndarray, np.ndarray]:
        """Chi-square and number of readings of each press, both (j,)."""
        presses = len(self.compliance)
        squares = np.bincount(self.press, self.residual**2, presses)
        return squares, np.bincount(self.press, minlength=presses)

    @property
    def chi2_on_any_body(self) -> float:
        """Chi-square of the readings that count, where each press is on a body of any kind."""
        return float(np.sum(self._least[self.felt]))

    @property
    def weight(self) -> np.ndarray:
        """Weight (j,) of each press in the next fit, 1 for one without error."""
        squares, count = self.by_press
        return self.felt / (1 + squares / (self.settings.tail * np.maximum(count, 1)))

    @property
    def misfit(self) -> float:
        """Robust sum over the presses, without one that outweighs the others.

        Near chi-square if all fit.
        """
        squares, count = self.by_press
        most = self.settings.tail * np.maximum(count, 1)
        return float(np.sum((most * np.log1p(squares / most))[self.felt]))

    @property
    def total(self) -> float:
        """Misfit of the curves and of places that are pressed again."""
        return self.misfit + self.between

    @property
    def is_of_places(self) -> bool:
        """True where presses of one place have one compliance, to the noise."""
        return self.again > 0 and self.between < chdtri(self.again, self.settings.places_differ)

    @property
    def noise_share(self) -> float:
        """Share of the presses with a residual of noise alone (99 % level)."""
        squares, count = self.by_press
        return float(np.mean((squares < chdtri(np.maximum(count - 1, 1), 0.01))[self.felt]))

    @property
    def middle_misfit(self) -> float:
        """Chi-square of the middle press over that of noise, each on a body of any kind.

        A few presses without contact, or on what is hard below a thin layer, do not change it.
        """
        noise = chdtri(np.maximum(self.by_press[1] - 1, 1), 0.5)
        return float(np.median((self._least / noise)[self.felt]))

    @property
    def _least(self) -> np.ndarray:
        return self.by_press[0] if self.on_any_body is None else self.on_any_body


def straightened(found: FreeComplianceFit, readings: Readings) -> np.ndarray:
    """Displacement (m,) m of the presses without the effects: C F and the residual."""
    return found.compliance[readings.press] * readings.force_n + found.residual_m


def is_calm(fit: FreeComplianceFit, settings: ContactLawSettings) -> bool:
    """Return True for a fit that leaves noise alone."""
    return fit.misfit < fit.dof + settings.noise_sd * np.sqrt(2 * fit.dof)


def causes(fit: FreeComplianceFit) -> list[str]:
    """Return the families of the effects, sorted."""
    return sorted(part.effect.family for part in fit.parts)


def is_no_law(fit: FreeComplianceFit, settings: ContactLawSettings) -> bool:
    """Whether so few of a sample of presses are noise that the law cannot be that of all."""
    least = settings.noise_share
    return fit.noise_share < least - 3 * np.sqrt(least * (1 - least) / max(fit.felt.sum(), 1))


def contained(fit: FreeComplianceFit, name: str) -> tuple[str, ...]:
    """Return the effects that are special cases of one of a fit."""
    return next(p.effect.contains for p in fit.parts if p.effect.name == name)


def one_of_contact(fits: Sequence[FreeComplianceFit], names: set[str]) -> bool:
    """Return True where the names are one, of an effect of the contact."""
    parts = [p for fit in fits for p in fit.parts if p.effect.name in names]
    return len(names) == 1 and all("contact" in p.effect.hooks for p in parts)
