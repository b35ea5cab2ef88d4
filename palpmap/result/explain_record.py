"""Results as the records of result.json, diagnosis.json and limits.json."""

from collections.abc import Mapping, Sequence

from identify.design import DETECTION, Assessment, BetterScans, Design, Limit
from identify.fit import Estimate, Field
from identify.select import EffectVerdict, Explanation, Score, Step, WithoutSuspects
from palpmap.result.finding import parameter_records
from palpmap.result.next_scan import PLANNED, finer_cells, next_presses_records
from palpmap.result.presses_words import counted, presses_record
from palpmap.result.records import (
    BetterScanRecord,
    CandidateRecord,
    DiagnosisRecord,
    ExplainRecord,
    FormCurveRecord,
    FormRecord,
    LimitRecord,
    LimitsRecord,
    OtherMapRecord,
    ParameterRecord,
    PlannedScanRecord,
    StepRecord,
    ValueRecord,
    WithoutSuspectsRecord,
)
from palpmap.study.cell_size import probed_part
from palpmap.study.frame import evidence
from palpmap.study.open_study import Problem


def explain_record(
    explained: Explanation,
    problem: Problem,
    assessment: Assessment,
) -> ExplainRecord:
    """Return verdict, additions, ladder, candidates, parameters, limits of an explanation."""
    final, without, apart = explained.final, assessment.without, explained.apart
    readings = problem.model.readings
    first = readings.first
    shown = probed_part(problem.study.body, readings.point_m[first], readings.radius_m[first])
    return ExplainRecord(
        verdict=explained.verdict,
        added=explained.added,
        ambiguous=explained.ambiguous,
        unknown=explained.unknown,
        reliable=explained.told_apart,
        few_presses=_few(explained),
        traces=explained.traces,
        helpers=tuple(
            a.name
            for a in explained.accepted
            if a.name not in (*explained.added, *explained.unknown)
        ),
        ladder=tuple(step_record(step) for step in explained.ladder),
        candidates=tuple(candidate_record(found, problem, final) for found in assessment.verdicts),
        parameters=parameters_of(final, problem, assessment.parameters),
        forms=tuple(
            FormRecord(in_place_of=form.effect, effect=form.name, weight=form.weight)
            for form in assessment.forms
        ),
        form_curves=tuple(map(FormCurveRecord.copy_of, assessment.curves)),
        residual=final.comparison.statement,
        suspect_presses=(apart.presses if apart else explained.ladder[0].comparison.bad_presses),
        presses_apart=dict(zip(apart.presses, apart.softer, strict=True)) if apart else {},
        suspects_left=assessment.outlying,
        without_suspects=None if without is None else without_record(without),
        explained_share=explained.explained_share,
        presses_alone=presses_record(problem, explained.accepted),
        unseen_inclusions=assessment.unseen_inclusions,
        stated_lengths=assessment.confounders,
        finer_cells=finer_cells(problem.study.body, shown) if assessment.finer_mesh else None,
        other_map=assessment.other_map and OtherMapRecord.copy_of(assessment.other_map),
        next_presses=next_presses_records(
            assessment, problem.model.readings.presses, apart is not None
        ),
        limits=tuple(limit_record(limit) for limit in assessment.limits),
        detection_limits={
            one.name: one.smallest_share for one in assessment.limits if one.smallest_share
        },
        never_seen=tuple(one.name for one in assessment.limits if not one.smallest_share),
        unseen_shifts=dict(assessment.undetected_biases),
        not_counted=assessment.not_counted,
        **counted(problem),
    )


def _few(explained: Explanation) -> tuple[int, ...]:
    """Return the presses (ids) that alone hold the structure of an unexplained scan."""
    if explained.fitted_verdict != "unexplained":
        return ()
    presses = explained.final.comparison.presses
    return tuple(presses[j].press for j in explained.in_few_presses)


def diagnosis_record(step: Step, problem: Problem) -> DiagnosisRecord:
    """Return fit, residual and candidates as the record of diagnosis.json."""
    return DiagnosisRecord(
        **{
            **dict(step_record(step)),
            **counted(problem),
            "parameters": parameters_of(step, problem),
            "candidates": tuple(
                candidate_record(step.diagnosis.effect_verdict(score.name), problem)
                for score in step.diagnosis.scores
            ),
        }
    )


