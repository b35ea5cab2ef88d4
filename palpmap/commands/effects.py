"""The catalogue of effects for a reader: a table of all, one page of each, findings of the kit."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from identify.effects import Effect, EffectParameter
from identify.effects.conformance import CheckResult

if TYPE_CHECKING:
    from rich.table import Table


def effect_record(effect: Effect) -> dict[str, object]:
    """Return all that an effect says of itself, as JSON."""
    return {
        "name": effect.name,
        "title": effect.title,
        "family": effect.family,
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
    for effect in effects:
        table.add_row(effect.name, effect.link, effect.gives_away)
    return table


def effect_page(effect: Effect, latex: bool = False) -> str:
    """Return an effect's page in Markdown, its formula as LaTeX or in plain text."""
    formula = f"    {effect.formula}"
    if latex and effect.latex:
        formula = f"$$\n{effect.latex}\n$$"
    said = [
        f"**Acts in** the {effect.link}.",
        f"**How it shows.** {_sentence(effect.gives_away)}",
        f"**Cure.** {_sentence(effect.cure)}",
    ]
    if effect.needs:
        said.append(f"**Needs** a scan with {', '.join(effect.needs)}.")
    if effect.family != effect.name:
        said.append(f"**Another form of** {effect.family}.")
    if effect.contains:
        said.append(f"**Contains** {', '.join(effect.contains)}, as a special case.")
    said.append(f"**Source.** {_sentence(effect.source)}")
    rows = [
        "| parameter | unit | meaning | absent at | typical | bounds |",
        "|---|---|---|---|---|---|",
    ]
    rows += [_parameter_row(parameter) for parameter in effect.parameters]
    parts = [
        f"# {effect.title}",
        f"`{effect.name}`: {effect.summary}",
        formula,
        *said,
        "## Parameters",
        "\n".join(rows),
        "## Worked example",
        *(f"`{_values(effect, example.values)}`. {example.says}" for example in effect.examples),
    ]
    return "\n\n".join(parts) + "\n"


def findings_table(
    findings: Sequence[CheckResult], not_made: Sequence[CheckResult] = ()
) -> "Table":
    """Return a table of the conformance kit's findings; of checks not made it says only why."""
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


def _parameter_row(p: EffectParameter) -> str:
    unit = "" if p.unit == "1" else p.unit
    absent = "" if p.null is None else f"{p.null:g}"
    return (
        f"| `{p.name}` | {unit} | {p.meaning} | {absent} | {p.typical:.3g} "
        f"| {p.lower:.3g} to {p.upper:.3g} |"
    )


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def _values(effect: Effect, values: Any) -> str:
    units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in effect.parameters}
    return ", ".join(f"{name} = {value:g}{units[name]}" for name, value in values.items())
