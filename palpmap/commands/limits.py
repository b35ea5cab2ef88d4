"""`palpmap limits`: what a scan can see of each effect, and the scan that would see more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.design.detection_limits import SHARE, Limit, detection_limits
from identify.design.predicted_limits import Improvement, designs_on_body, improvements
from identify.design.scan_variants import mixed, presses_of, variations
from identify.experiment import Progress
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from palpmap.commands.diagnose import untestable_lines
from palpmap.console import Output
from palpmap.result.explain_record import limit_record
from palpmap.result.next_scan import write_presses
from palpmap.result.presses_words import counted, left_out_sentences
from palpmap.result.records import BetterScanRecord, LimitsRecord, PlannedScanRecord
from palpmap.run_folder import RunFolder
from palpmap.study.open_study import Problem, own_effects, pose
from palpmap.study.study import load_study

if TYPE_CHECKING:
    from rich.console import RenderableType

_WEIGHT = "inclusion_1.weight_pa"
_BETTER = 0.7  # a planned scan is worth naming if it sees an effect of this part of the size


@dataclass(frozen=True)
class Better:
    """Planned scans that see more than the one that was made.

    Attributes
    ----------
    by_effect : for each effect the cheapest change that helps
    mixed : the scan that changes most at once; None if it helps nothing
    in_mixed : smallest share that it sees, by effect
    """

    by_effect: Mapping[str, BetterScanRecord] = field(default_factory=dict)
    mixed: PlannedScanRecord | None = None
    in_mixed: Mapping[str, float] = field(default_factory=dict)


def run_limits(
    *, study: Path, out: Path | None, effects: Sequence[Path], plan: bool, output: Output
) -> bool:
    """Print the detection limits of a study's scan; write limits.json into a run folder.

    Parameters
    ----------
    plan : also compute what changed scans would see
    """
    known = load_study(study)
    own = own_effects(known, effects)
    with RunFolder("limits", out, inputs=[study, known.scan, *effects]) as run:
        with output.progress() as progress:
            task = progress.add_task("reading", total=None)

            def say(text: str) -> None:
                progress.update(task, description=text)

            problem = pose(known, own, say)
            fit = fit_jointly(problem.model, problem.start)
            say("computing what this scan can see")
            limits = detection_limits(fit, problem.catalogue)
            better = planned_limits(fit, problem, run.path, say, limits) if plan else Better()
            progress.update(task, description="done", total=1, completed=1)
        found = LimitsRecord(
            limits=tuple(
                limit_record(
                    limit, better.by_effect.get(limit.name), better.in_mixed.get(limit.name)
                )
                for limit in limits
            ),
            mixed_scan=better.mixed,
            **counted(problem),
        )
        found.write(run / "limits.json")
        record = found.to_dict()
        output.result(
            {**record, "run": str(run.path)},
            *limits_table(record, fit),
            *left_out_sentences(record),
        )
    return True


def planned_limits(
    fit: FitResult, problem: Problem, run: Path, say: Progress, limits: Sequence[Limit] = ()
) -> Better:
    """Return the changed scans that see clearly smaller effects.

    The programs of the scans named are written into the run folder.

    Parameters
    ----------
    limits : of the scan that was made; a changed scan must also see less than it does
    """
    readings = problem.model.readings
    presses = presses_of(readings)
    all_at_once = mixed(presses)
    designs = [*variations(presses, readings.time_s is not None), all_at_once]
    plans = improvements(fit, problem.catalogue, designs_on_body(fit, designs), say)
    same = next(p for p in plans if p.design.name == "same")
    present = {limit.name: limit.smallest_share for limit in limits if limit.smallest_share}
    for limit in same.limits:
        if limit.smallest_share:
            made = present.get(limit.name, limit.smallest_share)
            present[limit.name] = min(made, limit.smallest_share)

    def helps(limit: Limit) -> bool:
        share = limit.smallest_share
        return share is not None and share < _BETTER * present.get(limit.name, np.inf)

    found: dict[str, BetterScanRecord] = {}
    single = [p for p in plans if p is not same and p.design.name != all_at_once.name]
    for plan in sorted(single, key=lambda p: p.design.presses.duration_s):
        for limit in plan.limits:
            share = limit.smallest_share
            if share is not None and limit.name not in found and helps(limit):
                found[limit.name] = BetterScanRecord(
                    **dict(_planned(plan, problem, run)),
                    smallest_share=share,
                    confused_with=limit.confused_with,
                )
    # A tip that fits nowhere has no scan
    whole = next((p for p in plans if p.design.name == all_at_once.name), None)
    if whole is None or not any(helps(limit) for limit in whole.limits):
        return Better(found)
    shares = {n.name: n.smallest_share for n in whole.limits if n.smallest_share}
    return Better(found, _planned(whole, problem, run), shares)


def _planned(plan: Improvement, problem: Problem, run: Path) -> PlannedScanRecord:
    """Return a planned scan; its program is written into the run folder."""
    program = f"scan_{plan.design.name}.csv"
    write_presses(plan.design.presses, problem.experiment.origin_m, run / program)
    return PlannedScanRecord(change=plan.design.change, program=program)


def limits_table(record: dict[str, Any], fit: FitResult) -> tuple["RenderableType", ...]:
    """Return the limits as rich renderables that fit 80 columns.

    Better scans stand as letters in the table and in words below it.
    """
    from rich import box
    from rich.table import Table

    seen = [
        limit
        for limit in record["limits"]
        if limit["smallest_share"] is not None or limit["largest_share"] is not None
    ]
    mixed_scan = record["mixed_scan"]
    scans = {s["program"]: s["change"] for s in (limit["better_scan"] for limit in seen) if s}
    letters = dict(zip(scans, "ABCDEFGHIJKLMNOPQRSTUVWXYZ", strict=False))
    values, biased = fit.values, {name for limit in seen for name in limit["map_bias"]}
    shifts = {  # head of the column: parameter, and how its shift is shown
        "E0 %": ("background_pa", lambda v: f"{100 * v / values['background_pa']:+.1f}"),
        "w %": (_WEIGHT, lambda v: f"{100 * v / values[_WEIGHT]:+.0f}"),
        "z mm": ("inclusion_1.z_m", lambda v: f"{1e3 * v:+.1f}"),
    }
    shifts = {head: pair for head, pair in shifts.items() if pair[0] in biased}

    def percent(share: float | None) -> str:
        return "" if share is None else f"{100 * share:.2g}"

    title = "what this scan can see (5 standard errors), % of the signal"
    table = Table(
        box=box.SIMPLE, title=title, title_justify="left", pad_edge=False, padding=(0, 1, 0, 0)
    )
    table.add_column("effect", no_wrap=True)
    planned = [*(["better"] if scans else []), *(["mixed"] if mixed_scan else [])]
    for column in ("from", *shifts, *planned):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("looks like")
    for limit in seen:
        bias, better = limit["map_bias"], limit["better_scan"]
        hint = ""
        if better:
            hint = f"{percent(better['smallest_share'])} {letters[better['program']]}"
        table.add_row(
            limit["name"],
            percent(limit["smallest_share"]) or "never",
            *(shown(bias[name]) if name in bias else "" for name, shown in shifts.values()),
            *([hint] if scans else []),
            *([percent(limit["in_mixed_scan"])] if mixed_scan else []),
            "\n".join(limit["confused_with"][:2]),
        )
    notes = [
        "E0, w, z: how far the map's background, first inclusion's weight and depth move if an "
        f"effect of {100 * SHARE:.0f} % of the signal is ignored (in proportion).",
        *(f"{letters[name]}: the scan {change} ({name})." for name, change in scans.items()),
        *(
            [f"mixed: the scan {mixed_scan['change']} ({mixed_scan['program']})."]
            if mixed_scan
            else []
        ),
    ]
    return table, *notes, *untestable_lines(record["limits"], "Not seen at any size")
