"""Structure that errors of the finite element model, and of laws of contact, may leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.fit.result import FitResult
from identify.fit.settings import CONTACT_LAW, FREE_COMPLIANCE
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step


def accept_best(
    ladder: Sequence[Step],
    accepted: Sequence[AcceptedEffect],
    candidates: tuple[Candidate, ...],
    settings: SelectionSettings,
) -> AcceptedEffect:
    """Return the best candidate of a step, the ladder's last, with its group."""
    now, winner = ladder[-1], candidates[0]
    left = (MODEL_ERROR,) * _may_be_left_of_error(ladder, accepted, winner, settings)
    alike = {c.name: confounded(now, c.name, settings) or left for c in candidates}
    return AcceptedEffect(winner.name, candidates, confounded=alike,
                          chi2_before=now.fit.chi2, settings=settings)  # fmt: skip


def confounded(step: Step, name: str, settings: SelectionSettings = SELECTION) -> tuple[str, ...]:
    """Return the effects that cannot be separated from an effect because of model error.

    An effect that the map imitates is almost collinear with the map. Its amplitude would have to be
    large and would be compensated by a wrong map, so a small model error can mimic it. If the model
    error itself fits best, it may be any of these effects. An effect with a pattern like that of
    the model error, which is only an estimate, is not separated from it either.
    """
    scores = [score for score in step.diagnosis.scores if score.untestable is None]
    imitated = [score.name for score in scores if score.visible < settings.imitated]
    if name == MODEL_ERROR:
        return tuple(imitated)
    alike = MODEL_ERROR in step.diagnosis.confused_with(name)
    return (MODEL_ERROR,) * (name in imitated or alike)


def _may_be_left_of_error(
    ladder: Sequence[Step],
    accepted: Sequence[AcceptedEffect],
    winner: Candidate,
    settings: SelectionSettings,
) -> bool:
    """Whether an effect may be the residue of a model error that was accepted before."""
    now = ladder[-1]
    if not any(MODEL_ERROR in effect.group for effect in accepted):
        return False
    explained, more = ladder[0].fit.chi2 - now.fit.chi2, now.fit.chi2 - winner.chi2
    return more < settings.left_of_error * explained and _acts_by_compliance(
        now, winner.name, settings
    )


def of_field(step: Step, settings: SelectionSettings) -> tuple[str, ...]:
    """Significant effects that only change compliances, beside noise and a map that errs in each.

    The prior of a free map, which no true body is drawn from, decides there which compliances are
    improbable. A skin (p = 1e-11) was found beside the map of a Gaussian inclusion.
    """
    field = step.fit.field
    if field is None or field.hyper.error == 0 or not step.comparison.is_noise:
        return ()
    names = step.diagnosis.significant
    return tuple(name for name in names if _acts_by_compliance(step, name, settings))


def _acts_by_compliance(step: Step, name: str, settings: SelectionSettings) -> bool:
    """Whether an effect acts as another compliance of the body under each press."""
    at, press = step.fit.at, step.fit.model.readings.press
    by_compliance = at.whitened(at.by_compliance, press)
    pattern = step.diagnosis[name].beyond
    along = np.array([np.bincount(press, by_compliance * column) for column in pattern.T])
    square = np.bincount(press, by_compliance**2)
    return bool(np.sum(along**2 / square) >= settings.by_compliance * np.sum(pattern**2))


def within_laws(
    first: FitResult,
    last: FitResult,
    accepted: Sequence[AcceptedEffect],
    settings: SelectionSettings,
) -> bool:
    """Whether structure that remains beside a free map is less than laws of contact are right to.

    Where single presses called for the laws, they hold to a few per cent (`contact_law`): an excess
    of a hundredth of what they explain, in a residual of hardly more than noise, is their own.
    """
    if last.field is None or not any(effect.shown_by_presses for effect in accepted):
        return False
    small = last.chi2 - last.dof <= settings.of_laws * (first.chi2 - last.chi2)
    return small and last.chi2_per_dof <= settings.nearly_noise**2


def residues(
    ladder: Sequence[Step], accepted: Sequence[AcceptedEffect], settings: SelectionSettings
) -> tuple[str, ...]:
    """Effects of the body, last found, that take no more than another one's form may be off by.

    A modulus that grows exponentially across the body, found as a straight gradient, left 1.5 % of
    what that explained, and fibres took it.
    """
    chi2 = [step.fit.chi2 for step in ladder]
    if len(ladder) < 3 or chi2[-2] - chi2[-1] > settings.trace * (chi2[0] - chi2[-1]):
        return ()
    body = {p.effect.name for p in ladder[-1].fit.model.effects if p.effect.link == "body"}
    names = body & {a.name for a in accepted if not a.shown_by_presses}
    last = names - set(ladder[-2].fit.effect_names)
    return tuple(a.name for a in accepted if a.name in last) if names > last else ()


def beside_edge(fit: FitResult, accepted: Sequence[AcceptedEffect]) -> tuple[str, ...]:
    """Effects of the body that are found while an inclusion of the map is held at a side of it.

    Such an inclusion stands for another cause: one that wandered into a corner imitated a gradient,
    and the true one was said to be an extra inclusion.
    """
    sides = [name for name in fit.at_bound if name in fit.map.names and name[-3:] in ("x_m", "y_m")]
    body = {part.effect.name for part in fit.model.effects if part.effect.link == "body"}
    return tuple(a.name for a in accepted if sides and a.name in body and not a.shown_by_presses)


def few_presses(
    fit: FitResult, accepted: Sequence[AcceptedEffect], settings: SelectionSettings
) -> np.ndarray:
    """Few presses (j,) bool that hold most of the excess beside a free map; else none.

    Where the presses called for a law that brings most of them to noise, the others (beside a hard
    lump, say) have a law of their own.
    """
    press = fit.model.readings.press
    none = np.zeros(fit.model.readings.presses, bool)
    if fit.field is None or not any(effect.shown_by_presses for effect in accepted):
        return none
    squares, count = np.bincount(press, fit.at.residual**2), np.bincount(press)
    bad = squares > FREE_COMPLIANCE.tail * count
    share = np.sum((squares - count)[bad]) / max(fit.chi2 - fit.dof, 1.0)
    few = np.mean(bad) <= 1 - CONTACT_LAW.noise_share
    return bad if few and share > settings.elsewhere else none
