"""The selection of a started fit, and its first step, from the contact law of the presses."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from identify.fit.contact_law import ContactLaw
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.free_map_fit import refit_free_map
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.fit.result import FitResult
from identify.fit.settings import PRECISE
from identify.map.gaussian_map import GaussianMap
from identify.measurement.experiment import Progress
from identify.measurement.model import MeasurementModel
from identify.residual.compare import compare_residual
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.diagnosis import diagnose
from identify.select.explanation import Explanation
from identify.select.forward_selection import Policy, forward_selection
from identify.select.model_error import few_presses
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.start_fit import StartFit
from identify.select.step import Step, whitened_fit


def selected(
    start: StartFit,
    seed: int,
    on_step: Callable[[Step], None] | None,
    settings: SelectionSettings,
    without: Explanation | None = None,
    one_effect: bool = False,
) -> Explanation:
    """Select the effects of a started fit.

    Parameters
    ----------
    without : answer without the presses that stand apart: at most one effect for all follows it
    one_effect : at most one where it does not leave noise
    """
    law = start.law

    def first(step: Step, say: Progress):
        if without is not None and without.accepted:
            return _refitted(without, step, say)
        assert law is not None
        found = follow(law, step, start.start, say, settings)
        if found is None or start.model.press_error or _is_noise(found[0], start, settings):
            return found
        if few_presses(*found, settings).any():  # no law of all presses meets these
            return found
        for equal in _equals(law, settings):
            other = follow(equal, step, start.start, say, settings)
            if other is not None and _is_noise(other[0], start, settings):
                return other
        return found

    calls = law is not None and _calls_for_effects(law, start)
    return forward_selection(
        start.model,
        start.start,
        start.scan,
        start.catalogue,
        seed=seed,
        progress=start.experiment.say,
        on_step=on_step,
        policy=Policy(
            first=first if calls or (without is not None and without.accepted) else None,
            few_apart=one_effect or without is not None,
        ),
        settings=replace(settings, most_effects=0) if start.model.press_error else settings,
        first=start.joint,
    )


def _is_noise(fit: FitResult, start: StartFit, settings: SelectionSettings) -> bool:
    return compare_residual(whitened_fit(fit, start.scan), settings.residual).is_noise


def _equals(law: ContactLaw, settings: SelectionSettings) -> Iterator[ContactLaw]:
    """Yield laws that do as well for the presses, best first: beside a map one may do better.

    Also those that places pressed again refute: a further effect would be less credible.
    """
    every = replace(law, found=replace(law.found, again=0))
    for name in law.names:
        for _, fit in [*every.candidates(name), *every.splits(name)][: settings.pairs]:
            if fit.middle_misfit <= settings.meets_presses:
                yield replace(law, found=fit)


def with_exact_map(
    start: StartFit, seed: int, settings: SelectionSettings
) -> tuple[Explanation, StartFit] | None:
    """Select the effects beside a map without an error of its own, where one was counted.

    A large effect that is missing misfits as grossly as a map of a wrong form. It is sought where
    the presses alone, each with a compliance of its own, misfit grossly as well, and one effect
    takes half of the misfit or more by its score.

    Returns
    -------
    the explanation and its start; None where structure remains, which the map's error may be
    """
    if start.law is None or not PRECISE.is_gross(start.law.found.chi2_per_dof):
        return None
    exact = replace(start, model=replace(start.model, press_error=0.0))
    start.experiment.say("fitting the map without an error of its own")
    fit = exact.joint
    scores = diagnose(fit, list(start.catalogue), seed=seed, settings=settings.diagnosis)
    best = max((scores[name].statistic for name in scores.significant), default=0.0)
    if best < settings.elsewhere * scores.excess:
        return None
    found = selected(exact, seed, None, settings)
    return (found, exact) if found.final.comparison.is_noise else None


def _refitted(
    answer: Explanation, step: Step, say: Progress
) -> tuple[FitResult, list[AcceptedEffect]]:
    """Fit the effects of an answer to all presses."""
    say("fitting the effects of the others to all presses")
    final = answer.final.fit
    model = replace(step.fit.model, effects=final.model.started(final.u).effects)
    return fit_jointly(model, final.map), list(answer.accepted)


def _calls_for_effects(law: ContactLaw, start: StartFit) -> bool:
    """Whether the presses call for effects: beside a free map also for those of a partial law."""
    return bool(law.names) or (law.partial is not None and start.fit.field is not None)


def follow(
    law: ContactLaw,
    step: Step,
    start: GaussianMap,
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[AcceptedEffect]] | None:
    """Fit the map beside the effects of a law; None if that explains the scan no better.

    Candidates of each effect and their criterion are those of the law, free of the map.

    Parameters
    ----------
    step : without the effects
    start : map to start from, beside that of the step
    """
    found = law.partial if law.partial and step.fit.field is not None else law.found
    names = [name for name in found.names if name not in law.plain.names]
    if not names:
        return None
    say(f"fitting the map with {', '.join(names)}")
    if step.fit.field is not None:
        model = _with_effects(found, step.fit.model, step.fit)
        free = refit_free_map(model, step.fit.map, compliance=found.compliance)
        if free.bic >= step.fit.bic:
            return None
        if law.partial is None:
            return free, _accepted(law, free, say, settings)
        alone = [Candidate(name, found.chi2, law.criterion(found), free) for name in names]
        return free, [
            AcceptedEffect(c.name, (c,), partial=True, law=found, settings=settings) for c in alone
        ]
    # A map that was fitted without the effects, or to straightened readings: either may be a trap
    most = settings.first_evaluations
    fits = [
        _joint_fit(law.found, step.fit.model, step.fit, stiffness, most)
        for stiffness in (start, step.fit.map)
    ]
    fit = min((fit for fit in fits if fit is not None), key=lambda fit: fit.bic, default=None)
    if fit is None or fit.bic >= step.fit.bic:
        return None
    fit = fit_jointly(fit.model, fit.map)
    return fit, _accepted(law, fit, say, settings, step)


def _accepted(
    law: ContactLaw,
    fit: FitResult,
    say: Callable[[str], None],
    settings: SelectionSettings,
    step: Step | None = None,
) -> list[AcceptedEffect]:
    """Return the effects of a law with their equivalents, fitted beside the map of a fit.

    Free maps have the prior of that fit; others the correction of the step's model.
    """
    own = {part.effect.name for part in law.plain.parts}
    plain = replace(fit.model, effects=tuple(p for p in fit.model.effects if p.effect.name in own))
    base = plain if step is None else step.fit.model
    accepted = []
    for name in law.names:
        chi2 = law.found.chi2 + law.found.between
        candidates = [Candidate(name, chi2, law.criterion(law.found), fit)]
        pairs = [(" with ".join(both), alone) for both, alone in law.splits(name)[: settings.pairs]]
        for other, alone in [*law.candidates(name), *pairs]:
            say(f"trying {other}")
            beside = _joint_fit(alone, base, fit, fit.map, settings.refit_evaluations)
            if beside is not None:
                # As good as the effect found, as far as the laws can be trusted
                chi2 = alone.chi2 + alone.between
                candidates.append(Candidate(other, chi2, candidates[0].criterion, beside))
        accepted.append(
            AcceptedEffect(
                name,
                tuple(candidates),
                shown_by_presses=True,
                range_of=law.range_of(name),
                law=law.found,
                settings=settings,
            )
        )
    return accepted


def _joint_fit(
    law: FreeComplianceFit,
    model: MeasurementModel,
    near: FitResult,
    start: GaussianMap,
    evaluations: int,
) -> FitResult | None:
    """Fit the map and the effects of a law, from the law's values."""
    model = _with_effects(law, model, near)
    return try_fit(model, start, rounds=0, max_evaluations=evaluations)


def _with_effects(
    law: FreeComplianceFit, model: MeasurementModel, near: FitResult
) -> MeasurementModel:
    """Return a model with the effects of a law, bounded for the body of a fit nearby."""
    for part in law.parts:
        if part.effect.name not in model.effect_names:
            model = model.with_effect(part.effect, law.values[part.effect.name], near.at.state)
    return model
