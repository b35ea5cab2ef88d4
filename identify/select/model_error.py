"""Effects that cannot be separated from the error of the finite element model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step


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


def may_be_left_of_error(
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


def _acts_by_compliance(step: Step, name: str, settings: SelectionSettings) -> bool:
    """Whether an effect acts as another compliance of the body under each press."""
    at, press = step.fit.at, step.fit.model.readings.press
    by_compliance = at.whitened(at.by_compliance, press)
    pattern = step.diagnosis[name].beyond
    along = np.array([np.bincount(press, by_compliance * column) for column in pattern.T])
    square = np.bincount(press, by_compliance**2)
    return bool(np.sum(along**2 / square) >= settings.by_compliance * np.sum(pattern**2))
