"""The loop: find the missing effect, add it, refit, until what remains is noise.

The linear score only ranks; the refit decides. At each step the best-scored effects and all that
look like them are fitted jointly with the map; the winner must beat every rival by more than
`MARGIN` in chi-square (after the price of its parameters), else the rivals are an ambiguous group
and one of them stands in for the group. Where the residual is noise, nothing is added but what
chance does not give in a thousand scans; where it is structured, nothing that takes next to none
of what is unexplained: beside something large and unknown, everything is significant. An effect
that the map imitates all but wholly is never named alone: what is left of it is no more than a
slight error of the model. After each addition the earlier ones must still earn their place, and are
compared with their rivals again. The verdict follows from what remains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.effects.base import Effect
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.measurement.model import MeasurementModel
from identify.select.accepted_effect import AcceptedEffect, at_bound
from identify.select.candidates import REFIT_EVALUATIONS, Candidate, best_candidates, doubted
from identify.select.reconsider import reconsider, with_exchanged
from identify.select.step import Step, step_of
from models.scan import Scan

MOST_EFFECTS = 4
_TRACE = 0.02  # of the chi-square explained: left by laws that are right to a seventh
SUSPECT_PRESSES = "suspect_presses"  # beside an effect that single presses alone call for
_IMITATED = 0.05  # visible share of an effect's pattern below which the map imitates all of it
# Of the unexplained chi-square: in 58 blind trials whatever was hidden took a third or more of what
# was left, and what imitated an unknown effect 16 % or less from its second step on.
WORTHWHILE = 0.1
# Of the chi-square explained by what may be the model's own error: the pattern of that error is an
# estimate, right to a third, and what it lacks is in turn like some other effect.
_LEFT_OF_ERROR = 0.1
_BY_COMPLIANCE = 0.9  # of a pattern's square: beyond it, an effect acts on compliances alone
_MAIN_PART = 0.95  # of the unexplained chi-square: what explains more is offered by name

Verdict = Literal["nothing_missing", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Explanation:
    """What the loop found.

    Attributes
    ----------
    verdict : of the whole scan
    ladder : from the map alone to the last model
    additions : in the order in which they were made, those that kept their place
    dropped : effects that were added and later lost their place
    resting_on_suspects : effects that are not found without the presses that stand out
    """

    verdict: Verdict
    ladder: tuple[Step, ...]
    additions: tuple[AcceptedEffect, ...]
    dropped: tuple[str, ...]
    resting_on_suspects: tuple[str, ...] = ()

    @property
    def final(self) -> Step:
        """The last rung."""
        return self.ladder[-1]

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Groups of effects that explain the scan equally well, single bad presses among them."""
        groups = tuple(a.group for a in self.additions if len(a.group) > 1)
        return groups + tuple((name, SUSPECT_PRESSES) for name in self.resting_on_suspects)

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that are offered by name: alone in their group, and not mere helpers.

        Where the remainder is structured, an effect is only offered if the effects together took
        nearly all of what was unexplained, or the presses by themselves bear it out.
        """
        unsure = (*self.resting_on_suspects, *self.at_bound, *self.doubted)
        sure = tuple(a for a in self.additions if len(a.group) == 1 and a.name not in unsure)
        main = self.explained_share >= _MAIN_PART and not self.map_error
        if self.verdict == "unexplained" and not main:
            sure = tuple(a for a in sure if a.borne_out)
        return tuple(a.name for a in sure)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Effects of the last model that would be larger if that were possible: not found."""
        return tuple(name for name in self.final.fit.model.has if at_bound(self.final.fit, name))

    @property
    def doubted(self) -> tuple[str, ...]:
        """Effects of the last model whose values are not to be believed."""
        return tuple(name for name in self.final.fit.model.has if doubted(self.final.fit, name))

    @property
    def traces(self) -> tuple[str, ...]:
        """Effects that are significant in the last rung and yet no call for another addition."""
        return tuple(sorted(self.final.diagnosis.significant)) * (self.verdict != "unexplained")

    @property
    def map_error(self) -> float:
        """Relative error of the map's compliances that is counted beside the noise, or 0."""
        return self.final.fit.model.press_error

    @property
    def explained_share(self) -> float:
        """Share of the first rung's excess chi-square that the additions took away."""
        return _share(self.ladder[0].fit, self.final.fit)


