"""result.json: what the loop found, as plain data."""

from dataclasses import asdict
from typing import Any

from identify.design.geometry_confounders import geometry_confounders
from identify.design.redundant_inclusions import redundant_inclusions
from identify.effects.base import Effect
from identify.select.diagnosis import Diagnosis
from identify.select.forward_selection import Explanation
from identify.select.outlying_presses import WithoutSuspects, suspects_left
from identify.select.score_test import Score
from identify.select.step import Step
from identify.select.verdicts import effect_verdict
from palpmap.result.next_scan import finer_cells
from palpmap.result.presses_words import counted, presses_record
from palpmap.study.frame import frame_shift_m
from palpmap.study.open_study import Problem

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
        "helpers": [a.name for a in explained.accepted if a.name not in explained.added],
        "ladder": [step_record(rung) for rung in explained.ladder],
        "candidates": [
            candidate_record(effect, explained, problem)
            for effect in problem.catalogue
            if effect.name not in problem.model.effect_names
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
    return (
        [] if explained.verdict == "unexplained" else [*redundant_inclusions(explained.final.fit)]
    )


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
        "effects": list(rung.fit.effect_names),
        "rms_m": rung.fit.rms_m,
        "held_out_rms_m": rung.cross_validation.rms_m,
        "held_out_high_rms_m": rung.cross_validation.high_rms_m,
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
    """Return the verdict on one effect, and the numbers of the step that decided it."""
    found = effect_verdict(effect, explained)
    return {
        **_numbers(found.score),
        "verdict": found.verdict,
        "score": found.statistic,
        "p_value": found.p_value,
        "explained_fraction": found.explained_fraction,
        "confused_with": list(found.confused_with),
        "evidence": evidence(effect, found.score, problem, explained.final),
    }


def score_record(score: Score, diagnosis: Diagnosis) -> dict[str, Any]:
    """Return an effect's score alone."""
    return {
        **_numbers(score),
        "verdict": diagnosis.verdict(score.name),
        "score": score.statistic,
        "p_value": score.p_value,
        "explained_fraction": diagnosis.explained_fraction(score.name),
        "confused_with": list(diagnosis.confused_with(score.name)),
    }


def _numbers(score: Score) -> dict[str, Any]:
    return {
        "name": score.name,
        "rms_m": score.rms_m,
        "visible": score.visible,
        "values": {name: float(value) for name, value in score.values.items()},
        "untestable": score.untestable,
    }


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

    `bent` intervals follow the valley of the misfit, see `FitResult.parameters`.
    """
    fit = rung.fit
    held = fit.at_bound
    found = {}
    for name, entry in (fit.parameters if bent else fit.intervals(curved=False)).items():
        shift = frame_shift_m(name, problem.experiment.origin_m)
        found[name] = {
            "value": entry.value + shift,
            "std": entry.std,
            "lower95": entry.lower95 + shift,
            "upper95": entry.upper95 + shift,
            "unit": entry.unit,
            "at_bound": name in held,
        }
    return found


__all__ = ["candidate_record", "explain_record", "score_record", "step_record"]
