"""Presses that stand out by themselves, and whether the verdict rests on them.

A slip or a wrong place looks like an effect. Where single presses stand out, the loop runs once
more without them, and what is only found with them is not offered by name.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from identify.effects.effect import Effect
from identify.explain import MOST_EFFECTS, Explanation, climb
from palpmap.problem import Problem, pose
from palpmap.study import Study

Say = Callable[[str], None]


@dataclass(frozen=True)
class WithoutSuspects:
    """What the loop finds without the presses (ids) that stand out."""

    presses: tuple[int, ...]
    explained: Explanation


def climbed(problem: Problem, seed: int, say: Say, on_rung: Callable | None = None) -> Explanation:
    """Run the loop from a posed problem."""
    return climb(
        problem.model,
        problem.start,
        problem.scan,
        problem.catalogue,
        seed=seed,
        progress=say,
        on_rung=on_rung,
        first=problem.first_step,
        most=0 if problem.model.press_error else MOST_EFFECTS,
    )


def without_suspects(
    study: Study, own: Sequence[Effect], seed: int, explained: Explanation, say: Say
) -> WithoutSuspects | None:
    """Run the loop without the presses that stand out; None where none do."""
    presses = explained.ladder[0].comparison.bad_presses
    if not presses or explained.map_error:  # beside a wrong map, many stand out
        return None
    named = ", ".join(map(str, presses))
    problem = pose(
        study, own, lambda text: say(f"without presses {named}: {text}"), leave_out=presses
    )
    again = climbed(problem, seed, lambda text: say(f"without presses {named}: {text}"))
    return WithoutSuspects(presses, again)


def suspects_left(explained: Explanation, without: WithoutSuspects | None) -> tuple[int, ...]:
    """Return the suspect presses (ids) that the answer does not account for.

    Many presses beside an edge stand out of a map alone where the body lies elsewhere. Once the
    effect is in the model they do no more, and without them it is found as well.
    """
    if without is None:
        return ()
    other = without.explained
    same = (other.verdict, other.added) == (explained.verdict, explained.added)
    if not same or explained.resting_on_suspects:
        return without.presses
    still = explained.final.comparison.bad_presses
    return tuple(press for press in without.presses if press in still)


def weighed(explained: Explanation, without: WithoutSuspects | None) -> Explanation:
    """Return the explanation with all that rests on the suspect presses marked as such."""
    if without is None:
        return explained
    found = {name for addition in without.explained.additions for name in addition.group}
    resting = tuple(name for name in explained.added if name not in found)
    if not resting:
        return explained
    verdict = "ambiguous" if explained.verdict == "explained" else explained.verdict
    return replace(explained, verdict=verdict, resting_on_suspects=resting)
