"""An explanation on one screen: verdict, next step, ladder, evidence."""

from collections.abc import Sequence
from itertools import chain, pairwise
from typing import TYPE_CHECKING

from identify.select import Explanation, Step
from palpmap import units
from palpmap.console import plain
from palpmap.report.draw import console
from palpmap.result.doubts import (
    assumptions,
    bound_notes,
    counting_notes,
    form_notes,
    outlier_notes,
    stated_lengths,
    unended_fit,
    unseen_effects,
    unseen_inclusions,
)
from palpmap.result.evidence import added_names
from palpmap.result.explain_words import (
    VERDICTS,
    headline,
    step_evidence,
    steps_of,
    verdict_detail,
)
from palpmap.result.field_tables import field_tables
from palpmap.result.misfit_words import rise_note
from palpmap.result.presses_words import presses_sentences
from palpmap.result.records import ExplainRecord
from palpmap.result.tables import explained_table, ladder_table, verdict_table
from palpmap.study.open_study import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDTH = 30


def step_line(step: Step) -> str:
    """Return one line: the effects, the error and its bar, chi-square per degree of freedom."""
    noise = step.comparison.expected_rms_m
    bar = "█" * min(round(_WIDTH / 4 * step.fit.rms_m / noise), _WIDTH)
    names = step.fit.effect_names
    return (
        f"  {f'+ {names[-1]}' if names else 'map alone':<22} {units.rms(step.fit.rms_m):>9}  "
        f"{bar}  chi2/dof {step.fit.chi2_per_dof:.3g}"
    )


def explain_summary(
    record: ExplainRecord, explained: Explanation, problem: Problem, following: Sequence[str] = ()
) -> tuple["RenderableType", ...]:
    """Return the explanation as rich renderables that fit one screen.

    Parameters
    ----------
    following : the next steps, below the verdict
    """
    from rich.text import Text

    style = VERDICTS[explained.verdict][1]
    verdict = f"{headline(explained)} {verdict_detail(explained, record.other_map)}".strip()
    rises = (rise_note(*two) for two in pairwise(explained.ladder))
    said = [*_evidence(explained, problem), *chain(*rises), *presses_sentences(record)]
    further = [
        *explained.final.comparison.notes,
        *form_notes(record, explained),
        *counting_notes(explained),
    ]
    if unseen := unseen_effects(record, explained):
        further.insert(0, unseen)
    final = explained.final.fit
    of_field = map(console, field_tables(final, problem.experiment.origin_m, problem.scan))
    cautions = [unended_fit(explained), *bound_notes(record), *stated_lengths(record),
                unseen_inclusions(record), *assumptions(explained, problem),
                *outlier_notes(record)]  # fmt: skip
    return (
        Text(verdict, style=f"bold {style}"),
        *plain(following),
        console(ladder_table(record.ladder, title="error of each step")),
        *(Text(f"- {text}") for text in said),
        console(explained_table(record)),
        *of_field,
        console(verdict_table(record.candidates, title="verdict on each effect")),
        *(Text(f"- {text}") for text in further),
        *(Text(text, style="yellow") for text in cautions if text),
    )


def _evidence(explained: Explanation, problem: Problem) -> list[str]:
    """Return the evidence of each step whose effects are still in the model."""
    if explained.fitted_verdict == "unexplained" and not explained.added:
        return []
    says = []
    for number in steps_of(explained):
        names = added_names(explained.ladder[number - 1], explained.ladder[number])
        if set(names) & set(explained.final.fit.effect_names):
            titles = " and ".join(explained.effect(name).title for name in names)
            says.append(f"{titles}: {step_evidence(explained, problem, number)}")
    return says
