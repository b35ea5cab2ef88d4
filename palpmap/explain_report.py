"""The report of `palpmap explain`: the error that falls first, then what each step rests on."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from identify.explain import Explanation
from palpmap.explain_summary import VERDICTS
from palpmap.finding import Finding
from palpmap.problem import Problem
from palpmap.report_parts import paragraph, picture, section, table, write_page


def write_explain_report(
    finding: Finding,
    explained: Explanation,
    record: Mapping[str, Any],
    problem: Problem,
    pictures: Mapping[str, bytes],
    path: Path,
) -> None:
    """Write the report of an explanation as one HTML file."""
    write_page(path, finding.name, VERDICTS[explained.verdict][0], _sections(record, pictures))


def _sections(record: Mapping[str, Any], pictures: Mapping[str, bytes]) -> Iterable[str]:
    yield section("The error", picture("The error, step by step.", pictures["ladder"]))
    yield section("The residual", picture("The residual.", pictures["residuals"]))
    for name, data in pictures.items():
        if name.startswith("evidence_"):
            yield section(name.removeprefix("evidence_"), picture("Evidence.", data))
    rows = [
        (c["name"], c["verdict"], f"{100 * c['explained_fraction']:.2g} %", f"{c['p_value']:.2g}",
         c["evidence"])
        for c in record["candidates"]
    ]  # fmt: skip
    head = ("Effect", "Verdict", "Share", "p", "Evidence")
    yield section("Candidates", table(head, rows, numeric=False))
    yield section("Residual", paragraph(record["residual"]))
