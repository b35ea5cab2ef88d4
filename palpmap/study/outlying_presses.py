"""Presses that stand out by themselves, and whether the verdict rests on them.

A slip or a wrong place looks like an effect. Where single presses stand out, the answer is put to
the test without them: its model is fitted anew, and each effect must earn its place again and do
better than its rivals. If any does not, the loop runs once more without these presses, and what is
only found with them is not offered by name.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.effects.base import Effect
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError
from identify.residual.comparison import Comparison
from identify.select.confirm import confirmed
from identify.select.forward_selection import Explanation, Policy, Verdict, forward_selection
from identify.select.settings import SELECTION
from models.errors import InputError
from palpmap.study.body_model import build_body_model
from palpmap.study.open_study import Problem, measurement_model, pose

Say = Callable[[str], None]

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


def climbed(problem: Problem, seed: int, say: Say, on_step: Callable | None = None) -> Explanation:
    """Run the loop from a posed problem."""
    return forward_selection(
        problem.model,
        problem.start,
        problem.scan,
        problem.catalogue,
        seed=seed,
        progress=say,
        on_step=on_step,
        policy=Policy(first=problem.first_step),
        settings=replace(SELECTION, most_effects=0) if problem.model.press_error else SELECTION,
    )


def without_suspects(
    problem: Problem, own: Sequence[Effect], seed: int, explained: Explanation, say: Say
) -> WithoutSuspects | None:
    """Return what is found without the presses that stand out.

    None where none do, or where too little is left without them to say.
    """
    presses = explained.ladder[0].comparison.bad_presses
    if not presses or explained.map_error:  # beside a wrong map, many stand out
        return None
    named = ", ".join(map(str, presses))

    def tell(text: str) -> None:
        say(f"without presses {named}: {text}")

    try:
        if explained.accepted:
            same = _same_answer(problem, explained, presses, tell)
            if same is not None:
                return same
        again = pose(problem.study, own, tell, leave_out=presses, measured=problem.measured)
        fresh = replace(again, catalogue=problem.catalogue)
        return WithoutSuspects.of(presses, climbed(fresh, seed, tell))
    except (InputError, InadmissibleError):
        return None


def _same_answer(
    problem: Problem, explained: Explanation, presses: tuple[int, ...], say: Say
) -> WithoutSuspects | None:
    """Return the answer as it is without these presses; None where it does not hold there."""
    others = ~np.isin(problem.scan.press, presses)
    same = others[problem.scan.in_contact]
    excess = explained.final.fit.at.residual**2 - 1
    if explained.verdict == "unexplained" and excess[same].sum() < _ELSEWHERE * excess.sum():
        return None
    scan = problem.scan.rows(others)
    say("meshing the body")
    body = build_body_model(problem.study, scan.used())
    model = measurement_model(scan, body, problem.fit)
    again = confirmed(explained, model, scan, same, say)
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
