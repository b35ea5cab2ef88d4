"""Maps of other forms, for an unexplained scan: would one do, or does none.

Two fits answer it. Each press on a body of its own (under a flat tip, a compliance of its own)
bounds every map: a residual that this leaves is none of stiffness. Where it leaves little, a free
map is fitted in place of the inclusions. Of the effects that were added only those stay that the
presses call for: a wrong map brings in others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from identify.effects.unknown_course import UNKNOWN
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.free_compliance_start import free_compliance, on_any_body
from identify.fit.free_map.parametric_evidence import parametric_evidence
from identify.fit.free_map_start import fit_free_map
from identify.fit.result import FitResult
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.experiment import PlacedExperiment
from identify.optimize.result import InadmissibleError
from identify.residual.compare import compare
from identify.select.explanation import Explanation
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.start_fit import StartFit
from models import InputError

Answer = Literal["another_map", "either", "rough_map", "no_map", "undecided"]


@dataclass(frozen=True)
class OtherMap:
    """Residual of an unexplained scan beside maps of any form.

    Attributes
    ----------
    answer : `another_map`: a free map leaves noise, and has more evidence than the inclusions.
        `either`: it leaves noise, but has less evidence: an effect that the catalogue lacks, or
        that acts on compliances, may be imitated. `rough_map`: it leaves noise only with an error
        of its own in each press (`map_error`), so that places, tips or contacts may differ from
        press to press. `no_map`: structure remains, so that its cause is none of stiffness.
        `undecided`: the presses alone leave a map possible, and no free map was found, or under a
        ball none that bends their curves as they ask for
    chi2_per_dof : of the free map, or of the presses with a compliance each where no free map was
        needed or found
    left : share of the unexplained chi-square that remains
    map_error : relative error of the free map in each press's compliance; 0 where none is needed
    more_evidence : logarithm of the free map's evidence less that of the inclusions; None where no
        free map was fitted
    effects : names of the effects beside it
    """

    answer: Answer
    chi2_per_dof: float
    left: float
    map_error: float = 0.0
    more_evidence: float | None = None
    effects: tuple[str, ...] = ()


def other_map(
    explained: Explanation,
    start: StartFit,
    open_free: Callable[[], PlacedExperiment],
    settings: SelectionSettings = SELECTION,
) -> OtherMap | None:
    """Ask whether a map of another form explains an unexplained scan.

    Parameters
    ----------
    open_free : makes the experiment with a free map, on a mesh for it
    settings : `sure` is the level of the test, `elsewhere` the share of the excess that excludes
        every map, `margin` twice the evidence that decides, `rough` the largest error of a map
        that counts as one of its form

    Returns
    -------
    OtherMap or None
        None where the question does not arise.
    """
    last = explained.final.fit
    if explained.fitted_verdict != "unexplained" or last.field is not None:
        return None
    before = explained.ladder[0].fit if explained.unknown else last
    excess = max(before.chi2 - before.dof, 1.0)
    presses = free_compliance(start.scan, start.body, last.model.noise)
    own = explained.ladder[0].fit.effect_names
    named = [p for p in last.model.effects if p.effect.family != UNKNOWN]
    given = [p for p in named if p.effect.name in own]
    alone = min(
        (_alone(presses, parts, last) for parts in (given, named)),
        key=lambda fit: fit.chi2 + fit.unknowns * np.log(len(fit.residual)),
    )
    alone = on_any_body(presses, alone)
    least = alone.chi2_on_any_body
    left = (least - alone.dof) / excess
    noise = chdtrc(alone.dof, least) >= settings.sure
    if not noise and left > settings.elsewhere and not last.model.noise.estimated:
        return OtherMap("no_map", alone.chi2_per_dof, min(left, 1.0), effects=alone.names)
    start.experiment.say("fitting a free map in place of the inclusions")
    effects = [(p.effect, last.at.values[p.effect.name]) for p in given]
    effects += [(p.effect, p.start) for p in alone.parts if p.effect.name not in own]
    try:
        free = replace(open_free(), effects=tuple(effects))
        fit = fit_free_map(free)
    except (InputError, InadmissibleError):
        fit = None
    if fit is None or not fit.success:
        return OtherMap("undecided", alone.chi2_per_dof, max(left, 0.0), effects=alone.names)
    bent = least < alone.chi2 and left <= settings.elsewhere
    return _answer(fit, last, free, excess, bent, settings)


def _alone(
    presses: FreeCompliance, parts: Sequence[EffectInModel], last: FitResult
) -> FreeComplianceFit:
    """Fit the presses alone beside effects, from their values in the last model."""
    parts = [presses.part(p.effect, last.at.values[p.effect.name]) for p in parts]
    return presses.fit([part for part in parts if presses.shows(part.effect)])


def _answer(
    fit: FitResult,
    last: FitResult,
    free: PlacedExperiment,
    excess: float,
    bent: bool,
    settings: SelectionSettings,
) -> OtherMap:
    """Judge a free map; `bent`: bodies that bend a ball's curves more leave little by press."""
    uncertain, at = fit.model.map_uncertainty, last.solution
    assert fit.field is not None
    assert uncertain is not None
    assert at is not None
    # Not from the criterion: a free map counts presses that scatter more than the noise less
    few = parametric_evidence(at.model, at.at.body, at.u, uncertain.felt)
    error, more = fit.field.hyper.error, float(fit.field.log_evidence - few)
    answer: Answer = "undecided" if bent else "no_map"
    if compare(fit, free.scan, settings.residual).is_noise:
        smooth: Answer = "another_map" if more > settings.margin / 2 else "either"
        answer = smooth if error <= settings.rough else "rough_map"
    left = min(max(fit.chi2 - fit.dof, 0.0) / excess, 1.0)
    return OtherMap(answer, fit.chi2_per_dof, left, error, more, fit.effect_names)
