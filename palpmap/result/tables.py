"""The tables that show a result, made from its records; every face draws the same ones."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from identify.design import UndetectedBias
from identify.fit import FitResult
from palpmap import units
from palpmap.result.explain_words import CANDIDATES, step_labels, unreliable
from palpmap.result.records import (
    CandidateRecord,
    ExplainRecord,
    LimitRecord,
    ParameterRecord,
    StepRecord,
    ValueRecord,
)

Tone = Literal["", "good", "bad", "dim"]


@dataclass(frozen=True)
class Cell:
    """Text of a cell, and its tone: good, bad or of little weight."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Column:
    """Heading of a column; numbers are aligned to the right."""

    heading: str
    right: bool = False


@dataclass(frozen=True)
class Table:
    """Columns and rows of cells, drawn by `palpmap.report.draw`."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""

    @classmethod
    def of(
        cls, columns: Sequence[str | Column], rows: Iterable[Sequence[str | Cell]], title: str = ""
    ) -> "Table":
        """Return a table without the columns in which every cell is empty."""
        cells = [tuple(c if isinstance(c, Cell) else Cell(c) for c in row) for row in rows]
        heads = [c if isinstance(c, Column) else Column(c) for c in columns]
        kept = [i for i in range(len(heads)) if any(row[i].text for row in cells)]
        return cls(
            tuple(heads[i] for i in kept),
            tuple(tuple(row[i] for i in kept) for row in cells),
            title,
        )

    @property
    def has_head(self) -> bool:
        """False of a table of pairs, whose columns have no headings."""
        return any(column.heading for column in self.columns)


def number(heading: str) -> Column:
    """Return a column of numbers."""
    return Column(heading, right=True)


ANSWERS = {
    "size": "larger than the noise",
    "place": "follows the place",
    "force": "follows the force",
    "time": "follows the time in a press",
    "phase": "follows the phase",
    "order": "follows the order",
    "press": "an outlying press",
    "all_presses": "presses differ",
    "neighbours": "neighbours alike",
    "succession": "successors alike",
    "lag": "readings correlated",
    "reading": "an outlying reading",
}
"""Structure that each test of the residual finds, in words."""

_ORDER = tuple(CANDIDATES)
_TONES: Mapping[str, Tone] = {
    "supported": "good",
    "indistinguishable": "bad",
    "helps": "bad",
    "not_seen": "dim",
    "untestable": "dim",
}
_NOTHING_M = 5e-8  # rms below which the fitted effect is none
_MOSTLY = 0.5
_NORMAL_95 = 1.96


def parameter_table(
    found: Mapping[str, ParameterRecord],
    *,
    before: Mapping[str, ValueRecord] | None = None,
    true: Mapping[str, float] | None = None,
    unseen: Mapping[str, UndetectedBias] | None = None,
    title: str = "",
) -> Table:
    """Return parameters with their 95 % intervals, positions in the scan's frame.

    Parameters
    ----------
    before : estimates of an earlier model
    true : true values, shown with the distance of the estimates in their standard errors
    unseen : largest shift of each parameter by an effect that the scan does not show
    """
    before, true, unseen = before or {}, true or {}, unseen or {}

    def cells(name: str, p: ParameterRecord) -> tuple[str | Cell, ...]:
        was, truth, shift = before.get(name), true.get(name), unseen.get(name)
        return (
            units.plain_name(name),
            "" if was is None else units.with_error(was.value, was.std, p.unit),
            units.quantity(p.value, p.unit, _spread(p)),
            units.interval(p.lower95, p.upper95, p.unit) if p.std else "held",
            Cell("at its bound", "bad") if p.at_bound else "",
            "" if shift is None else f"{units.spread(shift.shift, p.unit)} ({shift.effect})",
            "" if truth is None else units.quantity(truth, p.unit),
            "" if was is None or truth is None else _off(was, truth),
            "" if truth is None else _off(p, truth),
        )

    found_now = "After" if before else "Found"
    head = (number("Before"), number(found_now), number("95 % interval"), number(""),
            "Unseen effect", number("True"), number("Off before"), number("Off"))  # fmt: skip
    rows = (cells(name, p) for name, p in found.items())
    return Table.of(("Parameter", *head), rows, title)


def _spread(p: ParameterRecord) -> float:
    """Return the standard error that an interval stands for; 0 of a fixed value."""
    return (p.upper95 - p.lower95) / (2 * _NORMAL_95) if p.std else 0.0


def _off(p: ValueRecord, true: float) -> str | Cell:
    """Return the distance to the truth, good inside the interval; empty of a fixed value."""
    if not p.std > 0:
        return ""
    if isinstance(p, ParameterRecord):
        inside = p.lower95 <= true <= p.upper95
    else:
        inside = abs(p.value - true) <= _NORMAL_95 * p.std
    return Cell(
        f"{round((p.value - true) / p.std, 1) + 0.0:+.1f} s.e.", "good" if inside else "bad"
    )


def explained_table(record: ExplainRecord) -> Table:
    """Return the parameters of an explanation's last model."""
    title = "found" if record.reliable else unreliable(record)
    if record.reliable and record.unknown:
        title = "found beside an unknown cause"
    if record.verdict == "ambiguous":
        title = "fitted with one of the equally good effects"
    return parameter_table(record.parameters, unseen=record.unseen_shifts, title=title)


