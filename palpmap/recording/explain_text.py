"""The words in the recording of an explanation: candidates of a step, and result."""

from collections.abc import Sequence

from identify.select import Explanation, Step
from palpmap import units
from palpmap.recording import entities as parts
from palpmap.recording.explain_layout import PRESSES
from palpmap.report.draw import markdown
from palpmap.result.doubts import doubts, unseen_effects
from palpmap.result.explain_words import headline, verdict_detail
from palpmap.result.records import ExplainRecord
from palpmap.result.tables import Table, explained_table, ladder_table, number, verdict_table

_SHOWN = 12  # candidates in the table of a step
_NOISE = 25.0  # a score that noise hardly reaches: the longest bar is not shorter
_BAR = 16


def candidates_text(step: Step) -> str:
    """Return the scores of a step as a table with bars, Markdown."""
    scores = [s for s in step.diagnosis.scores if s.untestable is None][:_SHOWN]
    most = max([s.statistic for s in scores] + [_NOISE])
    rows = (
        (
            s.name,
            f"{s.statistic:.1f}",
            "■" * round(_BAR * s.statistic / most),
            units.p_value(s.p_value),
            "significant" if s.name in step.diagnosis.significant else "",
        )
        for s in scores
    )
    table = Table.of(("effect", number("score"), "", number("p-value"), ""), rows)
    return (
        "Score: decrease of chi-square that each effect promises from here. The p-value accounts "
        f"for a search over places or times.\n\n{markdown(table)}"
    )


def about_text(
    name: str, explained: Explanation, record: ExplainRecord, following: Sequence[str] = ()
) -> str:
    """Return verdict, next steps, error, evidence and legend, Markdown."""
    blocks = [
        f"### {name}",
        f"**{headline(explained)}** {verdict_detail(explained, record.other_map)}",
        *following,
        markdown(ladder_table(record.ladder)),
        markdown(explained_table(record)),
        unseen_effects(record, explained),
        markdown(verdict_table(record.candidates)),
        "\n".join(f"- {doubt}" for doubt in doubts(record, explained)),
        f"**Timelines** (choose below): `{parts.ITERATION}` goes up the ladder, 0 is the model "
        f"that the search started from, each further step has one effect more; "
        f"`{parts.SIM_TIME}` has the presses, then the steps, one second each; `{parts.PRESS}` "
        f"has each press, and all steps at the last. Presses are in the tab *{PRESSES}*, which "
        f"is empty on `{parts.ITERATION}`.",
        "**Residual**: measured minus modelled displacement, mean of each press; red gave way "
        "more than modelled, blue less. **Size**: rms over the readings of a press in units of "
        "the noise; dark is noise. Left: the model that the search started from; right: the "
        "model of the step, on the same scale. **Found**: coloured on the scale of the last map; "
        "values beyond it have the colour of its end.",
    ]
    return "\n\n".join(block for block in blocks if block)
