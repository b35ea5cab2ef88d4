"""The last rung of an explanation as the finding that `fit` and `compare` show."""

import json
from dataclasses import replace
from pathlib import Path

from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.select.forward_selection import Explanation
from identify.select.step import Step
from palpmap.result.caveats import limits_of
from palpmap.result.finding import Finding, study_outline
from palpmap.run_folder import how_made, read_record
from palpmap.study.open_study import Problem

TRUTH = "truth.json"
_BALL = (
    "The tip is a ball. Its near travel follows Hertz's law; for what lies further off, its "
    "contact is held at the size that it has at half of the press's depth."
)


def final_finding(run: Path, problem: Problem, explained: Explanation) -> Finding:
    """Return the last rung as a finding; its map is the one fitted jointly with the effects."""
    return step_finding(run, problem, explained.final)


def step_finding(run: Path, problem: Problem, rung: Step) -> Finding:
    """Return one rung as a finding."""
    runs = read_record(run / "run.json")["runs"] if (run / "run.json").is_file() else []
    outline, used = study_outline(problem.study), problem.scan.used()
    fit = replace(rung.fit, history=())  # steps of refits are no convergence of a search
    height_m = float(outline.upper_m[2] - outline.lower_m[2])
    limits = limits_of(fit, problem.study, used.displacement_m, height_m)
    note = _BALL if problem.body.coarse.contacts.profile == "hertz" else problem.body.note
    return Finding(
        name=problem.study.name,
        fit=fit,
        scan=used,
        comparison=rung.comparison,
        outline=outline,
        truth=truth_beside(problem),
        origin_m=problem.experiment.origin_m,
        how=how_made(runs),
        limits=(*limits, note) if note else limits,
    )


def truth_beside(problem: Problem) -> GaussianMap | None:
    """Return the true map of a virtual laboratory, if its file lies beside the scan.

    The file may be another laboratory's own: what cannot be read as a map is no truth, and no
    reason to lose a run at its end.
    """
    path = problem.study.scan.with_name(TRUTH)
    try:
        body = json.loads(path.read_text(encoding="utf-8"))["body"]
        inclusions = tuple(Inclusion(**i) for i in body["inclusions"])
        return GaussianMap(float(body["background_pa"]), inclusions)
    except (OSError, KeyError, TypeError, ValueError):
        return None
