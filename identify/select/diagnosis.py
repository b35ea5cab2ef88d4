"""Diagnosis of a fit: significant effects of a catalogue, and groups that look alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from identify.effects.base import Effect
from identify.fit.result import FitResult
from identify.select.null_distribution import NullNoise
from identify.select.score_test import (
    Score,
    cosine,
    fitted_basis,
    holm_significant,
    score_effect,
    unscored,
)
from identify.select.settings import (
    DIAGNOSIS,
    SELECTION,
    DiagnosisSettings,
    SelectionSettings,
)

CandidateVerdict = Literal["supported", "helps", "indistinguishable", "not_seen", "untestable"]
"""Of one effect; "helps": lower chi-square, but structure remains (never from scores alone)."""


@dataclass(frozen=True)
class EffectVerdict:
    """The verdict on one effect, with the numbers of the step that decided it.

    Attributes
    ----------
    verdict : CandidateVerdict
        See there; never "supported" without a place among what is offered by name.
    confused_with : tuple of str
        Effects that the scan cannot tell from it.
    score : Score
        Linear score at the deciding step.
    statistic, p_value, explained_fraction : float
        Decrease of chi-square, its p-value, and its share of the unexplained chi-square: of the
        score, or of the refit for an effect that no score shows.
    """

    verdict: CandidateVerdict
    confused_with: tuple[str, ...]
    score: Score
    statistic: float
    p_value: float
    explained_fraction: float


@dataclass(frozen=True)
class Diagnosis:
    """Scores of all effects of a catalogue beside a model.

    Attributes
    ----------
    scores : best first; untestable ones last
    significant : names of the significant effects (Holm over the catalogue, 1 %)
    excess : unexplained chi-square, beyond the degrees of freedom
    settings : of the scores
    seed : of their simulated nulls
    """

    scores: tuple[Score, ...]
    significant: frozenset[str]
    excess: float
    settings: DiagnosisSettings = DIAGNOSIS
    seed: int = 0

    def __getitem__(self, name: str) -> Score:
        return next(score for score in self.scores if score.name == name)

    @cached_property
    def cosines(self) -> np.ndarray:
        """Cosines (e, e) between the patterns of the scores beyond the map, in their order."""
        return np.array([[cosine(a, b) for b in self.scores] for a in self.scores])

    def confused_with(self, name: str) -> tuple[str, ...]:
        """Names of the effects with a pattern alike (cosine above 0.9), nearest first."""
        names = [score.name for score in self.scores]
        row = self.cosines[names.index(name)]
        limit = self.settings.alike
        alike = [(c, n) for c, n in zip(row, names, strict=True) if n != name and c > limit]
        return tuple(n for _, n in sorted(alike, reverse=True))

    def verdict(self, name: str) -> CandidateVerdict:
        """Verdict on an effect from the scores alone."""
        score = self[name]
        if score.untestable is not None:
            return "untestable"
        if name not in self.significant:
            return "not_seen"
        family = score.family or name  # another form of the same cause leaves the cause decided
        others = {n for n in self.confused_with(name) if self[n].family != family}
        return "indistinguishable" if others & self.significant else "supported"

    def beside_untested(self, effects: Sequence[Effect], reason: str) -> Diagnosis:
        """Return the diagnosis beside effects that were not scored, for a reason in words."""
        readings = len(self.scores[0].beyond) if self.scores else 0
        untested = (unscored(effect, reason, readings) for effect in effects)
        return replace(self, scores=(*self.scores, *untested))

    def effect_verdict(self, name: str) -> EffectVerdict:
        """Return the verdict on an effect by its score alone, with its numbers."""
        score = self[name]
        return EffectVerdict(
            self.verdict(name),
            self.confused_with(name),
            score,
            score.statistic,
            score.p_value,
            self.explained_fraction(name),
        )

    def explained_fraction(self, name: str) -> float:
        """Share of the unexplained chi-square in an effect's score, 0 to 1."""
        if self.excess <= 0:
            return 0.0
        return float(np.clip(self[name].statistic / self.excess, 0.0, 1.0))


def diagnose(
    fit: FitResult,
    catalogue: Sequence[Effect],
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Score every effect of the catalogue beyond those of the fitted model.

    Parameters
    ----------
    seed : of the simulated nulls
    progress : called with the name of each effect before it is scored
    """
    fitted = fitted_basis(fit.at)
    scores, noise = [], NullNoise(seed)
    for effect in catalogue:
        if effect.name in fit.effect_names:
            continue
        if progress:
            progress(effect.name)
        scores.append(score_effect(fit, effect, fitted, noise, settings))
        if fit.field is not None and effect.link == "body":  # of its fine mesh, at this map alone
            fit.at.body.forget_other_models()
    scores.sort(key=lambda s: (s.untestable is not None, s.log_p, -s.statistic))
    significant = frozenset(holm_significant(scores, settings.alpha))
    return Diagnosis(tuple(scores), significant, max(fit.chi2 - fit.dof, 0.0), settings, seed)


def shortlist(
    diagnosis: Diagnosis, exclude: Sequence[str] = (), settings: SelectionSettings = SELECTION
) -> list[str]:
    """Return the best significant effects, and every significant one with a pattern alike.

    Other forms of the same cause, its family, count once.
    """
    candidates = [
        s for s in diagnosis.scores if s.name in diagnosis.significant and s.name not in exclude
    ]
    candidates.sort(key=lambda s: -s.statistic)
    least = settings.hopeless * candidates[0].statistic if candidates else 0.0
    best_of: dict[str, float] = {}
    for s in candidates:
        best_of.setdefault(s.family or s.name, s.statistic)
    names = [
        s.name
        for s in candidates
        if s.statistic >= max(least, settings.same_family * best_of[s.family or s.name])
    ]
    families = dict.fromkeys(diagnosis[name].family or name for name in names)
    first = list(families)[: settings.shortlist]
    best = [name for name in names if (diagnosis[name].family or name) in first]
    order = [score.name for score in diagnosis.scores]
    alike = [
        name
        for name in names
        if name not in best
        and any(
            diagnosis.cosines[order.index(name), order.index(b)] > diagnosis.settings.alike
            for b in best
        )
    ]
    return best + alike
