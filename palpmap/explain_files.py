"""What `palpmap explain` leaves in its run folder beside result.json and the study's version."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from identify.explain import Explanation
from palpmap.explain_evidence import evidences
from palpmap.explain_figures import (
    draw_cosines,
    draw_evidence,
    draw_ladder,
    draw_residuals,
)
from palpmap.explain_finding import final_finding
from palpmap.explain_report import write_explain_report
from palpmap.figure_style import STYLE, png
from palpmap.figures import save_figures
from palpmap.problem import Problem


def write_explain_files(
    run: Path, problem: Problem, explained: Explanation, record: Mapping[str, Any]
) -> None:
    """Write comparison.json (of the last rung), figures, report.html and recording.rrd.

    Parameters
    ----------
    run : run folder
    record : what result.json says; the report says no more than that
    """
    finding = final_finding(run, problem, explained)
    finding.comparison.write(run / "comparison.json")
    pictures = explain_pictures(problem, explained)
    save_figures(pictures, run / "figures")
    write_explain_report(finding, explained, record, problem, pictures, run / "report.html")


def explain_pictures(problem: Problem, explained: Explanation) -> dict[str, bytes]:
    """Draw all figures of an explanation: PNG by name."""
    pictures = {}
    with rc_context(STYLE):
        pictures["ladder"] = png(draw_ladder(explained))
        pictures["residuals"] = png(draw_residuals(explained, problem.placement.origin_m))
        for evidence in evidences(explained):
            pictures[f"evidence_{evidence.name}"] = png(draw_evidence(evidence))
        cosines = draw_cosines(explained.ladder[0].diagnosis)
        if cosines is not None:
            pictures["confusion"] = png(cosines)
    return pictures
