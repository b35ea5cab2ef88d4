"""The words in the recording of an explanation: candidates of a step, and what is seen."""

from collections.abc import Mapping
from typing import Any

from identify.select.forward_selection import Explanation
from identify.select.step import Step
from palpmap.recording import entities as parts
from palpmap.recording.explain_layout import PRESSES
from palpmap.result.explain_words import (
    headline,
    interval,
    readable,
    unseen_effects,
    unseen_shift,
    verdict_detail,
)

_SHOWN = 12  # candidates in the table of a rung
_NOISE = 25.0  # a score that noise hardly gives: the longest bar is not shorter
_BAR = 16


def candidates_text(rung: Step) -> str:
    """Return the scores of a rung as a table with bars, Markdown."""
    scores = [s for s in rung.diagnosis.scores if s.untestable is None][:_SHOWN]
    most = max([s.statistic for s in scores] + [_NOISE])
    lines = [
        "Decrease of chi-square that each effect promises from here, and the chance of as much "
        "under pure noise (a search over places or times paid for).",
        "",
        "| effect | score | | chance | |",
        "|---|---|---|---|---|",
    ]
    for s in scores:
        bar = "■" * round(_BAR * s.statistic / most)
        seen = "beyond noise" if s.name in rung.diagnosis.significant else ""
        lines.append(f"| {s.name} | {s.statistic:.1f} | {bar} | {s.p_value:.2g} | {seen} |")
    return "\n".join(lines)


def about_text(name: str, explained: Explanation, record: Mapping[str, Any]) -> str:
    """Return what is seen and what was found, Markdown."""
    lines = [
        f"### {name}",
        "",
        f"**{headline(explained)}** {verdict_detail(explained)}",
        "",
        f"**Timelines** (choose below): `{parts.ITERATION}` goes up the ladder, 0 is the model "
        f"that the search started from, each further step has one effect more; "
        f"`{parts.SIM_TIME}` has the presses, then the steps, one second each; `{parts.PRESS}` "
        f"has each press, and all steps at the last. Presses are in the tab *{PRESSES}*, which "
        f"is empty on `{parts.ITERATION}`.",
        "",
        "**Residual**: measured minus modelled displacement, mean of each press; red gave way "
        "more than modelled, blue less. **Size**: rms over the readings of a press in units of "
        "the noise; dark is noise. Left: the model that the search started from; right: the "
        "model of the step, on the same scale. **Found**: coloured on the scale of the last map; "
        "what is beyond it has the colour of its end.",
        "",
    ]
    unseen = unseen_effects(record)
    lines += [unseen, ""] if unseen else []
    lines += [f"| parameter | value | 95 % interval |{' unseen effect |' if unseen else ''}"]
    lines += ["|---|---|---|" + ("---|" if unseen else "")]
    for parameter, p in record["parameters"].items():
        scale, unit = readable(p["unit"])
        bound = " (at its bound)" if p["at_bound"] else ""
        value = f"{scale * p['value']:.4g}{unit}{bound}"
        further = f" {unseen_shift(parameter, record)} |" if unseen else ""
        lines.append(f"| {parameter} | {value} | {interval(p)} |{further}")
    return "\n".join(lines)
