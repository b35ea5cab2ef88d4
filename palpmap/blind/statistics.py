"""Results of a tournament of blind trials: rates, what was named for what, coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from palpmap.blind.records import CoverageRecord, RatesRecord, TournamentRecord, TrialLine

if TYPE_CHECKING:
    from rich.table import Table

OUTCOMES = ("right", "honest", "missed", "wrong")


def tally(lines: Sequence[TrialLine]) -> str:
    """Return a few words of how it stands."""
    counts = Counter(line.outcome for line in lines)
    text = ", ".join(f"{counts[outcome]} {outcome}" for outcome in OUTCOMES)
    failed = sum(line.error is not None for line in lines)
    return text + (f", {failed} failed" if failed else "")


def tournament_record(lines: Sequence[TrialLine]) -> TournamentRecord:
    """Return rates by category and by hidden effect, and the confusions."""
    judged = [line for line in lines if line.error is None]
    confusion: dict[str, Counter[str]] = {}
    for line in judged:
        confusion.setdefault(_hidden(line), Counter())[_found(line)] += 1
    return TournamentRecord(
        trials=len(lines),
        failed=len(lines) - len(judged),
        errors=tuple(sorted({line.error for line in lines if line.error is not None})),
        passed=sum(line.passed for line in judged),
        wrong=sum(line.outcome == "wrong" for line in judged),
        categories=_rates(judged, lambda line: line.category),
        effects=_rates(judged, _hidden),
        confusion=confusion,
        coverage=_coverage(judged),
    )


def _coverage(lines: Sequence[TrialLine]) -> dict[str, CoverageRecord]:
    """Return how often a 95 % interval held the truth, where the right answer was given."""
    inside: dict[str, list[bool]] = {}
    for line in lines:
        if line.outcome == "right" and line.verdict in ("explained", "nothing_missing"):
            for row in line.map:
                if row.inside is not None:
                    inside.setdefault(row.name, []).append(row.inside)
    return {
        name: CoverageRecord(intervals=len(held), held=sum(held)) for name, held in inside.items()
    }


def _hidden(line: TrialLine) -> str:
    return "+".join(line.hidden) or "none"


def _found(line: TrialLine) -> str:
    if line.added:
        ended = "" if line.verdict == "explained" else f" ({line.verdict})"
        return "+".join(line.added) + ended
    if line.ambiguous:
        return "one of " + ", ".join(line.ambiguous[0])
    return str(line.verdict)


def _rates(lines: Sequence[TrialLine], key: Callable[[TrialLine], str]) -> dict[str, RatesRecord]:
    kinds: dict[str, list[TrialLine]] = {}
    for line in sorted(lines, key=key):
        kinds.setdefault(key(line), []).append(line)
    return {
        kind: RatesRecord(
            trials=len(own),
            passed=sum(line.passed for line in own),
            **Counter(line.outcome for line in own if line.outcome is not None),
        )
        for kind, own in kinds.items()
    }


def tournament_screen(record: TournamentRecord) -> list[Table | str]:
    """Return tables: rates by category, then what was named for what."""
    from rich import box
    from rich.table import Table

    rates = Table("category", "trials", "passed", *OUTCOMES, box=box.SIMPLE)
    for name, row in record.categories.items():
        share = f"{row.passed} ({100 * row.passed / row.trials:.0f} %)"
        counts = (str(getattr(row, outcome)) for outcome in OUTCOMES)
        rates.add_row(name, str(row.trials), share, *counts)
    confusion = Table("hidden", "found", "times", box=box.SIMPLE)
    for hidden in sorted(record.confusion):
        ordered = sorted(record.confusion[hidden].items(), key=lambda pair: -pair[1])
        for i, (found, times) in enumerate(ordered):
            confusion.add_row(hidden if i == 0 else "", found, str(times))
    last = f"{record.passed} of {record.trials} passed, {record.wrong} wrong"
    if record.failed:
        last += f", {record.failed} failed: {record.errors[0]}"
    if record.coverage:
        held = sum(count.held for count in record.coverage.values())
        intervals = sum(count.intervals for count in record.coverage.values())
        last += f"; 95 % intervals of the map held the truth {held} of {intervals} times"
    return [confusion, rates, last]
