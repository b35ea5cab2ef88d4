"""The result of the selection: its steps, its accepted effects, and the verdict that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np

from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.fit.result import FitResult
from identify.select.accepted_effect import AcceptedEffect, at_bound, undetermined
from identify.select.candidates import is_implausible
from identify.select.model_error import (
    beside_edge,
    few_presses,
    of_field,
    residues,
    within_laws,
)
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step

SUSPECT_PRESSES = "suspect_presses"  # equivalent of an effect that rests on single presses
OTHER_CAUSE = "another_cause"  # equivalent of an effect whose values are doubted

Verdict = Literal["nothing_missing", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class PressesApart:
    """Presses that stand apart from a map that meets all others.

    Attributes
    ----------
    presses : their ids
    softer : share by which each travels further at the same force than the map has it
    readings : theirs
    others : verdict of the scan without them
    """

    presses: tuple[int, ...]
    softer: tuple[float, ...]
    readings: Readings
    others: Verdict


@dataclass(frozen=True)
class Explanation:
    """Result of the selection.

    Attributes
    ----------
    verdict : of the whole scan
    ladder : steps from the map alone to the last model
    accepted : effects of the last model, in the order of their steps
    dropped : effects that were added and later lost their place
    resting_on_outliers : effects that are not found without the outlying presses
    further : best-scored effect where the residual is noise and yet one more is missing, or nothing
    apart : presses that are left out of all steps, as the last model meets all others
    settings : of the selection
    """

    verdict: Verdict
    ladder: tuple[Step, ...]
    accepted: tuple[AcceptedEffect, ...]
    dropped: tuple[str, ...]
    resting_on_outliers: tuple[str, ...] = ()
    further: str = ""
    apart: PressesApart | None = None
    settings: SelectionSettings = SELECTION

    @property
    def final(self) -> Step:
        """The last step."""
        return self.ladder[-1]

    @property
    def others(self) -> Self:
        """Explanation of the presses that do not stand apart, which the steps are fitted to."""
        return self if self.apart is None else replace(self, verdict=self.apart.others, apart=None)

    @property
    def fitted_verdict(self) -> Verdict:
        """Verdict of the presses that the steps are fitted to: all, or those not apart."""
        return self.verdict if self.apart is None else self.apart.others

    def effect(self, name: str) -> Effect:
        """Return an effect of the ladder by its name."""
        parts = (part for step in self.ladder for part in step.fit.model.effects)
        return next(part.effect for part in parts if part.effect.name == name)

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Groups of effects that explain the scan equally well.

        Single bad presses are among them, and the unknown cause in place of an effect whose values
        are doubted. Beside a structured residual, which may be the cause of each, those alone that
        the contact law of the presses calls for, if it leaves noise in the middle one.
        """
        if not self.told_apart:
            return tuple(a.group for a in self.accepted if a.meets_presses and not a.decided)
        hidden = self.parts_of_unknown
        groups = tuple(
            a.group for a in self.accepted if not (a.decided or a.is_unknown or a.name in hidden)
        )
        resting = (name for name in self.resting_on_outliers if name not in hidden)
        groups += tuple((name, SUSPECT_PRESSES) for name in resting)
        if self.fitted_verdict == "unexplained":
            return groups
        decided = {a.name for a in self.accepted if a.decided}
        doubted = dict.fromkeys((*self.doubted, self.further))
        return groups + tuple(
            (name, OTHER_CAUSE) for name in doubted if name in (*decided, self.further) and name
        )

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that are offered by name: of one cause in their group, and plausible.

        Beside a structured residual, which may be its cause, an effect is offered only if the
        contact law of the presses calls for it and leaves noise in the middle one.
        """
        unsure = (*self.resting_on_outliers, *self.doubted, *self.parts_of_unknown)
        return tuple(
            a.name for a in self.accepted
            if a.decided and not a.is_unknown and a.name not in unsure
            and (self.told_apart or a.meets_presses)
        )  # fmt: skip

    @property
    def unknown(self) -> tuple[str, ...]:
        """Courses of the last model that stand in for causes outside the catalogue."""
        return tuple(a.name for a in self.accepted if a.is_unknown)

    @property
    def parts_of_unknown(self) -> tuple[str, ...]:
        """Effects beside the course of an unknown cause that may be parts of it.

        Those of any shape: a tip that stuck was a saturation or a loop of free shape in two of
        twenty trials. Beside several courses each that the presses' contact law does not call for.
        """
        courses = len(self.unknown)
        parts = (a for a in self.accepted if courses and not a.is_unknown)
        return tuple(
            a.name for a in parts
            if self.effect(a.name).any_shape or (courses > 1 and not a.meets_presses)
        )  # fmt: skip

    @property
    def told_apart(self) -> bool:
        """Whether no structure remains that may be the cause of the effects of the last model."""
        return self.fitted_verdict != "unexplained" or self.final.comparison.is_noise

    @property
    def doubted(self) -> tuple[str, ...]:
        """Effects whose values, or the structure left beside them, make the cause doubtful."""
        left = tuple(effect.name for effect in self.accepted) if self.within_laws else ()
        values = (*self.at_bound, *self.undetermined, *self.implausible)
        small = (*self.mended, *self.residues, *self.beside_edge)
        return tuple(dict.fromkeys((*values, *left, *small)))

    @property
    def mended(self) -> tuple[str, ...]:
        """Effects of the last model that may imitate one unknown cause."""
        return mended(self.ladder, self.accepted, self.settings)

    @property
    def residues(self) -> tuple[str, ...]:
        """Effects of the body that may only make up for the inexact form of another one."""
        return residues(self.ladder, self.accepted, self.settings)

    @property
    def beside_edge(self) -> tuple[str, ...]:
        """Effects of the body beside an inclusion of the map at a side of the body."""
        return beside_edge(self.final.fit, self.accepted)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Effects of the last model at a bound of the search: not found."""
        return tuple(name for name in self.final.fit.effect_names if at_bound(self.final.fit, name))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Accepted effects of the last model whose size the scan does not determine."""
        return undetermined(self.final.fit, [a.name for a in self.accepted], self.settings)

    @property
    def implausible(self) -> tuple[str, ...]:
        """Effects of the last model with implausible values."""
        return tuple(
            name for name in self.final.fit.effect_names if is_implausible(self.final.fit, name)
        )

    @property
    def traces(self) -> tuple[str, ...]:
        """Significant effects of the last step, of no group, that call for no further step."""
        offered = {name for effect in self.accepted for name in effect.group}
        found = sorted(self.final.diagnosis.significant.difference(offered))
        return tuple(found) if self.fitted_verdict != "unexplained" else ()

    @property
    def map_error(self) -> float:
        """Relative error of the map's compliances, counted beside the noise, or 0."""
        return self.final.fit.model.press_error

    @property
    def within_laws(self) -> bool:
        """Whether the residual is beyond noise by less than laws of contact are right to."""
        noise = self.final.comparison.is_noise
        first, last = self.ladder[0].fit, self.final.fit
        return not noise and within_laws(first, last, self.accepted, self.settings)

    @cached_property
    def in_few_presses(self) -> tuple[int, ...]:
        """Indices of the presses that hold most of an excess beside a free map, if few do."""
        few = few_presses(self.final.fit, self.accepted, self.settings)
        return tuple(np.flatnonzero(few).tolist())

    @property
    def explained_share(self) -> float:
        """Share of the first step's excess chi-square that the accepted effects remove."""
        first, last = self.ladder[0].fit, self.final.fit
        excess = first.chi2 - first.dof
        return float(1 - max(last.chi2 - last.dof, 0.0) / excess) if excess > 0 else 0.0


