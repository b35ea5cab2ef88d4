"""The report of `palpmap explain`: the error that falls first, then what each step rests on.

Its words are no more certain than result.json (`palpmap.result.explain_words`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from identify.effects.units import percent
from identify.select.forward_selection import Explanation
from palpmap.report.draw import write_page
from palpmap.report.explain_tables import (
    candidate_table,
    detection_table,
    ladder_table,
    next_press_table,
    parameter_table,
    rival_table,
)
from palpmap.report.html import listing, paragraph, picture, section, table
from palpmap.result.evidence import added_names, kept
from palpmap.result.explain_words import (
    doubts,
    headline,
    limits_of_method,
    step_evidence,
    step_notes,
    steps_of,
    unseen_effects,
    verdict_detail,
)
from palpmap.result.finding import Finding
from palpmap.result.presses_words import presses_sentences
from palpmap.study.open_study import Problem

CAPTIONS = {
    "ladder": (
        "The error of the model, and the error at readings that the fit did not see, at every "
        "step. On the dashed line only the noise is left."
    ),
    "residuals": (
        "Measured less modelled displacement of each press, painted where it was made; one colour "
        "scale for all steps. Above: its mean. Below: its size over all readings of the press, in "
        "units of the noise, which also shows what averages out in the mean; pale is noise."
    ),
    "evidence": (
        "Dots: the residual of the step before, averaged in bins, with one standard error. Line: "
        "what the model says more with the effect than without, all parameters fitted anew. "
        "Crosses: what is left. The two axes are those along which the effect shows best."
    ),
    "maps": (
        "Young's modulus, cut through the strongest inclusion. Circles: inclusions of the map, one "
        "radius around the centre; dashed: the true ones, where they are known."
    ),
    "parameters": (
        "The map's parameters with their 95 % intervals, step by step; dashed: the truth, where it "
        "is known. Grey: 1.96 standard errors of the models before. Blue: the intervals of the "
        "table below; pale: how much further an effect that this scan does not show may have moved "
        "them."
    ),
    "presses": "Single presses: readings, and the model before and after.",
    "confusion": (
        "How alike two effects look in this very scan once the map has taken its share: 100 x "
        "|cosine| between their patterns (0: nothing in common, 100: the same). Framed: more than "
        "90, where only a refit, or another scan, can decide."
    ),
    "residual_along": (
        "What the last model leaves: mean residual with one standard error; grey: where 95 % of "
        "pure noise lies."
    ),
    "residual_tests": (
        "Left: residuals of the last model in units of the noise. Right: the questions asked of "
        "them."
    ),
}


@dataclass(frozen=True)
class Told:
    """All that the report tells: pictures are PNG by name, `record` is result.json."""

    finding: Finding
    explained: Explanation
    record: Mapping[str, Any]
    problem: Problem
    pictures: Mapping[str, bytes]

    def picture(self, name: str, caption: str = "") -> str:
        """Return a picture with its caption as HTML, nothing where it was not drawn."""
        if name not in self.pictures:
            return ""
        return picture(CAPTIONS[caption or name], self.pictures[name])


def write_explain_report(told: Told, path: Path) -> None:
    """Write the report of an explanation as one HTML file, replaced in one step."""
    body = "\n".join(_sections(told))
    write_page(
        path, "explain.html", name=told.finding.name, lead=_lead(told), body=body, pictures={}
    )


def _lead(t: Told) -> str:
    scan, tried = t.finding.scan, t.record["candidates"]
    beyond = sum(c["untestable"] is not None for c in tried)
    untested = f", {beyond} of which this scan cannot test" if beyond else ""
    return (
        f"{len(scan.press_ids)} presses, {len(scan)} readings; {len(tried)} effects of the "
        f"catalogue asked for{untested}."
    )


def _sections(t: Told) -> Iterable[str]:
    yield section("The error, step by step", t.picture("ladder") + ladder_table(t.explained))
    yield _verdict(t)
    if t.explained.verdict == "unexplained":  # what is left is then the finding
        yield _left(t)
    alone = presses_sentences(t.record)
    if alone:
        yield section("The presses by themselves", listing(alone))
    yield section("Where the error was", t.picture("residuals"))
    for number in steps_of(t.explained):
        yield _step(t, number)
    yield _map(t)
    yield _ahead(t)
    yield section("Every effect that was asked for", candidate_table(t.record))
    yield section("What this scan can tell apart", t.picture("confusion"))
    if t.explained.verdict != "unexplained":
        yield _left(t)
    yield section(
        "How far to trust this",
        listing([*limits_of_method(t.explained, t.record), *t.finding.limits]),
    )
    yield section("How this was made", table(("", ""), t.finding.how.items(), numeric=False))


def _verdict(t: Told) -> str:
    sure = t.explained.verdict in ("nothing_missing", "explained")
    text = paragraph(verdict_detail(t.explained), "say")
    if t.explained.verdict == "nothing_missing":
        text += paragraph(
            "This is no proof that nothing is there: an effect too small for this scan, or one "
            "that a softer or stiffer map imitates, leaves no trace in the residual."
        )
    if t.explained.verdict == "unexplained":
        text += paragraph(
            "No effect of the catalogue, nor any sum of them that was tried, explains what is "
            "left. Until it is known, the map's parameters may be wrong by more than their "
            "standard errors."
        )
    text += "".join(
        paragraph(step_evidence(t.explained, t.problem, number))
        for number in steps_of(t.explained)
        if set(added_names(t.explained.ladder[number - 1], t.explained.ladder[number]))
        & set(t.explained.added)
    )
    text += listing(doubts(t.record, t.explained))
    return section(headline(t.explained), text, "verdict" if sure else "verdict not")


def _left(t: Told) -> str:
    return section(
        "What the last model leaves over",
        paragraph(t.record["residual"]) + t.picture("residual_along") + t.picture("residual_tests"),
    )


def _step(t: Told, number: int) -> str:
    before, after = t.explained.ladder[number - 1], t.explained.ladder[number]
    names = added_names(before, after)
    text = paragraph(step_evidence(t.explained, t.problem, number), "say")
    text += t.picture(f"evidence_{number}", "evidence")
    text += listing(step_notes(t.explained, number))
    titles = []
    for name in names:
        effect, addition = t.problem.catalogue[name], kept(t.explained, name)
        text += rival_table(addition) if addition is not None else ""
        about = (
            ("What it is", effect.summary),
            ("What would give it away", effect.gives_away),
            ("Formula", effect.formula),
            ("Source", effect.source),
            ("What avoids or separates it", effect.cure),
        )
        text += table(("", ""), about, numeric=False)
        own = "" if name.replace("_", " ") in effect.title.lower() else f" ({name})"
        titles.append(f"{effect.title}{own}")
    return section(f"Step {number}: {' and '.join(titles)}", text)


def _map(t: Told) -> str:
    stepped = len(t.explained.ladder) > 1
    title = "The map"
    if stepped:
        sure = t.explained.verdict == "explained"
        title = "What ignoring it had done to the map" if sure else "The map, before and after"
    text = t.picture("maps") + t.picture("parameters")
    text += parameter_table(t.finding, t.explained, t.record)
    if t.finding.truth is not None:
        text += paragraph(
            "The true map lies beside the scan and is shown for comparison; nothing was fitted to "
            "it. Off: the distance to the truth in standard errors (s.e.) of that fit."
        )
    if unseen := unseen_effects(t.record):
        text += paragraph(unseen)
    if stepped and t.explained.verdict != "explained":
        text += paragraph(
            "'After' is not the truth either: "
            + (
                "another effect of the group would give another map."
                if t.explained.verdict == "ambiguous"
                else "what is not explained still pulls at the map."
            )
        )
    return section(title, text + t.picture("presses"))


def _ahead(t: Told) -> str:
    """Which presses to make next, and what could hide."""
    text = ""
    presses, finer = t.record.get("next_presses"), t.record.get("finer_cells")
    if finer:
        text += section("The mesh or the body", paragraph(f"{finer}."))
    if presses:
        text += section(
            "Which presses to make next",
            paragraph(
                "Scans that would tell the effects apart, the quickest first; of each only the "
                "presses that are needed. Each stands as a press program in the run folder. Made "
                "after the present scan on the same body, they are explained together with it: "
                "`palpmap join` makes one scan of both."
            )
            + next_press_table(presses),
        )
    limits = t.record.get("limits")
    if limits:
        share = limits[0].get("bias_at_share")
        size = f" of {percent(share)} of the signal" if isinstance(share, float) else ""
        text += section(
            "What could hide in this scan",
            paragraph(
                "The smallest size at which this scan would show each effect, at five standard "
                "errors, after the map has taken its share; and what an effect"
                f"{size} that is ignored does to the map."
            )
            + detection_table(limits),
        )
    return text
