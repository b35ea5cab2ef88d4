"""result.json: what the loop found, as plain data."""

from dataclasses import asdict
from typing import Any

from identify.design.geometry_confounders import geometry_confounders
from identify.design.redundant_inclusions import unseen_inclusions
from identify.effects.base import Effect
from identify.fit.joint_intervals import joint_intervals
from identify.select.candidates import refit_chance
from identify.select.diagnosis import CandidateVerdict, Diagnosis
from identify.select.forward_selection import SUSPECT_PRESSES, Explanation
from identify.select.score_test import Score
from identify.select.step import Step
from palpmap.result.next_scan import finer_cells
from palpmap.result.presses_words import counted, presses_record
from palpmap.study.map_fit import AXES
from palpmap.study.open_study import Problem, named
from palpmap.study.outlying_presses import WithoutSuspects, suspects_left

SCHEMA = 1


def explain_record(
    explained: Explanation, problem: Problem, without: WithoutSuspects | None = None
) -> dict[str, Any]:
    """Return verdict, additions, ladder, candidates and parameters of an explanation.

    Positions are in the scan's frame, as in the study file.
    """
    return {
        "schema": SCHEMA,
        "verdict": explained.verdict,
        "added": list(explained.added),
        "ambiguous": [list(group) for group in explained.ambiguous],
        "traces": list(explained.traces),
        "helpers": [a.name for a in explained.additions if a.name not in explained.added],
        "ladder": [step_record(rung) for rung in explained.ladder],
        "candidates": [
            candidate_record(effect, explained, problem)
            for effect in problem.catalogue
            if effect.name not in problem.model.has
        ],
        "parameters": parameters_of(explained.final, problem, bent=True),
        "residual": explained.final.comparison.statement,
        "suspect_presses": list(explained.ladder[0].comparison.bad_presses),
        "suspects_left": list(suspects_left(explained, without)),
        "without_suspects": None if without is None else without_record(without),
        "explained_share": explained.explained_share,
        **counted(problem),
        "presses_alone": presses_record(problem),
        "unseen_inclusions": _unseen(explained),
        "stated_lengths": _stated_lengths(explained),
        "finer_cells": finer_cells(explained, problem.study.body),
    }


def _unseen(explained: Explanation) -> list[int]:
    """Numbers of the inclusions that are not seen; what is unexplained may hide any."""
    return [] if explained.verdict == "unexplained" else [*unseen_inclusions(explained.final.fit)]


def _stated_lengths(explained: Explanation) -> list[dict[str, Any]]:
    """Return the lengths of the study that would explain as much, were they wrong."""
    offered = {*explained.added, *(name for group in explained.ambiguous for name in group)}
    return [asdict(found) for found in geometry_confounders(explained) if found.effect in offered]


def without_record(without: WithoutSuspects) -> dict[str, Any]:
    """Return what is found without the presses that stand out."""
    return {
        "verdict": without.verdict,
        "added": list(without.added),
        "ambiguous": [list(group) for group in without.ambiguous],
        "chi2_per_dof": without.fit.chi2_per_dof,
        "parameters": without.fit.values,
        "residual": without.comparison.statement,
    }


def step_record(rung: Step) -> dict[str, Any]:
    """Return one step of the ladder."""
    return {
        "effects": list(rung.fit.model.has),
        "rms_m": rung.fit.rms_m,
        "held_out_rms_m": rung.held_out.rms_m,
        "held_out_high_rms_m": rung.held_out.high_rms_m,
        "noise_rms_m": rung.comparison.expected_rms_m,
        "chi2_per_dof": rung.fit.chi2_per_dof,
        "is_noise": rung.comparison.is_noise,
        "statement": rung.comparison.statement,
        "parameters": {
            name: {"value": value, "std": rung.fit.std.get(name, 0.0)}
            for name, value in rung.fit.values.items()
        },
    }


def candidate_record(effect: Effect, explained: Explanation, problem: Problem) -> dict[str, Any]:
    """Return what the scan says of one effect, at the step at which that was decided."""
    name = effect.name
    rung, group = _decided_at(name, explained)
    score = rung.diagnosis[name]
    verdict = rung.diagnosis.verdict(name)
    confused = [other for other in rung.diagnosis.confused_with(name)]
    if group is not None:
        verdict, confused = _in_group(name, group, explained)
    elif verdict == "supported":
        # It scores while something else is missing, but does not win: no support of its own
        verdict = "not_seen" if explained.verdict != "unexplained" else "supported"
    elif verdict == "untestable":
        verdict = "not_seen"  # the record says why under its own key
    record = score_record(score, rung.diagnosis)
    if effect.refitted_from:
        record |= refit_record(name, explained)
    return {
        **record,
        "verdict": verdict,
        "confused_with": confused,
        "evidence": evidence(effect, score, problem, explained.final),
    }


