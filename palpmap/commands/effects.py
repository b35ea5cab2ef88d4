"""The catalogue of effects for a reader: a table of all, one page of each, findings of the kit."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from identify.effects.base import Effect, EffectParameter
from identify.effects.conformance.kit import CheckResult

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

_PAGE = 80  # characters; a wider page is hard to read


def effect_record(effect: Effect) -> dict[str, Any]:
    """Return all that an effect says of itself, as JSON."""
    return {
        "name": effect.name,
        "title": effect.title,
        "link": effect.link,
        "summary": effect.summary,
        "formula": effect.formula,
        "source": effect.source,
        "gives_away": effect.gives_away,
        "cure": effect.cure,
        "needs": list(effect.needs),
        "contains": list(effect.contains),
        "parameters": [asdict(parameter) for parameter in effect.parameters],
        "examples": [
            {"says": e.says, "values": dict(e.values), "expected": dict(e.expected)}
            for e in effect.examples
        ],
    }


def catalogue_table(effects: Sequence[Effect]) -> "Table":
    """Return a table of effects, one row each, in the order of the chain."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, pad_edge=False, show_lines=False)
    table.add_column("effect", no_wrap=True)
    table.add_column("acts in", no_wrap=True)
    table.add_column("what gives it away", ratio=1)
    table.add_column("parameters", no_wrap=True)
    for effect in effects:
        names = "\n".join(p.name for p in effect.parameters)
        table.add_row(effect.name, effect.link, effect.gives_away, names)
    return table


def effect_page(effect: Effect) -> "Iterator[RenderableType]":
    """Yield the parts of an effect's page."""
    from rich.text import Text

    yield Text(f"{effect.title} ({effect.name})", style="bold")
    yield ""
    yield _paragraph("", effect.summary)
    yield ""
    yield _paragraph("acts in     ", f"the {effect.link}: {effect.formula}")
    yield _paragraph("gives away  ", f"{effect.gives_away}")
    yield _paragraph("cure        ", effect.cure)
    if effect.needs:
        yield _paragraph("needs       ", f"a scan with {', '.join(effect.needs)}")
    if effect.contains:
        yield _paragraph("contains    ", f"{', '.join(effect.contains)}, as a special case")
    yield _paragraph("source      ", effect.source)
    yield _parameter_table(effect.parameters)
    for example in effect.examples:
        yield _paragraph("example     ", f"{_values(effect, example.values)}. {example.says}")


def findings_table(
    findings: Sequence[CheckResult], not_made: Sequence[CheckResult] = ()
) -> "Table":
    """Return a table of what the conformance kit found; of checks not made it says only why."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
    for column in ("", "check"):
        table.add_column(column, no_wrap=True)
    table.add_column("found", ratio=1)
    for finding in findings:
        mark = Text("ok") if finding.passed else Text("FAULT", style="bold red")
        mark = Text("-") if finding in not_made else mark
        table.add_row(mark, Text(finding.check), Text(finding.says))
    return table


def _paragraph(label: str, text: str) -> "RenderableType":
    """Wrap text beside its label."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid()
    grid.add_column(no_wrap=True, style="dim")
    grid.add_column(width=_PAGE - len(label))
    grid.add_row(Text(label), Text(text))
    return grid


def _parameter_table(parameters: Sequence[EffectParameter]) -> "Table":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, pad_edge=False)
    table.add_column("parameter", no_wrap=True)
    for column in ("unit", "absent at", "typical", "bounds"):
        table.add_column(column, no_wrap=True, justify="left")
    table.add_column("meaning")
    for p in parameters:
        absent = "-" if p.null is None else f"{p.null:g}"
        bounds = f"{p.lower:.3g} to {p.upper:.3g}"
        table.add_row(p.name, p.unit, absent, f"{p.typical:.3g}", bounds, p.meaning)
    return table


def _values(effect: Effect, values: Any) -> str:
    units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in effect.parameters}
    return ", ".join(f"{name} = {value:g}{units[name]}" for name, value in values.items())
