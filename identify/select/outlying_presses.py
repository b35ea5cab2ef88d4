"""Presses that stand out by themselves, and whether the verdict rests on them.

A slip or a wrong place looks like an effect. Where single presses stand out, the answer is tested
without them: its model is fitted anew, and each effect must earn its place again and do better than
the other candidates. If any does not, the selection runs once more without these presses, and an
effect found only with them is not offered by name.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identify.experiment import Progress
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError
from identify.residual.comparison import Comparison
from identify.select.confirm import confirmed
from identify.select.first_step import follow
from identify.select.forward_selection import Explanation, Policy, Verdict, forward_selection
from identify.select.settings import SELECTION
from identify.select.start_fit import StartFit, measurement_model, start_fit
from identify.select.step import Step
from models.errors import InputError

# Of what is unexplained: where less of it lies outside the presses that stand out, they may have
# hidden what explains the others
_ELSEWHERE = 0.5


@dataclass(frozen=True)
class WithoutSuspects:
    """What is found without the presses (ids) that stand out.

    `found` are the names of the additions that are told from their rivals; the others are as in
    `Explanation`.
    """

    presses: tuple[int, ...]
    verdict: Verdict
    added: tuple[str, ...]
    ambiguous: tuple[tuple[str, ...], ...]
    found: frozenset[str]
    fit: FitResult
    comparison: Comparison

    @classmethod
    def of(cls, presses: tuple[int, ...], again: Explanation) -> "WithoutSuspects":
        """Return what the loop has found without the presses."""
        final = again.final
        found = frozenset(a.name for a in again.accepted if len(a.group) == 1)
        return cls(
            presses,
            again.verdict,
            again.added,
            again.ambiguous,
            found,
            final.fit,
            final.comparison,
        )


def explain(
    start: StartFit, seed: int = 0, on_step: Callable[[Step], None] | None = None
) -> tuple[Explanation, WithoutSuspects | None]:
    """Find the missing effects, with all presses and without those that stand out.

    Returns
    -------
    the explanation, its verdict changed where it rests on these presses, and the other one
    """
    explained = _selected(start, seed, on_step)
    without = without_suspects(start, seed, explained)
    return weighed(explained, without), without


def _selected(
    start: StartFit, seed: int, on_step: Callable[[Step], None] | None = None
) -> Explanation:
    law = start.law

    def first(step: Step, say: Progress):
        assert law is not None
        return follow(law, step, start.start, say)

    return forward_selection(
        start.model,
        start.start,
        start.scan,
        start.catalogue,
        seed=seed,
        progress=start.experiment.say,
        on_step=on_step,
        policy=Policy(first=first if law is not None and law.names else None),
        settings=replace(SELECTION, most_effects=0) if start.model.press_error else SELECTION,
    )


def without_suspects(start: StartFit, seed: int, explained: Explanation) -> WithoutSuspects | None:
    """Return what is found without the presses that stand out.

    None where none do, or where too few presses remain.
    """
    presses = explained.ladder[0].comparison.bad_presses
    if not presses or explained.map_error:  # beside a wrong map, many stand out
        return None
    named, say = ", ".join(map(str, presses)), start.experiment.say

    def tell(text: str) -> None:
        say(f"without presses {named}: {text}")

    experiment = replace(start.experiment, say=tell)
    try:
        if explained.accepted:
            same = _same_answer(replace(start, experiment=experiment), explained, presses)
            if same is not None:
                return same
        fewer = experiment.without(presses)
        if not fewer.is_determined:
            return None
        again = start_fit(fewer, start.catalogue)
        return WithoutSuspects.of(presses, _selected(again, seed))
    except (InputError, InadmissibleError):
        return None


def _same_answer(
    start: StartFit, explained: Explanation, presses: tuple[int, ...]
) -> WithoutSuspects | None:
    """Return the answer as it is without these presses; None where it does not hold there."""
    others = ~np.isin(start.scan.press, presses)
    same = others[start.scan.in_contact]
    excess = explained.final.fit.at.residual**2 - 1
    if explained.verdict == "unexplained" and excess[same].sum() < _ELSEWHERE * excess.sum():
        return None
    fewer = start.experiment.without(presses, refill=False)
    model = measurement_model(fewer.scan, fewer.body, start.fit)
    again = confirmed(explained, model, fewer.scan, same, fewer.say)
    if again is None:
        return None
    fit, comparison = again
    return replace(WithoutSuspects.of(presses, explained), fit=fit, comparison=comparison)


def suspects_left(explained: Explanation, without: WithoutSuspects | None) -> tuple[int, ...]:
    """Return the suspect presses (ids) that the answer does not account for.

    Many presses beside an edge stand out of a map alone where the body lies elsewhere. Once the
    effect is in the model they do no more, and without them it is found as well.
    """
    still = explained.final.comparison.bad_presses
    if without is None:
        return tuple(p for p in explained.ladder[0].comparison.bad_presses if p in still)
    same = (without.verdict, without.added) == (explained.verdict, explained.added)
    if not same or explained.resting_on_outliers:
        return without.presses
    return tuple(press for press in without.presses if press in still)


def weighed(explained: Explanation, without: WithoutSuspects | None) -> Explanation:
    """Return the explanation with all that rests on the suspect presses marked as such."""
    if without is None:
        return explained
    resting = tuple(name for name in explained.added if name not in without.found)
    if not resting:
        return explained
    verdict = "ambiguous" if explained.verdict == "explained" else explained.verdict
    return replace(explained, verdict=verdict, resting_on_outliers=resting)