def limits_record(
    limits: Sequence[Limit], better: BetterScans, problem: Problem, field: Field | None = None
) -> LimitsRecord:
    """Return detection limits and the scans that would show more as the record of limits.json.

    `field` is that of a free map.
    """
    records = {
        name: BetterScanRecord(
            **dict(_planned(design)),
            smallest_share=limit.smallest_share or 0.0,
            confused_with=limit.confused_with,
        )
        for name, (design, limit) in better.by_effect.items()
    }
    return LimitsRecord(
        limits=tuple(
            limit_record(limit, records.get(limit.name), better.in_mixed.get(limit.name))
            for limit in limits
        ),
        mixed_scan=None if better.mixed is None else _planned(better.mixed.design),
        sight_m=field and field.sight_m,
        labelled=field is not None and bool(field.regions),
        **counted(problem),
    )


def _planned(design: Design) -> PlannedScanRecord:
    return PlannedScanRecord(change=design.change, program=PLANNED.format(design.name))


def limit_record(
    limit: Limit, better: BetterScanRecord | None = None, mixed: float | None = None
) -> LimitRecord:
    """Return a detection limit, with a scan that shows more and the share seen in a mixed one."""
    return LimitRecord.copy_of(
        limit, bias_at_share=DETECTION.bias_share, better_scan=better, in_mixed_scan=mixed
    )


def without_record(without: WithoutSuspects) -> WithoutSuspectsRecord:
    """Return the result without the outlying presses."""
    return WithoutSuspectsRecord.copy_of(
        without,
        chi2_per_dof=without.fit.chi2_per_dof,
        parameters=without.fit.values,
        residual=without.comparison.statement,
    )


def step_record(step: Step) -> StepRecord:
    """Return one step of the ladder."""
    fit = step.fit
    return StepRecord(
        effects=fit.effect_names,
        rms_m=fit.rms_m,
        held_out_rms_m=step.cross_validation.rms_m,
        held_out_high_rms_m=step.cross_validation.high_rms_m,
        noise_rms_m=step.comparison.expected_rms_m,
        chi2_per_dof=fit.chi2_per_dof,
        is_noise=step.comparison.is_noise,
        statement=step.comparison.statement,
        parameters={
            name: ValueRecord(value=value, std=fit.std.get(name, 0.0))
            for name, value in fit.values.items()
        },
    )


def candidate_record(
    found: EffectVerdict, problem: Problem, final: Step | None = None
) -> CandidateRecord:
    """Return the verdict on one effect, and the numbers of the step that decided it.

    Parameters
    ----------
    final : last step of an explanation, whose estimate of the effect is the better one
    """
    score = found.score
    return CandidateRecord(
        name=score.name,
        rms_m=score.rms_m,
        visible=score.visible,
        values={name: float(value) for name, value in score.values.items()},
        untestable=score.untestable,
        verdict=found.verdict,
        score=found.statistic,
        p_value=found.p_value,
        explained_fraction=found.explained_fraction,
        confused_with=found.confused_with,
        evidence=_evidence(score, problem, final),
        family=problem.catalogue[score.name].family,
    )


def _evidence(score: Score, problem: Problem, final: Step | None) -> str:
    values: Mapping[str, float] = score.values
    if final is not None and score.name in final.fit.at.values:
        values = final.fit.at.values[score.name]
    elif score.untestable is not None:
        return f"Cannot be tested: {score.untestable}."
    effect, origin_m = problem.catalogue[score.name], problem.experiment.origin_m
    return evidence(effect, values, problem.model.readings, origin_m)


def parameters_of(
    step: Step, problem: Problem, estimates: Mapping[str, Estimate] | None = None
) -> dict[str, ParameterRecord]:
    """Return values, standard errors and 95 % intervals, positions in the scan's frame.

    Parameters
    ----------
    estimates : of the step; None for intervals from the covariance alone
    """
    return parameter_records(
        estimates or step.fit.intervals(curved=False),
        problem.experiment.origin_m,
        step.fit.at_bound,
    )
