"""The run folder of an explanation."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib import rc_context

from identify.design import Assessment
from identify.fit import write_fit
from identify.select import Explanation
from palpmap.figures.fit import save_figures
from palpmap.figures.forms import draw_forms
from palpmap.figures.ladder import draw_cosines, draw_evidence, draw_ladder, draw_residuals
from palpmap.figures.map_change import draw_maps, draw_parameters, draw_presses
from palpmap.figures.residual import draw_along, draw_tests
from palpmap.figures.style import STYLE, png
from palpmap.recording.explain import record_explanation
from palpmap.report.explain_report import write_explain_report
from palpmap.result.evidence import evidences
from palpmap.result.finding import Finding, step_finding
from palpmap.result.next_step import next_steps
from palpmap.result.own_effect import OWN_EFFECT, pattern_of, write_own_effect
from palpmap.result.records import ExplainRecord
from palpmap.study.open_study import Problem
from palpmap.study.study import Study
from palpmap.study.versions import version_of

_RECORDED = ("ladder", "residuals", "evidence", "maps", "parameters", "confusion", "forms")


def write_explanation(
    run: Path,
    problem: Problem,
    explained: Explanation,
    assessment: Assessment,
    record: ExplainRecord,
    study: Study,
    files: Mapping[str, Path] | None = None,
    source: Path | None = None,
) -> None:
    """Write result.json, the explained study, report and recording.

    Parameters
    ----------
    study : the one that names the run folder's own copies
    files : of the user's own effects, by name
    source : file of the study, None where it was made in Python
    """
    record.write(run / "result.json")
    version_of(study, explained.final.fit, run / "study.toml", files)
    if explained.fitted_verdict == "unexplained":
        write_own_effect(pattern_of(explained.final.comparison), run / OWN_EFFECT)
    write_explain_files(run, problem, explained, assessment, record, source)


def write_explain_files(
    run: Path,
    problem: Problem,
    explained: Explanation,
    assessment: Assessment,
    record: ExplainRecord,
    source: Path | None = None,
) -> None:
    """Write the last step's fit.json and comparison.json, figures, report.html, recording.rrd.

    Parameters
    ----------
    run : run folder
    record : result.json
    source : file of the study
    """
    finding = step_finding(run, problem, explained.final, assessment.parameters)
    write_fit(finding.fit, run / "fit.json")
    finding.comparison.write(run / "comparison.json")
    pictures = explain_pictures(finding, explained, record)
    paths = {path.stem: path for path in save_figures(pictures, run / "figures")}
    following = next_steps(record, explained, problem, run, source)
    write_explain_report(
        run / "report.html", finding, explained, record, problem, pictures, following
    )
    shown = {name: path for name, path in paths.items() if name.startswith(_RECORDED)}
    record_explanation(run / "recording.rrd", finding, explained, record, problem, shown, following)


def explain_pictures(
    finding: Finding, explained: Explanation, record: ExplainRecord
) -> dict[str, bytes]:
    """Draw all figures of an explanation: PNG by name."""
    first = explained.ladder[0]
    with rc_context(STYLE):
        pictures = {
            "residuals": png(draw_residuals(explained, finding.origin_m)),
            "maps": png(draw_maps(finding, explained)),
            "presses": png(draw_presses(explained)),
            "residual_along": png(draw_along(finding)),
            "residual_tests": png(draw_tests(finding)),
        }
        if len(explained.ladder) > 1:  # one dot is no picture
            pictures["ladder"] = png(draw_ladder(explained))
        for number, evidence in enumerate(evidences(explained, finding.origin_m), start=1):
            pictures[f"evidence_{number}"] = png(draw_evidence(evidence))
        parameters = draw_parameters(finding, explained, record)
        if parameters is not None:
            pictures["parameters"] = png(parameters)
        if record.form_curves:
            pictures["forms"] = png(draw_forms(record.form_curves, finding.origin_m))
        cosines = draw_cosines(first.diagnosis)
        if cosines is not None:
            pictures["confusion"] = png(cosines)
    return pictures
