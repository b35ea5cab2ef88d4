"""Selection of effects: score tests, candidates, forward selection, verdict."""

from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import fit_with
from identify.select.diagnosis import CandidateVerdict, Diagnosis, EffectVerdict
from identify.select.explanation import OTHER_CAUSE, Explanation, PressesApart, Verdict
from identify.select.form_average import Form
from identify.select.form_curve import FormCurve
from identify.select.outlying_presses import WithoutSuspects, explain
from identify.select.plant_and_recover import NOT_PLANTED, plant_and_recover
from identify.select.score_test import Score
from identify.select.settings import SELECTION
from identify.select.start_fit import (
    StartFit,
    contact_law_of,
    kind_of_map,
    refuse_effect,
    start_fit,
    with_effects,
)
from identify.select.step import Step, step_of

__all__ = [
    "NOT_PLANTED",
    "OTHER_CAUSE",
    "SELECTION",
    "AcceptedEffect",
    "CandidateVerdict",
    "Diagnosis",
    "EffectVerdict",
    "Explanation",
    "Form",
    "FormCurve",
    "PressesApart",
    "Score",
    "StartFit",
    "Step",
    "Verdict",
    "WithoutSuspects",
    "contact_law_of",
    "explain",
    "fit_with",
    "kind_of_map",
    "plant_and_recover",
    "refuse_effect",
    "start_fit",
    "step_of",
    "with_effects",
]