def _in_group(
    name: str, group: tuple[str, ...], explained: Explanation
) -> tuple[CandidateVerdict, list[str]]:
    """Verdict on an effect that was added or is as good as one that was, and what it looks like."""
    others = [other for other in group if other != name]
    if others or name in explained.added:
        return ("indistinguishable" if others else "supported"), others
    if name in explained.resting_on_suspects:
        return "indistinguishable", [SUSPECT_PRESSES]
    if name in (*explained.at_bound, *explained.doubted):
        return "not_seen", []
    return "supported", []  # a help; what is offered by name stands under `added`


def score_record(score: Score, diagnosis: Diagnosis) -> dict[str, Any]:
    """Return an effect's score alone."""
    return {
        "name": score.name,
        "verdict": diagnosis.verdict(score.name),
        "score": score.statistic,
        "p_value": score.p_value,
        "explained_fraction": diagnosis.explained_fraction(score.name),
        "confused_with": list(diagnosis.confused_with(score.name)),
        "rms_m": score.rms_m,
        "visible": score.visible,
        "values": {name: float(value) for name, value in score.values.items()},
        "untestable": score.untestable,
    }


def refit_record(name: str, explained: Explanation) -> dict[str, float]:
    """Return what the refit says of an effect that shows in none of its scores, or nothing."""
    refits = (r for a in explained.additions for r in (*a.candidates, *a.tried) if r.name == name)
    for rival in refits:
        others = {part for part in rival.fit.model.has if part != name}
        before = next((r for r in explained.ladder if set(r.fit.model.has) == others), None)
        if before is not None:
            fall, excess = max(before.fit.chi2 - rival.chi2, 0.0), before.diagnosis.excess
            return {
                "score": fall,
                "p_value": refit_chance(before, rival),
                "explained_fraction": min(fall / excess, 1.0) if excess > 0 else 0.0,
            }
    return {}


def evidence(effect: Effect, score: Score, problem: Problem, final: Step | None = None) -> str:
    """Return one sentence that a reader understands.

    With the values of the final model where that has the effect, else the linear estimate.
    """
    if final is not None and effect.name in final.fit.at.values:
        return effect.evidence(final.fit.at.values[effect.name], problem.model.readings)
    if score.untestable is not None:
        return f"Cannot be tested: {score.untestable}."
    return effect.evidence(score.values, problem.model.readings)


def parameters_of(rung: Step, problem: Problem, bent: bool = False) -> dict[str, dict[str, Any]]:
    """Return values, standard errors and 95 % intervals, positions in the scan's frame.

    `bent` intervals follow the valley of the misfit, see `joint_intervals`.
    """
    fit = rung.fit
    intervals = joint_intervals(fit, bent)
    held = fit.at_bound
    found = {}
    for name, value in fit.values.items():
        axis = AXES.get(name.split(".")[-1])
        shift = 0.0 if axis is None else float(problem.placement.origin_m[axis])
        low, high = intervals.get(name, (value, value))
        found[name] = {
            "value": value + shift,
            "std": fit.std.get(name, 0.0),
            "lower95": low + shift,
            "upper95": high + shift,
            "unit": unit_of(name, fit.model),
            "at_bound": name in held,
        }
    return found


def unit_of(name: str, model: Any) -> str:
    """Return the unit of a parameter of map or effects."""
    effect, _, own = name.rpartition(".")
    for part in model.effects:
        if part.effect.name == effect:
            return next(p.unit for p in part.parameters if p.name == own)
    return "Pa" if name.endswith("_pa") else "m"


def _decided_at(name: str, explained: Explanation) -> tuple[Step, tuple[str, ...] | None]:
    """Return the rung at which an effect was judged, and its group if it was chosen there."""
    for addition in explained.additions:
        if name in addition.group:
            return _rung_before(explained, addition.name, name), addition.group
    last = explained.final
    if any(score.name == name for score in last.diagnosis.scores):
        return last, None
    return next(r for r in explained.ladder if _scored(r, name)), None


def _rung_before(explained: Explanation, added: str, name: str) -> Step:
    """Return the last rung without an addition that scored an effect."""
    ladder = explained.ladder
    number = next((i for i, rung in enumerate(ladder) if added in rung.fit.model.has), len(ladder))
    before = [rung for rung in ladder[:number] if _scored(rung, name)]
    return before[-1] if before else next(rung for rung in ladder if _scored(rung, name))


def _scored(rung: Step, name: str) -> bool:
    return any(score.name == name for score in rung.diagnosis.scores)


__all__ = ["candidate_record", "explain_record", "named", "score_record", "step_record"]