def ladder_table(
    steps: Sequence[StepRecord], labels: Sequence[str] | None = None, title: str = ""
) -> Table:
    """Return errors and chi-square of every step; a step is named by its change."""
    labels = labels or step_labels([step.effects for step in steps])
    rows = (
        (
            label,
            units.rms(step.rms_m),
            units.rms(step.held_out_rms_m),
            "" if step.held_out_high_rms_m is None else units.rms(step.held_out_high_rms_m),
            units.rms(step.noise_rms_m),
            f"{step.chi2_per_dof:.3g}",
        )
        for label, step in zip(labels, steps, strict=True)
    )
    head = ("Error (rms)", "Cross-validation", "Forces left out", "Noise", "Chi2/dof")
    return Table.of(("Model", *map(number, head)), rows, title)


def candidate_table(candidates: Sequence[CandidateRecord], title: str = "") -> Table:
    """Return the verdict on every effect, the supported ones first, with its reason."""
    ordered = sorted(candidates, key=lambda c: (_ORDER.index(c.verdict), -c.score))
    rows = ((*_candidate_cells(c), _why(c)) for c in ordered)
    head = ("Effect", "Verdict", number("Explained share"), number("p-value"))
    return Table.of((*head, "Looks like", "Evidence"), rows, title)


def score_table(candidates: Sequence[CandidateRecord], title: str = "") -> Table:
    """Return the verdict on every effect that can be tested, in the given order."""
    rows = [_candidate_cells(c, most=3) for c in candidates if c.untestable is None]
    head = ("Effect", "Verdict", number("Share"), number("p-value"), "Looks like")
    return Table.of(head, rows, title)


def _candidate_cells(c: CandidateRecord, most: int | None = None) -> tuple[str | Cell, ...]:
    tested = c.untestable is None
    return (
        c.name,
        Cell(CANDIDATES[c.verdict], _TONES[c.verdict]),
        units.percent(c.explained_fraction) if tested else "",
        units.p_value(c.p_value) if tested else "",
        ", ".join(c.confused_with[:most]) if tested else "",
    )


def _why(c: CandidateRecord) -> str:
    """Return the evidence; of an effect that is not seen its size, as the values are noise."""
    if c.verdict != "not_seen":
        return c.evidence
    if c.rms_m < _NOTHING_M:
        return "No more than noise: its best fit is none."
    text = f"No more than noise (at best {units.rms(c.rms_m)} rms"
    if c.visible < _MOSTLY:
        text += f", of which the map can imitate all but {units.percent(c.visible)}"
    return f"{text})."


