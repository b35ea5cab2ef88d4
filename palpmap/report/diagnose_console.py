"""A diagnosis on the console."""

from typing import TYPE_CHECKING

from identify.select import Diagnosis, Step
from palpmap.report.draw import console
from palpmap.result.doubts import untestable_sentences
from palpmap.result.presses_words import left_out_sentences
from palpmap.result.records import DiagnosisRecord
from palpmap.result.tables import score_table
from palpmap.units import rms

if TYPE_CHECKING:
    from rich.console import RenderableType


def diagnosis_screen(record: DiagnosisRecord, step: Step) -> tuple["RenderableType", ...]:
    """Return the candidates, best first, as rich renderables that fit a screen."""
    from rich.text import Text

    style = "green" if record.is_noise else "yellow"
    nothing = f"No effect of the catalogue is seen (rms {rms(record.rms_m)})."
    return (
        Text(record.statement, style=style),
        Text(_best_evidence(record, step.diagnosis) or nothing),
        console(score_table(record.candidates, "effects, by their score")),
        *untestable_sentences(record.candidates),
        *left_out_sentences(record),
    )


def _best_evidence(record: DiagnosisRecord, diagnosis: Diagnosis) -> str:
    """Return the evidence of the best-scored effect, and its equals; empty if none is seen."""
    best = diagnosis.scores[0] if diagnosis.scores else None
    if best is None or best.name not in diagnosis.significant:
        return ""
    candidate = next(c for c in record.candidates if c.name == best.name)
    family = {c.name: c.family for c in record.candidates}
    alike = [n for n in candidate.confused_with if n in diagnosis.significant]
    forms = [n for n in alike if family[n] == candidate.family]
    causes = [n for n in alike if n not in forms]
    says = f"Best: {best.name}. {candidate.evidence}"
    if causes:
        says += f" ({', '.join(causes)} would look much the same: `palpmap explain` decides)"
    if forms:
        says += f" Its form is open: {', '.join(forms)} would be the same cause by another law."
    return says
