"""The next step after a result, in sentences with the commands as they can be typed."""

from itertools import chain
from pathlib import Path

from identify.effects import percent
from identify.select import Explanation
from models import scan_findings
from palpmap.console import to_type
from palpmap.result.explain_words import by_chance
from palpmap.result.finding import Finding
from palpmap.result.own_effect import OWN_EFFECT
from palpmap.result.records import ExplainRecord, LimitRecord
from palpmap.study.open_study import Problem
from palpmap.units import duration

_LARGE = 0.1  # of the signal: an effect that should not go unseen


def next_steps(
    record: ExplainRecord,
    explained: Explanation,
    problem: Problem,
    run: Path,
    study: Path | None = None,
) -> tuple[str, ...]:
    """Return the next step after an explanation, the first one to take on top.

    Parameters
    ----------
    problem : its scan, and the effects
    run : the run folder
    study : file of the study, None for the run folder's own
    """
    source = study or run / "study.toml"
    steps = [d.sentence for d in scan_findings(problem.scan) if d.kind == "free_travel"]
    steps += [f"{record.finer_cells}."] if record.finer_cells else []
    if record.other_map and record.other_map.answer == "another_map":
        steps.append(
            f'Set kind = "free" under [map] of {source}, and `{to_type("explain", source)}` again: '
            "effects are then sought beside a map of any form."
        )
    if _is_curved(problem) and record.presses_alone and record.presses_alone.map_error:
        steps.append(_from_contacts(problem, run))
    # Presses without which the scan is as unexplained are not why
    other, best = record.without_suspects, record.next_presses[:1]
    no_use = best and best[0].discrimination is None and other and other.verdict == "unexplained"
    asked = () if no_use or not best else _presses(record, run, source, problem.scan.has_time)
    sure = bool(asked) and best[0].separates
    steps += asked if sure else ()
    verdict = explained.fitted_verdict
    if verdict == "unexplained":
        steps.append(_own_effect(run, source))
    elif verdict == "ambiguous" and explained.within_laws:
        steps.append(
            "Press some of these places with a flat tip, or a larger ball, and explain both scans "
            "together: a cause that holds for both tips is found."
        )
    elif verdict == "ambiguous" and not sure:
        group = set(chain(*record.ambiguous))
        cures = [f"{e.title}: {e.cure}" for e in problem.catalogue if e.name in group]
        advice = "No scan of these places separates them for sure; rule them out one by one."
        steps.append(" ".join([advice, *cures]))
    elif verdict == "explained":
        effects = [part.effect for part in explained.final.fit.model.effects]
        cures = [f"{e.title}: {e.cure}" for e in effects if e.name in explained.added]
        steps += [*cures, f"The study with what was found: {run / 'study.toml'}"]
    elif verdict == "nothing_missing" and explained.apart is None:
        if by_chance(explained):
            steps.append("Make the scan once more: a pattern that stays has a cause.")
        steps.append(_limits(record, source))
    steps += () if sure else asked
    return (f"Next: {steps[0]}", *steps[1:]) if steps else ()


def _is_curved(problem: Problem) -> bool:
    """Return True where a block stands in for a body on whose faces the contacts do not lie."""
    body = problem.study.body
    return body.shape == "block" and body.project_points


def _from_contacts(problem: Problem, run: Path) -> str:
    """Return the way to a study whose body goes through the contact points."""
    body, tip = problem.study.body, problem.study.probe.tip
    assert body.size_m is not None
    guess = ("--thickness-assumed",) if body.thickness_assumed else ()
    noise = problem.study.noise
    stated = {
        "--displacement-noise": noise.displacement_m,
        "--force-noise": noise.force_n,
        "--touch-noise": noise.touch_m,
    }
    known = [word for flag, sd in stated.items() if sd is not None for word in (flag, f"{sd:g}")]
    command = to_type(
        "new", run / "scan.csv", "--tip", tip, "--thickness", f"{body.size_m[2]:g}", *guess,
        "--poisson", body.poisson_ratio, *known, "--out", "from_contacts",
    )  # fmt: skip
    return (
        "Let the body go through the contact points, in place of a block that they do not lie on, "
        f"beside a map of any form: `{command}` makes such a study; explain that."
    )


def _presses(record: ExplainRecord, run: Path, study: Path, timed: bool) -> tuple[str, str]:
    """Return the presses to make, and the way to explain them together with the scan."""
    best = record.next_presses[0]
    pause = ("--pause", "SECONDS") if timed else ()
    join = to_type(
        "join", run / "scan.csv", "NEW_SCAN.csv", *pause, "--study", study, "--out", "both.csv"
    )
    between = " (SECONDS lie between the two)" if timed else ""
    return (
        f"{best.change} ({duration(best.duration_s)}): {best.why}. "
        f"Press program: {run / best.program}.",
        f"Then `{join}` makes one scan of both, with its study{between}; "
        f"`{to_type('explain', 'both.toml')}`.",
    )


def _limits(record: ExplainRecord, study: Path) -> str:
    """Return the command for detection limits, and the effects of which the scan shows little."""
    command = to_type("limits", study)
    hidden = [one.name for one in record.limits if _hides(one)]
    if not hidden:
        return f"`{command}` says how large an effect must be for this scan to show it."
    return (
        f"Even at {percent(_LARGE)} of the signal this scan would not show: {', '.join(hidden)}. "
        f"`{command}` names a scan that shows more."
    )


def _hides(limit: LimitRecord) -> bool:
    """Return True if a large effect that can be tested would not be seen."""
    if limit.smallest_share is None:
        return limit.largest_share is not None and limit.largest_share > _LARGE
    return limit.smallest_share > _LARGE


def _own_effect(run: Path, study: Path) -> str:
    """Return the way from the start of an effect to its verdict."""
    file = run / OWN_EFFECT
    return (
        f"If you have a cause in mind, write it into {file}, the start of an effect of your own. "
        f"`{to_type('check-effect', file)}` checks it, and "
        f"`{to_type('explain', study, '--effect', file)}` asks the scan."
    )


def after_fit(finding: Finding, study: Path) -> tuple[str, ...]:
    """Return the next step after a fit or a comparison."""
    is_noise, doubts = finding.comparison.is_noise, scan_findings(finding.scan)
    outlying = sorted({p for doubt in doubts if doubt.leaves_out for p in doubt.presses})
    if outlying and not is_noise:
        which = "press " + ", ".join(map(str, outlying[:5])) + (" ..." if outlying[5:] else "")
        return (
            f"Next: `{to_type('fit', study, '--without-outliers')}` leaves out the doubtful "
            f"readings of {which}; `{to_type('check', study)}` names them.",
        )
    if finding.fit.field is None:
        return _after_comparison(is_noise, study)
    if not finding.fit.success:
        return (
            "The search did not end: this map is no result. Next: state the noise of the readings "
            "under [noise], or length_m and spread under [map].",
        )
    if not is_noise:
        return after_diagnosis(False, study)
    return ("Next: open map.vti of the run folder in ParaView.",)


def _after_comparison(is_noise: bool, study: Path) -> tuple[str, ...]:
    command = to_type("limits" if is_noise else "diagnose", study)
    says = (
        "says how large an effect must be for this scan to show it"
        if is_noise
        else "names the effects that the residual looks like"
    )
    return (f"Next: `{command}` {says}.",)


def after_diagnosis(is_noise: bool, study: Path) -> tuple[str, ...]:
    """Return the next step after a diagnosis: the search, or the detection limits."""
    if is_noise:
        return _after_comparison(True, study)
    return (f"Next: `{to_type('explain', study)}` adds effects until the residual is noise.",)