def verdict_table(candidates: Sequence[CandidateRecord], title: str = "") -> Table:
    """Return the names of the effects by verdict."""
    rows = (
        (Cell(CANDIDATES[verdict], _TONES[verdict]), ", ".join(names))
        for verdict in _ORDER
        if (names := [c.name for c in candidates if c.verdict == verdict])
    )
    return Table.of(("Verdict", "Effects"), rows, title)


FAR = 10  # times a modulus: no shift in proportion goes so far


@dataclass(frozen=True)
class ShiftColumn:
    """Column of a table of limits: the shift of a parameter by an ignored effect.

    Attributes
    ----------
    text : of a shift in SI units
    most : largest shift that is determined, in SI units; see `farthest_shifts`
    """

    name: str
    heading: str
    text: Callable[[float], str]
    most: float = math.inf

    @classmethod
    def of(cls, name: str, most: float = math.inf) -> "ShiftColumn":
        """Return the column of a parameter of the map, in kPa or mm."""
        unit = units.unit_of(name)
        heading = f"{units.plain_name(name)}, {units.scale(unit)[1]}"
        return cls(name, heading, lambda value: units.shift(value, unit), most)

    def shown(self, value: float) -> str:
        """Return the text of a shift, "-" if it is not determined."""
        return self.text(value) if abs(value) <= self.most else "-"


def farthest_shifts(fit: FitResult) -> dict[str, float]:
    """Return by parameter of the map the largest shift that is determined, in its unit.

    The part of the body where a place is sought, and many times a modulus.
    """
    return {
        p.name: p.upper - p.lower if p.name.endswith("_m") else FAR * abs(fit.values[p.name])
        for p in fit.model.space.parameters
        if p.name in fit.values
    }


def undetermined(table: Table) -> str:
    """Return the meaning of "-" below a table of limits in which it stands, else nothing."""
    if not any(cell.text == "-" for row in table.rows for cell in row):
        return ""
    return f"-: not determined (a shift beyond the body, or over {FAR} times the value)."


def limit_table(
    limits: Sequence[LimitRecord],
    shifts: Sequence[ShiftColumn] | None = None,
    letters: Mapping[str, str] | None = None,
    title: str = "",
    farthest: Mapping[str, float] | None = None,
) -> Table:
    """Return the detection limit of every effect, and its shift of the map if it is ignored.

    Parameters
    ----------
    shifts : columns of the shifts, None for all parameters of the map
    letters : letter of each planned scan by its program
    farthest : see `farthest_shifts`, where no columns are given
    """
    if shifts is None:
        names = dict.fromkeys(n for e in limits for n in e.map_bias if units.is_of_map(n))
        shifts = [ShiftColumn.of(name, (farthest or {}).get(name, math.inf)) for name in names]
    rows = (
        (
            e.name,
            _seen_from(e.smallest_share),
            *(c.shown(e.map_bias[c.name]) if c.name in e.map_bias else "" for c in shifts),
            _better(e, letters or {}),
            "" if e.in_mixed_scan is None else units.percent(e.in_mixed_scan),
            e.untestable or ", ".join(e.confused_with),
        )
        for e in limits
    )
    head = ("Seen from", *(c.heading for c in shifts), "Better scan", "Mixed scan")
    return Table.of(("Effect", *map(number, head), "Looks like"), rows, title)


def _seen_from(share: float | None) -> str:
    """Return a detection limit; beyond the whole signal its size means nothing.

    >>> [_seen_from(share) for share in (None, 0.012, 1.2)]
    ['never', '1.2 %', 'over 100 %']
    """
    if share is None:
        return "never"
    return units.percent(share) if share <= 1 else f"over {units.percent(1.0)}"


def _better(limit: LimitRecord, letters: Mapping[str, str]) -> str:
    scan = limit.better_scan
    return "" if scan is None else f"{units.percent(scan.smallest_share)} {letters[scan.program]}"