FirstStep = Callable[[Step, Callable[[str], None]], tuple[FitResult, list[AcceptedEffect]] | None]


def forward_selection(
    model: MeasurementModel,
    stiffness: GaussianMap,
    scan: Scan,
    catalogue: Sequence[Effect],
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    on_step: Callable[[Step], None] | None = None,
    first: FirstStep | None = None,
    most: int = MOST_EFFECTS,
) -> Explanation:
    """Run the loop from a map on.

    Parameters
    ----------
    model : with the effects that the study already has
    stiffness : map to start from
    scan : placed, with the readings of the model
    catalogue : effects that may be added
    seed : of the simulated nulls
    progress : called with what is being done, in words
    on_rung : called with each new rung
    first : makes the first step from the map alone, or returns None (`identify.select.first_step`)
    most : effects to be added, those of the first step not counted
    """
    say = progress or (lambda text: None)
    rise = on_step or (lambda rung: None)
    effects = {effect.name: effect for effect in catalogue}

    def judged(fit: FitResult) -> Step:
        rung = step_of(fit, scan, catalogue, seed, say)
        rise(rung)
        return rung

    say("fitting the map")
    ladder = [judged(fit_jointly(model, stiffness))]
    additions: list[AcceptedEffect] = []
    dropped: list[str] = []
    settled = False
    step = first(ladder[0], say) if first else None
    if step is not None:
        fit, additions = step
        ladder.append(judged(fit))
    most += len(additions)
    while (len(ladder) == 1 or is_more_missing(ladder, additions)) and len(additions) < most:
        now = ladder[-1]
        candidates = best_candidates(now, effects, say, dropped)
        if not candidates:
            settled = now.comparison.is_noise
            break
        winner = candidates[0]
        if not now.comparison.is_noise and not _worthwhile(now.fit, winner.fit):
            break
        left = (MODEL_ERROR,) * _may_be_left_of_error(ladder, additions, winner)
        beside = {rival.name: _beside(now, rival.name) or left for rival in candidates}
        additions.append(AcceptedEffect(winner.name, candidates, False, beside, now.fit.chi2))
        say(f"refitting with {winner.name}")
        fit = fit_jointly(winner.fit.model, winner.fit.map)
        fit, lost = without_unneeded(fit, [a.name for a in additions[:-1]], say)
        kept = [a for a in additions if a.name not in lost]
        # Beside what has lost its place, the last one may have beaten rivals that do as well now
        fit, additions, exchanged = reconsider(fit, kept, say, the_last_too=bool(lost))
        dropped.extend([*lost, *exchanged])
        for number, rung in enumerate(ladder):
            if exchanged.keys() & set(rung.fit.model.has):  # the steps lead to the last model
                ladder[number] = judged(with_exchanged(rung.fit, exchanged, fit))
        ladder.append(judged(fit))
    verdict = "unexplained" if model.press_error else _verdict(ladder, additions, settled)
    gone = tuple(name for name in dict.fromkeys(dropped) if name not in ladder[-1].fit.model.has)
    return Explanation(verdict, tuple(ladder), tuple(additions), gone)


def _share(before: FitResult, after: FitResult) -> float:
    """Share of the excess chi-square of a fit that another one takes away."""
    excess = before.chi2 - before.dof
    return float(1 - max(after.chi2 - after.dof, 0.0) / excess) if excess > 0 else 0.0


