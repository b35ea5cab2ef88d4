"""The tables that show a result: typed rows, and the one table that every face draws from them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from identify.design.undetected_bias import UndetectedBias
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.select.step import Step
from palpmap import units
from palpmap.result.truth import matched
from palpmap.study.frame import frame_shift_m

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


@dataclass(frozen=True)
class ParameterRow:
    """One parameter, positions in the scan's frame.

    Attributes
    ----------
    name, unit, value, std : std 0 of a parameter that was held
    lower95, upper95 : ends of the 95 % interval
    at_bound : the estimate lies at a bound of what is allowed
    before, before_std : estimate of an earlier model, None where it had no such parameter
    true : None where it is not known
    unseen : largest shift by an effect that the scan does not show
    """

    name: str
    unit: str
    value: float
    std: float
    lower95: float
    upper95: float
    at_bound: bool = False
    before: float | None = None
    before_std: float = 0.0
    true: float | None = None
    unseen: UndetectedBias | None = None

    @property
    def off(self) -> float | None:
        """Distance to the truth in standard errors."""
        return _off(self.value, self.std, self.true)

    @property
    def off_before(self) -> float | None:
        """Distance of the earlier estimate to the truth in its own standard errors."""
        return _off(self.before, self.before_std, self.true)

    @property
    def inside(self) -> bool | None:
        """Whether the truth lies in the interval; None where it is not known, or held."""
        return None if self.off is None else self.lower95 <= float(self.true or 0) <= self.upper95


def _off(value: float | None, std: float, true: float | None) -> float | None:
    return None if value is None or true is None or not std > 0 else (value - true) / std


def parameter_rows(
    fit: FitResult,
    origin_m: np.ndarray,
    *,
    truth: GaussianMap | None = None,
    before: FitResult | None = None,
    at_bound: Sequence[str] = (),
    unseen: Mapping[str, UndetectedBias] | None = None,
) -> tuple[ParameterRow, ...]:
    """Return the parameters of a fit, those of the map first.

    Parameters
    ----------
    origin_m : (3,) origin of the body's frame in the scan's frame, m
    truth : the true map
    before : fit of an earlier model
    at_bound : names of the parameters at a bound
    unseen : largest shift of each parameter by an effect that the scan does not show
    """
    true = {} if truth is None else matched(fit.map, truth)
    earlier = {} if before is None else before.values
    errors = {} if before is None else before.std
    rows = []
    for name, entry in fit.parameters.items():
        moved = frame_shift_m(name, origin_m)
        rows.append(
            ParameterRow(
                name,
                entry.unit,
                entry.value + moved,
                entry.std if entry.free else 0.0,
                entry.lower95 + moved,
                entry.upper95 + moved,
                at_bound=name in at_bound,
                before=earlier[name] + moved if name in earlier else None,
                before_std=errors.get(name, 0.0),
                true=true[name] + moved if name in true else None,
                unseen=(unseen or {}).get(name),
            )
        )
    return tuple(rows)


def parameter_table(rows: Sequence[ParameterRow], title: str = "") -> Table:
    """Return the parameters: value, interval, and what else is known of them."""
    now = "After" if any(row.before is not None for row in rows) else "Found"
    head = ("Before", now, "95 % interval", "Unseen effect", "True", "Off before", "Off")
    cells = (_parameter_cells(row) for row in rows)
    return Table.of(("Parameter", *map(number, head)), cells, title)


def _parameter_cells(row: ParameterRow) -> tuple[str | Cell, ...]:
    unit, unseen = row.unit, row.unseen
    interval = units.interval(row.lower95, row.upper95, unit) if row.std else "held"
    return (
        units.plain_name(row.name),
        "" if row.before is None else units.with_error(row.before, row.before_std, unit),
        units.quantity(row.value, unit),
        Cell(f"{interval}, at its bound", "bad") if row.at_bound else interval,
        f"{units.spread(unseen.shift, unit)} ({unseen.effect})" if unseen else "",
        "" if row.true is None else units.quantity(row.true, unit),
        _off_cell(row.off_before, row.off_before is not None and abs(row.off_before) <= 1.96),
        _off_cell(row.off, bool(row.inside)),
    )


def _off_cell(off: float | None, inside: bool) -> str | Cell:
    return "" if off is None else Cell(f"{off:+.1f} s.e.", "good" if inside else "bad")


@dataclass(frozen=True)
class LadderRow:
    """One step of the ladder: its errors in m, rms, and chi-square per degree of freedom.

    `high_m` is the error at forces left out, None where there are too few.
    """

    label: str
    rms_m: float
    cross_validation_m: float
    high_m: float | None
    noise_m: float
    chi2_per_dof: float

    @classmethod
    def of(cls, label: str, step: Step) -> "LadderRow":
        """Return the row of a step."""
        return cls(
            label, step.fit.rms_m, step.cross_validation.rms_m, step.cross_validation.high_rms_m,
            step.comparison.expected_rms_m, step.fit.chi2_per_dof,
        )  # fmt: skip


def ladder_table(rows: Sequence[LadderRow], title: str = "") -> Table:
    """Return the errors and chi-square of every step."""
    head = ("Error (rms)", "Cross-validation", "Forces left out", "Noise", "Chi2/dof")
    cells = (
        (
            row.label,
            units.rms(row.rms_m),
            units.rms(row.cross_validation_m),
            "" if row.high_m is None else units.rms(row.high_m),
            units.rms(row.noise_m),
            f"{row.chi2_per_dof:.3g}",
        )
        for row in rows
    )
    return Table.of(("Model", *map(number, head)), cells, title)