def verdict_of(
    last: Step,
    accepted: Sequence[AcceptedEffect],
    further: str = "",
    within: bool = False,
    mended: Sequence[str] = (),
) -> Verdict:
    """Verdict of the last step.

    Parameters
    ----------
    further : effect that is missing beside noise
    mended : effects that may imitate one unknown cause, or make up for an inexact law
    within : structure is left, but less than laws of contact are right to (`within_laws`): the
        law that would leave none may be another
    """
    noise = last.comparison.is_noise
    if not (noise or within) or any(a.is_unknown for a in accepted):
        return "unexplained"
    if not accepted and not further:
        return "nothing_missing"
    names = [a.name for a in accepted]
    values = any(at_bound(last.fit, name) or is_implausible(last.fit, name) for name in names)
    doubted = not noise or values or bool(mended or undetermined(last.fit, names))
    sure = all(a.decided for a in accepted) and not doubted and not further
    return "explained" if sure else "ambiguous"


def mended(
    ladder: Sequence[Step], accepted: Sequence[AcceptedEffect], settings: SelectionSettings
) -> tuple[str, ...]:
    """Effects that may imitate one unknown cause: the last of three or more only mends their fit.

    A body elsewhere, wider at two sides, was explained by a shift (53 % of what all took), a
    softening (44 %) and fibres (3 %, and a fifth of what the others left: a true one would take
    nearly all of that). One that alone takes nearly all is no imitation.
    """
    chi2 = [step.fit.chi2 for step in ladder]
    if len(ladder) < settings.mending or ladder[-1].fit.field is not None:
        return ()
    explained, gain = chi2[0] - chi2[-1], chi2[-2] - chi2[-1]
    excess = chi2[-2] - ladder[-2].fit.dof
    if gain > min(settings.of_mend * explained, settings.of_left * excess):
        return ()
    if ladder[-2].comparison.is_noise:
        return ()
    leads = chi2[0] - chi2[1] > settings.alone * explained
    known = ladder[1].fit.effect_names if leads else ladder[0].fit.effect_names
    return tuple(a.name for a in accepted if not (a.shown_by_presses or a.name in known))


