"""A finding on one screen: found map, residual and verdict."""

from typing import TYPE_CHECKING

from identify.residual.comparison import Comparison
from identify.residual.statement import length, sigmas
from palpmap.report.fit_report import parameter_rows
from palpmap.result.finding import Finding

if TYPE_CHECKING:
    from rich.console import RenderableType


def summary(finding: Finding) -> tuple["RenderableType", ...]:
    """Return the finding as rich renderables that fit one screen."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    c = finding.comparison
    found = Table(box=box.SIMPLE, title=Text(f"{finding.name}: found map"), title_justify="left")
    known = finding.truth is not None
    for name in ("parameter", "found", "95 % interval", *(("true", "") if known else ())):
        found.add_column(name, justify="left" if name == "parameter" else "right")
    for name, value, interval, true, inside in parameter_rows(finding):
        mark = {True: "inside", False: "outside", None: ""}[inside]
        found.add_row(*map(Text, (name, value, interval, *((true, mark) if known else ()))))
    verdict = Text(c.statement, style="green" if c.is_noise else "yellow")
    return found, _residual_table(c), verdict, *(Text(f"- {note}") for note in c.notes)


def _residual_table(c: Comparison) -> "RenderableType":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, show_header=False, title="residual", title_justify="left")
    rms, noise = length(c.rms_m, signed=False), length(c.expected_rms_m, signed=False)
    table.add_row("rms", f"{rms}, noise alone {noise}")
    table.add_row("chi-square per degree of freedom", f"{c.chi2_per_dof:.3f}, p = {c.chi2_p:.2g}")
    asked = [t for t in c.tests if t.untestable is None]
    fires = [t.name for t in asked if t.fires]
    said = ", ".join(fires) if fires else "none"
    table.add_row(f"questions that find structure (of {len(asked)})", said)
    worst = "; ".join(
        f"press {p.press} {length(p.mean_m)} ({sigmas(p, '.1f')} sigma)"
        for p in c.worst_presses[:3]
    )
    table.add_row("largest misfits", worst)
    return table
