"""The report of an explanation: one HTML file with its pictures inside."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from identify.select import AcceptedEffect, Explanation
from palpmap import units
from palpmap.report.draw import write_page
from palpmap.result import doubts
from palpmap.result import explain_words as words
from palpmap.result.evidence import added_names, kept
from palpmap.result.field_tables import field_tables
from palpmap.result.finding import Finding
from palpmap.result.presses_words import presses_sentences
from palpmap.result.records import (
    ExplainRecord,
    LimitRecord,
    NextPressesRecord,
    ValueRecord,
)
from palpmap.result.tables import (
    Table,
    candidate_table,
    farthest_shifts,
    ladder_table,
    limit_table,
    number,
    parameter_table,
    undetermined,
)
from palpmap.study.frame import in_scan_frame
from palpmap.study.open_study import Problem


@dataclass(frozen=True)
class _Step:
    """One step in the report: its effects, evidence, reservations and refits."""

    number: int
    title: str
    evidence: str
    is_offered: bool
    notes: tuple[str, ...]
    tables: tuple[Table, ...]


def write_explain_report(
    path: Path,
    finding: Finding,
    explained: Explanation,
    record: ExplainRecord,
    problem: Problem,
    pictures: Mapping[str, bytes],
    following: Sequence[str] = (),
) -> None:
    """Write the report of an explanation.

    Parameters
    ----------
    path : the HTML file, replaced in one step
    finding : the last step
    record : result.json
    pictures : PNG by name; a missing one is left out
    following : the next steps
    """
    stepped = len(explained.ladder) > 1
    farthest = farthest_shifts(explained.final.fit)
    hard, easy = (
        limit_table([e for e in record.limits if _is_hard_to_see(e) == is_hard], farthest=farthest)
        for is_hard in (True, False)
    )
    write_page(
        path,
        "explain.html",
        name=finding.name,
        f=finding,
        record=record,
        pictures=pictures,
        headline=words.headline(explained),
        following=following,
        detail=words.verdict_detail(explained, record.other_map),
        doubts=[*doubts.doubts(record, explained), *doubts.assumptions(explained, problem)],
        presses_alone=presses_sentences(record),
        steps=[_step(explained, problem, number) for number in words.steps_of(explained)],
        unreliable=words.unreliable(record),
        apart=bool(record.presses_apart),
        unseen=doubts.unseen_effects(record, explained),
        trust=[*doubts.limits_of_method(explained, record), *finding.limits],
        ladder=ladder_table(record.ladder),
        field_tables=field_tables(explained.final.fit, finding.origin_m, finding.scan),
        parameters=parameter_table(
            record.parameters,
            before=_first_values(finding, explained) if stepped else None,
            true=finding.true,
            unseen=record.unseen_shifts,
        ),
        candidates=candidate_table([c for c in record.candidates if c.verdict != "not_seen"]),
        not_seen=candidate_table([c for c in record.candidates if c.verdict == "not_seen"]),
        next_presses=_next_table(record.next_presses),
        limits=hard,
        seen_limits=easy,
        undetermined=undetermined(hard) or undetermined(easy),
        how=Table.of(("", ""), finding.how.items()),
    )


def _is_hard_to_see(limit: LimitRecord) -> bool:
    """Return True if an effect of the size for which shifts are stated would not be seen."""
    return limit.smallest_share is None or limit.smallest_share > limit.bias_at_share


def _first_values(finding: Finding, explained: Explanation) -> dict[str, ValueRecord]:
    """Return the estimates of the first step, positions in the scan's frame."""
    fit = explained.ladder[0].fit
    values = in_scan_frame(fit.values, finding.origin_m)
    return {n: ValueRecord(value=v, std=fit.std.get(n, 0.0)) for n, v in values.items()}


def _step(explained: Explanation, problem: Problem, number: int) -> _Step:
    names = added_names(explained.ladder[number - 1], explained.ladder[number])
    tables, titles = [], []
    for name in names:
        effect, accepted = explained.effect(name), kept(explained, name)
        if accepted is not None and len(accepted.candidates) > 1:
            tables.append(_refit_table(accepted))
        about = (
            ("Meaning", effect.summary),
            ("Signature", effect.gives_away),
            ("Formula", effect.formula),
            ("Source", effect.source),
            ("Remedy", effect.cure),
        )
        title = effect.title if len(names) > 1 else ""
        tables.append(Table.of(("", title), about))
        own = "" if name.replace("_", " ") in effect.title.lower() else f" ({name})"
        titles.append(f"{effect.title}{own}")
    return _Step(
        number,
        " and ".join(titles),
        words.step_evidence(explained, problem, number),
        bool(set(names) & set(explained.added)),
        tuple(words.step_notes(explained, number)),
        tuple(tables),
    )


def _refit_table(accepted: AcceptedEffect) -> Table:
    """Return the effects refitted at a step, the chosen one first."""
    chosen = accepted.candidates[0].criterion
    rows = (
        (
            candidate.name,
            f"{candidate.chi2:.0f}",
            "chosen" if place == 0 else f"{candidate.criterion - chosen:+.0f}",
            "as good" if candidate.name in accepted.equivalents[1:] else "",
        )
        for place, candidate in enumerate(accepted.candidates)
    )
    head = ("Chi-square", "BIC above the chosen", "")
    return Table.of(("Refitted with the map", *map(number, head)), rows)


def _next_table(presses: tuple[NextPressesRecord, ...]) -> Table:
    """Return the proposed scans, the one to make first on top."""
    rows = (
        (
            p.change,
            p.why,
            str(p.presses),
            units.duration(p.duration_s),
            "" if p.discrimination is None else f"{p.discrimination:.3g}",
            p.program,
        )
        for p in presses
    )
    head = ("Change", "Why", *map(number, ("Presses", "Time", "Expected chi-square")), "Program")
    return Table.of(head, rows)
