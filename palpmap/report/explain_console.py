"""An explanation on one screen: the error that falls, what was found, what it rests on."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from identify.residual.statement import length
from identify.select.forward_selection import Explanation
from identify.select.step import Step
from palpmap.result.evidence import added_names
from palpmap.result.explain_words import (
    VERDICTS,
    headline,
    interval,
    readable,
    rung_labels,
    stated_lengths,
    step_evidence,
    steps_of,
    unseen_effects,
    unseen_inclusions,
    unseen_shift,
    verdict_detail,
    without_suspects,
)
from palpmap.result.presses_words import presses_sentences
from palpmap.study.open_study import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDTH = 30

_FITTED = {
    "unexplained": "fitted, but not all is explained",
    "ambiguous": "fitted with one of what cannot be told apart",
}


def step_line(rung: Step) -> str:
    """Return one line: the effects, the error and its bar, chi-square per degree of freedom."""
    noise = rung.comparison.expected_rms_m
    bar = "█" * min(round(_WIDTH / 4 * rung.fit.rms_m / noise), _WIDTH)
    what = "+ " + rung.fit.effect_names[-1] if rung.fit.effect_names else "map alone"
    return (
        f"  {what:<22} {length(rung.fit.rms_m, signed=False):>9}  {bar}  "
        f"chi2/dof {rung.fit.chi2_per_dof:.3g}"
    )


def explain_summary(
    record: Mapping[str, Any], explained: Explanation, problem: Problem
) -> tuple["RenderableType", ...]:
    """Return the explanation as rich renderables that fit one screen."""
    from rich.text import Text

    sentence, style = headline(explained), VERDICTS[explained.verdict][1]
    lines: list[RenderableType] = [_ladder_table(explained)]
    lines.append(Text(f"{sentence} {verdict_detail(explained)}".strip(), style=f"bold {style}"))
    if explained.verdict != "unexplained" or explained.added:
        for number in steps_of(explained):
            names = added_names(explained.ladder[number - 1], explained.ladder[number])
            if set(names) & set(explained.final.fit.effect_names):
                titles = " and ".join(problem.catalogue[name].title for name in names)
                lines.append(Text(f"- {titles}: {step_evidence(explained, problem, number)}"))
    lines.extend(Text(f"- {says}") for says in presses_sentences(record))
    lines.append(_parameter_table(record))
    if unseen := unseen_effects(record):
        lines.append(Text(f"- {unseen}"))
    held = [name for name, p in record["parameters"].items() if p["at_bound"]]
    if held:
        lines.append(Text(f"At a bound, so not found: {', '.join(held)}", style="yellow"))
    lines.extend(Text(f"- {note}") for note in explained.final.comparison.notes)
    lines.extend(Text(says, style="yellow") for says in stated_lengths(record))
    if unseen := unseen_inclusions(record):
        lines.append(Text(unseen, style="yellow"))
    if record["suspects_left"]:
        presses = ", ".join(map(str, record["suspects_left"]))
        text = f"Presses that stand out by themselves: {presses}. {without_suspects(record)}"
        lines.append(Text(text.strip(), style="yellow"))
    return tuple(lines)


def _ladder_table(explained: Explanation) -> "RenderableType":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, title="the error", title_justify="left")
    for name in ("model", "rms", "cross-validation", "noise alone", "chi2/dof"):
        table.add_column(name, justify="left" if name == "model" else "right")
    for label, rung in zip(rung_labels(explained), explained.ladder, strict=True):
        table.add_row(
            label.replace("\n", ", "),
            length(rung.fit.rms_m, signed=False),
            length(rung.cross_validation.rms_m, signed=False),
            length(rung.comparison.expected_rms_m, signed=False),
            f"{rung.fit.chi2_per_dof:.3g}",
        )
    return table


def _parameter_table(record: Mapping[str, Any]) -> "RenderableType":
    from rich import box
    from rich.table import Table

    title = _FITTED.get(record["verdict"], "found")
    table = Table(
        box=box.SIMPLE, title=title, title_justify="left", pad_edge=False, padding=(0, 1, 0, 0)
    )
    table.add_column("parameter", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("95 % interval", justify="right", no_wrap=True)
    told = bool(record.get("unseen_shifts"))
    if told:
        table.add_column("unseen effect", justify="right", no_wrap=True)
    for name, p in record["parameters"].items():
        scale, unit = readable(p["unit"])
        value = f"{scale * p['value']:.4g}{unit}"
        unseen = [unseen_shift(name, record)] if told else []
        table.add_row(name, value, interval(p), *unseen)
    return table
