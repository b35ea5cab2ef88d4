"""A diagnosis on the console."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from identify.residual.statement import length
from identify.select.diagnosis import Diagnosis
from identify.select.step import Step

if TYPE_CHECKING:
    from rich.console import RenderableType

WORDS = {
    "supported": "supported",
    "not_seen": "not seen",
    "indistinguishable": "alike",
}


def diagnosis_table(record: Mapping[str, Any], step: Step) -> tuple["RenderableType", ...]:
    """Return the candidates, best first, as rich renderables that fit a screen."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    style = "green" if step.comparison.is_noise else "yellow"
    table = Table(box=box.SIMPLE, title="effects, by their score", title_justify="left")
    for name in ("effect", "", "share", "p", "alike"):
        table.add_column(name, justify="right" if name in ("share", "p") else "left")
    for c in record["candidates"]:
        if c["untestable"]:
            continue
        verdict = WORDS[c["verdict"]]
        colour = {"supported": "green", "alike": "yellow"}.get(verdict, "dim")
        # The share of what is left says nothing where noise may have made it
        share = f"{100 * c['explained_fraction']:.0f} %" if verdict != "not seen" else ""
        alike = ", ".join(c["confused_with"][:3])
        table.add_row(c["name"], Text(verdict, style=colour), share, f"{c['p_value']:.1g}", alike)
    lines: list[RenderableType] = [Text(step.comparison.statement, style=style), table]
    lines.extend(untestable_lines(record["candidates"]))
    best = best_evidence(record, step.diagnosis)
    if best:
        lines.append(Text(best))
    else:
        size = length(step.fit.rms_m, signed=False)
        lines.append(Text(f"No effect of the catalogue is seen (rms {size})."))
    return tuple(lines)


def untestable_lines(
    candidates: Sequence[Mapping[str, Any]], start: str = "Cannot be tested"
) -> tuple[str, ...]:
    """Return a sentence for each reason why effects cannot be tested on a scan.

    Examples
    --------
    >>> untestable_lines([{"name": "breathing", "untestable": "the scan has no time stamps"}])
    ('Cannot be tested, as the scan has no time stamps: breathing.',)
    """
    names: dict[str, list[str]] = {}
    for candidate in candidates:
        if candidate["untestable"]:
            names.setdefault(candidate["untestable"], []).append(candidate["name"])
    return tuple(f"{start}, as {why}: {', '.join(n)}." for why, n in names.items())


def best_evidence(record: Mapping[str, Any], diagnosis: Diagnosis) -> str:
    """Return the evidence of the best-scored effect, with what looks like it; empty for none."""
    best = diagnosis.scores[0] if diagnosis.scores else None
    if best is None or best.name not in diagnosis.significant:
        return ""
    candidate = next(c for c in record["candidates"] if c["name"] == best.name)
    alike = [n for n in candidate["confused_with"] if n in diagnosis.significant]
    candidates = f" ({', '.join(alike)} would look much the same: `palpmap explain` decides)"
    return f"Best: {best.name}. {candidate['evidence']}{candidates if alike else ''}"
