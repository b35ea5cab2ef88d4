"""Assessment of an explanation: confounders, detection limits, and next presses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.design.detection_limits import Limit, detection_limits
from identify.design.geometry_confounders import GeometryConfounder, geometry_confounders
from identify.design.next_presses import Proposal, next_presses
from identify.design.other_map import OtherMap
from identify.design.predicted_limits import designs_on_body
from identify.design.scan_variants import Presses, presses_of, variations
from identify.design.settings import DETECTION, PLAN, DetectionSettings, PlanSettings
from identify.design.undetected_bias import UndetectedBias, undetected_biases
from identify.effects.base import Effect, advice
from identify.fit.result import Estimate
from identify.fit.settings import CONTACT_LAW
from identify.select.accepted_effect import AcceptedEffect
from identify.select.diagnosis import EffectVerdict
from identify.select.explanation import Explanation
from identify.select.form_average import Form, averaged, forms_of
from identify.select.form_curve import FormCurve, form_curves
from identify.select.outlying_presses import WithoutSuspects, suspects_left
from identify.select.verdicts import effect_verdict

Say = Callable[[str], None]
_IN_ORDER = ("preconditioning", "hysteresis")  # separated by timing and order, with those in time


@dataclass(frozen=True)
class Assessment:
    """Assessment of an explanation.

    Attributes
    ----------
    parameters : estimates of the last step, with intervals that follow the misfit's valley, those
        of the map averaged over the forms
    forms : the last model and those that the scan does not separate from it
    curves : the effects of the last model, drawn
    confounders : lengths of the study whose error would look like an effect that is offered
    unseen_inclusions : numbers, from one, of inclusions without evidence in the readings
    limits : detection limits of the first step
    undetected_biases : largest shift of each parameter of the last step by an undetected effect
    not_counted : effects whose shift of the parameters the scan cannot bound
    verdicts : on each effect that the model did not have from the start
    next_presses : scans that separate the last ambiguous group, the best one first
    without : result without the outlying presses, None where there are none
    outlying : presses (ids) that the answer does not account for
    repeat : these presses once more
    finer_mesh : the error of the mesh is among the effects offered, so that a finer mesh decides
    other_map : residual of an unexplained scan beside maps of any form, None where not asked
    """

    parameters: Mapping[str, Estimate]
    forms: tuple[Form, ...]
    curves: tuple[FormCurve, ...]
    confounders: tuple[GeometryConfounder, ...]
    unseen_inclusions: tuple[int, ...]
    limits: tuple[Limit, ...]
    undetected_biases: Mapping[str, UndetectedBias]
    not_counted: tuple[str, ...]
    verdicts: tuple[EffectVerdict, ...]
    next_presses: tuple[Proposal, ...]
    without: WithoutSuspects | None
    outlying: tuple[int, ...]
    repeat: Presses
    finer_mesh: bool
    other_map: OtherMap | None = None


def assess(
    explained: Explanation,
    catalogue: Sequence[Effect],
    without: WithoutSuspects | None = None,
    say: Say = lambda text: None,
    other: OtherMap | None = None,
    most_force_n: float | None = None,
    settings: DetectionSettings = DETECTION,
) -> Assessment:
    """Assess an explanation with the effects of a catalogue.

    Redundant inclusions and undetected effects are not sought in an unexplained scan: the missing
    effect may hide any of them.

    Parameters
    ----------
    without : result without the outlying presses, None where there are none
    say : called with the present task, in words
    other : residual of an unexplained scan beside maps of any form
    most_force_n : of the next presses, see `variations`
    settings : of the detection limits
    """
    first, last = explained.ladder[0].fit, explained.final.fit
    offered = {*explained.added, *(name for group in explained.ambiguous for name in group)}
    known = explained.fitted_verdict != "unexplained"
    outlying = suspects_left(explained, without)
    say("computing detection limits")
    # Biases are told by the last fit's, so that these are the ones found at their size
    unseen = detection_limits(last, _beside(explained, catalogue)) if known else ()
    limits = unseen if known and last is first else _limits(explained, catalogue, unseen, settings)
    forms = forms_of(explained)
    say("looking for confounders of the effects found")
    return Assessment(
        parameters=averaged(explained, forms),
        forms=forms,
        curves=form_curves(last),
        confounders=tuple(c for c in geometry_confounders(explained) if c.effect in offered),
        unseen_inclusions=last.unseen_inclusions if known else (),
        limits=limits,
        undetected_biases=undetected_biases(unseen),
        not_counted=_not_counted(explained, unseen, catalogue),
        verdicts=tuple(
            effect_verdict(effect, explained)
            for effect in catalogue
            if effect.name not in first.effect_names
        ),
        next_presses=_next_presses(explained, catalogue, say, most_force_n),
        without=without,
        outlying=outlying,
        repeat=_again(explained, outlying),
        finer_mesh=known and MODEL_ERROR in offered,
        other_map=other,
    )


def _beside(explained: Explanation, catalogue: Sequence[Effect]) -> list[Effect]:
    """Return the effects that may be undetected beside the last model.

    Beside a free map each effect of the body takes models of its own: those that were not tested
    there are left out.
    """
    last = explained.final
    if last.fit.field is None:
        return list(catalogue)
    tested = {score.name for score in last.diagnosis.scores if score.untestable is None}
    return [effect for effect in catalogue if effect.link != "body" or effect.name in tested]


def _limits(
    explained: Explanation,
    catalogue: Sequence[Effect],
    unseen: Sequence[Limit],
    settings: DetectionSettings,
) -> tuple[Limit, ...]:
    """Return the detection limits of the first step.

    Beside a free map each effect of the body takes models of its own: its limit is that beside the
    last step, or none where it was not tested. Limits are told by the noise: none holds beside a
    residual of many times the noise.
    """
    first, last = explained.ladder[0].fit, explained.final
    unexplained = explained.fitted_verdict == "unexplained"
    if unexplained and last.fit.chi2_per_dof > settings.largest_misfit**2:
        return ()
    if first.field is None or last.fit is first:
        return detection_limits(first, catalogue, known=unseen)
    if not unseen:
        return detection_limits(first, _beside(explained, catalogue), known=unseen)
    body = [effect for effect in catalogue if effect.link == "body"]
    others = [effect for effect in catalogue if effect.link != "body"]
    names = {effect.name for effect in body}
    of_body = tuple(limit for limit in unseen if limit.name in names)
    found = [effect for effect in body if effect.name in last.fit.effect_names]
    return (*detection_limits(first, [*others, *found]), *of_body)


def _not_counted(
    explained: Explanation, limits: Sequence[Limit], catalogue: Sequence[Effect]
) -> tuple[str, ...]:
    """Name the effects without any limit, but for those that the model makes redundant."""
    chain = explained.final.fit.model.chain
    effects = {effect.name: effect for effect in catalogue}
    return tuple(
        limit.name
        for limit in limits
        if not (limit.smallest_share or limit.largest_share)
        and advice(effects[limit.name]).redundant(chain.profile, chain.nonlinear) is None
    )


def _again(explained: Explanation, outlying: Sequence[int]) -> Presses:
    if explained.apart is not None:
        return presses_of(explained.apart.readings)
    ids = [press.press for press in explained.ladder[0].comparison.presses]
    made = presses_of(explained.ladder[0].fit.model.readings)
    return made.taken(np.flatnonzero(np.isin(ids, outlying)))


def _next_presses(
    explained: Explanation, catalogue: Sequence[Effect], say: Say, most_force_n: float | None
) -> tuple[Proposal, ...]:
    """Return the scans that separate the last ambiguous group."""
    offered = explained.ambiguous
    ambiguous = [a for a in explained.accepted if len(a.equivalents) > 1 and a.group in offered]
    if not ambiguous:
        return ()
    group = ambiguous[-1]
    candidates = [(r.name, r.fit) for r in group.candidates if r.name in group.equivalents]
    names = [name for name, _ in candidates]
    in_time = any(
        "time" in effect.needs or effect.name in _IN_ORDER
        for effect in catalogue
        if effect.name in names
    )
    readings = explained.final.fit.model.readings
    timed = in_time and readings.time_s is not None
    presses = presses_of(readings)
    few = np.linspace(0, len(presses) - 1, min(PLAN.most, len(presses))).round().astype(int)
    designs = designs_on_body(candidates[0][1], variations(presses.taken(few), timed, most_force_n))
    settings = _settings(explained, group)
    by_law = {r.name: r.chi2 for r in group.candidates} if group.shown_by_presses else None
    return next_presses(candidates, designs, say, settings, by_law)


def _settings(explained: Explanation, group: AcceptedEffect) -> PlanSettings:
    """Return the settings for a group: its laws must differ by more than they are right to.

    Laws of contact within a share of the excess misfit are equal (`ContactLawSettings.equal`), also
    of both scans together, whose excess is up to twice as large.
    """
    if not group.shown_by_presses:
        return PLAN
    alone = explained.ladder[0].fit
    slack = 2 * CONTACT_LAW.equal * max(alone.chi2 - alone.dof, 0.0)
    return replace(PLAN, needed=PLAN.needed + slack, aim=PLAN.aim + slack)
