"""The verdict on each effect of the catalogue after the whole selection."""

from dataclasses import replace

from identify.effects.base import Effect, advice
from identify.select.candidates import refit_p_value
from identify.select.diagnosis import CandidateVerdict, EffectVerdict
from identify.select.explanation import OTHER_CAUSE, SUSPECT_PRESSES, Explanation
from identify.select.step import Step


def effect_verdict(effect: Effect, explained: Explanation) -> EffectVerdict:
    """Return the verdict on an effect, at the step that decided it."""
    name = effect.name
    step, group = _decided_at(name, explained)
    found, helps = step.diagnosis.effect_verdict(name), explained.fitted_verdict == "unexplained"
    if group is not None:
        verdict, confused = _in_group(name, group, explained)
        found = replace(found, verdict=verdict, confused_with=confused)
    elif found.verdict == "supported" or (
        found.verdict == "indistinguishable"
        and (explained.within_laws or not (helps and explained.told_apart))
    ):
        # It scores beside a missing effect, but does not win: no support of its own
        found = replace(found, verdict="helps" if helps else "not_seen")
    if advice(effect).refitted_from and (numbers := refit_numbers(name, explained)):
        statistic, p_value, share = numbers
        found = replace(found, statistic=statistic, p_value=p_value, explained_fraction=share)
    return found


def refit_numbers(name: str, explained: Explanation) -> tuple[float, float, float] | None:
    """Return chi-square's decrease, its p-value and its share in the refit of an effect.

    None without a refit of the effect beside a step of the ladder.
    """
    refits = (
        r
        for a in explained.accepted
        for r in (*a.candidates, *a.first_candidates)
        if r.name == name
    )
    for candidate in refits:
        others = {part for part in candidate.fit.effect_names if part != name}
        before = next((r for r in explained.ladder if set(r.fit.effect_names) == others), None)
        if before is not None:
            fall, excess = max(before.fit.chi2 - candidate.chi2, 0.0), before.diagnosis.excess
            share = min(fall / excess, 1.0) if excess > 0 else 0.0
            return fall, refit_p_value(before, candidate), share
    return None


def _in_group(
    name: str, group: tuple[str, ...], explained: Explanation
) -> tuple[CandidateVerdict, tuple[str, ...]]:
    """Verdict on an effect of the model, or of a group in the model."""
    others = tuple(other for other in group if other != name)
    if name in explained.added:
        return "supported", others
    offered = explained.told_apart or group in explained.ambiguous
    if not offered or name in explained.parts_of_unknown:
        return "helps", ()
    if others:
        return "indistinguishable", others
    if name in explained.resting_on_outliers:
        return "indistinguishable", (SUSPECT_PRESSES,)
    if name in explained.doubted:
        noise = explained.fitted_verdict != "unexplained"
        return ("indistinguishable", (OTHER_CAUSE,)) if noise else ("not_seen", ())
    return "helps", ()


def _decided_at(name: str, explained: Explanation) -> tuple[Step, tuple[str, ...] | None]:
    """Return the deciding step of an effect, and its group if it was chosen there."""
    for accepted in explained.accepted:
        if name in accepted.group:
            return _step_before(explained, accepted.name, name), accepted.group
    last = explained.final
    return (
        last if _scored(last, name) else next(s for s in explained.ladder if _scored(s, name))
    ), None


def _step_before(explained: Explanation, added: str, name: str) -> Step:
    """Return the last step without an accepted effect that scored another one."""
    ladder = explained.ladder
    number = next(
        (i for i, step in enumerate(ladder) if added in step.fit.effect_names), len(ladder)
    )
    before = [step for step in ladder[:number] if _scored(step, name)]
    return before[-1] if before else next(step for step in ladder if _scored(step, name))


def _scored(step: Step, name: str) -> bool:
    return any(score.name == name for score in step.diagnosis.scores)