def ended_by_presses(
    first: FitResult,
    fit: FitResult,
    accepted: Sequence[AcceptedEffect],
    settings: SelectionSettings,
    noise: bool = False,
) -> str:
    """Reason why nothing is sought beside the law that the presses' curves called for, or nothing.

    What is sought for presses that have a law of their own would be laid on all others; what is
    sought in the error of laws would be another law.

    Parameters
    ----------
    first : fit of the first step
    noise : the residual is noise
    """
    if any(effect.partial for effect in accepted):
        return "the presses' own curves, with whatever stiffness, leave structure in many of them"
    if few_presses(fit, accepted, settings).any():
        return "few presses hold the structure that is left, and would decide"
    if not noise and within_laws(first, fit, accepted, settings):
        return "the structure that is left is less than laws of contact are right to"
    return ""


def is_more_missing(
    ladder: Sequence[Step],
    accepted: Sequence[AcceptedEffect],
    settings: SelectionSettings = SELECTION,
) -> bool:
    """Whether the significant effects of the last step call for a further step.

    If the residual is noise, a trace does not: it may be the inaccuracy of an effect's law, or the
    difference between the members of an ambiguous group. Nor does what another form of an accepted
    effect takes as well.
    """
    now = ladder[-1]
    strongest = max((now.diagnosis[name].statistic for name in _missing(now, settings)), default=0)
    enough = now.comparison.is_noise or within_laws(ladder[0].fit, now.fit, accepted, settings)
    if strongest == 0 or not accepted or not enough:
        return strongest > 0
    if now.comparison.is_noise and _other_form(now, accepted) > strongest - settings.margin:
        return False
    explained = ladder[0].fit.chi2 - now.fit.chi2
    return len(accepted[-1].equivalents) == 1 and strongest > settings.trace * explained


def _missing(now: Step, settings: SelectionSettings) -> set[str]:
    """Return the significant effects of a step that are no inaccuracy of a free map."""
    return set(now.diagnosis.significant) - set(of_field(now, settings))


def _other_form(now: Step, accepted: Sequence[AcceptedEffect]) -> float:
    """Return the best significant score of other forms of the accepted effects, or 0."""
    families = {c.family for a in accepted for c in a.candidates if c.name == a.name}
    scores = (now.diagnosis[name] for name in now.diagnosis.significant)
    return max((s.statistic for s in scores if (s.family or s.name) in families), default=0.0)


def further_missing(
    ladder: Sequence[Step], accepted: Sequence[AcceptedEffect], settings: SelectionSettings
) -> str:
    """Return the best-scored effect that is missing though the residual is noise, or nothing."""
    last = ladder[-1]
    if not last.comparison.is_noise or not is_more_missing(ladder, accepted, settings):
        return ""
    return max(_missing(last, settings), key=lambda name: last.diagnosis[name].statistic)