def _worthwhile(before: FitResult, after: FitResult) -> bool:
    """Whether a fit takes its share of the excess; any does where the structure is below it."""
    return before.chi2 - after.chi2 >= WORTHWHILE * (before.chi2 - before.dof)


def _beside(rung: Step, name: str) -> tuple[str, ...]:
    """Name what cannot be told from an effect because the map imitates one of them all but wholly.

    What is left of such an effect is so little that it must be large to explain anything, with the
    map far off on the other side; then a slight error of the model, or another form of the map,
    passes for it. If the model's own error is what fits best, it may be any of these effects. Nor
    is an effect told from that error whose pattern is like its own, which is only an estimate.
    """
    scores = [score for score in rung.diagnosis.scores if score.untestable is None]
    imitated = [score.name for score in scores if score.visible < _IMITATED]
    if name == MODEL_ERROR:
        return tuple(imitated)
    alike = MODEL_ERROR in rung.diagnosis.confused_with(name)
    return (MODEL_ERROR,) * (name in imitated or alike)


def _may_be_left_of_error(
    ladder: Sequence[Step], additions: Sequence[AcceptedEffect], winner: Candidate
) -> bool:
    """Whether an effect may be what the model's own error, if it was that before, leaves over."""
    now = ladder[-1]
    if not any(MODEL_ERROR in addition.group for addition in additions):
        return False
    explained, more = ladder[0].fit.chi2 - now.fit.chi2, now.fit.chi2 - winner.chi2
    return more < _LEFT_OF_ERROR * explained and _acts_by_compliance(now, winner.name)


def _acts_by_compliance(rung: Step, name: str) -> bool:
    """Whether each press's readings move as by another compliance of the body under it."""
    at, press = rung.fit.at, rung.fit.model.readings.press
    by_own = at.whitened(at.by_compliance, press)
    pattern = rung.diagnosis[name].beyond
    along = np.array([np.bincount(press, by_own * column) for column in pattern.T])
    square = np.bincount(press, by_own**2)
    return bool(np.sum(along**2 / square) >= _BY_COMPLIANCE * np.sum(pattern**2))


def without_unneeded(
    fit: FitResult, names: Sequence[str], say: Callable[[str], None]
) -> tuple[FitResult, list[str]]:
    """Leave out those of a fit's effects that do not earn their place; the fit, and their names."""
    lost: list[str] = []
    for name in names:
        say(f"testing whether {name} is still needed")
        without = try_fit(
            fit.model.without(name), fit.map, rounds=0, max_evaluations=REFIT_EVALUATIONS
        )
        if without is not None and without.bic < fit.bic:
            fit = without
            lost.append(name)
    return (fit_jointly(fit.model, fit.map) if lost else fit), lost


def is_more_missing(ladder: Sequence[Step], additions: Sequence[AcceptedEffect]) -> bool:
    """Say whether the last rung's significant effects call for another addition.

    Not where the residual is noise but for a trace that is within what the law of an effect may be
    off by, or that may be the difference between the members of an ambiguous group.
    """
    now = ladder[-1]
    strongest = max(
        (now.diagnosis[name].statistic for name in now.diagnosis.significant), default=0
    )
    if strongest == 0 or not additions or not now.comparison.is_noise:
        return strongest > 0
    explained = ladder[0].fit.chi2 - now.fit.chi2
    return len(additions[-1].equals) == 1 and strongest > _TRACE * explained


def _verdict(ladder: Sequence[Step], additions: Sequence[AcceptedEffect], settled: bool) -> Verdict:
    """Judge the last rung; `settled` says that no effect does clearly better than its noise."""
    last = ladder[-1]
    if not last.comparison.is_noise or (is_more_missing(ladder, additions) and not settled):
        return "unexplained"
    if not additions:
        return "nothing_missing"
    if any(at_bound(last.fit, a.name) or doubted(last.fit, a.name) for a in additions):
        return "unexplained"
    return "ambiguous" if any(len(a.group) > 1 for a in additions) else "explained"
