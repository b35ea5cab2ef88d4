"""A fit on one screen: parameters, residual and statement."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from identify.residual import Comparison, length, sigmas
from palpmap import units
from palpmap.console import plain
from palpmap.report.draw import console
from palpmap.result.field_tables import field_tables
from palpmap.result.finding import Finding
from palpmap.result.posterior_tables import posterior_table, posterior_words
from palpmap.result.tables import ANSWERS, Table, parameter_table

if TYPE_CHECKING:
    from rich.console import RenderableType


def summary(finding: Finding, following: Sequence[str] = ()) -> tuple["RenderableType", ...]:
    """Return the fit as rich renderables that fit one screen, the verdict on top.

    Parameters
    ----------
    following : the next steps, below the verdict
    """
    from rich.text import Text

    c = finding.comparison
    sure = c.is_noise and not finding.doubts
    statement = Text(c.statement, style="green" if sure else "yellow")
    doubts = (Text(doubt, style="yellow") for doubt in finding.doubts)
    title = f"{finding.name}: found map"
    parameters = parameter_table(finding.parameters, true=finding.true, title=title)
    notes = (Text(f"- {note}") for note in c.notes)
    free = map(console, field_tables(finding.fit, finding.origin_m, finding.scan))
    sampled = posterior_words(finding)
    samples = (console(posterior_table(finding)), *plain(sampled)) if sampled else ()
    found = (console(parameters), *free, *samples, console(_residual_table(c)))
    return statement, *doubts, *plain(following), *found, *notes


def _residual_table(c: Comparison) -> Table:
    asked = [t for t in c.tests if t.untestable is None]
    worst = (
        f"press {p.press} {length(p.mean_m)} ({sigmas(p, '.1f')} sigma)"
        for p in c.worst_presses[:3]
    )
    rows = (
        ("rms", f"{units.rms(c.rms_m)}, noise alone {units.rms(c.expected_rms_m)}"),
        (
            "chi-square per degree of freedom",
            f"{c.chi2_per_dof:.3f}, p-value {units.p_value(c.chi2_p)}",
        ),
        (
            f"tests that find structure (of {len(asked)})",
            ", ".join(ANSWERS[t.name] for t in asked if t.fires) or "none",
        ),
        ("largest misfits", "; ".join(worst)),
    )
    return Table.of(("", ""), rows, "residual")
