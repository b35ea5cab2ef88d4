"""`palpmap limits`: what a scan can see of each effect, and the scan that would see more."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.joint_fit import JointFit, fit_jointly
from identify.limits import SHARE, Limit, detection_limits, improvements
from identify.scan_design import presses_of, variations
from palpmap.console import Output
from palpmap.next_scan import write_presses
from palpmap.problem import Problem, Say, own_effects, pose
from palpmap.run_folder import RunFolder, write_record
from palpmap.study import load_study

if TYPE_CHECKING:
    from rich.console import RenderableType

_BETTER = 0.7  # a planned scan is worth naming if it sees an effect of this part of the size


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
            better = planned_limits(fit, problem, run.path, say) if plan else {}
            progress.update(task, description="done", total=1, completed=1)
        record = {"limits": [limit_record(limit, better.get(limit.name)) for limit in limits]}
        write_record(run / "limits.json", record)
        output.result({**record, "run": str(run.path)}, *limits_table(record, fit))
    return True


def planned_limits(
    fit: JointFit, problem: Problem, run: Path, say: Say
) -> dict[str, dict[str, Any]]:
    """For each effect the cheapest changed scan that sees it at a clearly smaller size.

    The programs of the scans named are written into the run folder.
    """
    readings = problem.model.readings
    designs = list(variations(presses_of(readings), readings.time_s is not None))
    plans = improvements(fit, problem.catalogue, designs, say)
    same = next(p for p in plans if p.design.name == "same")
    now = {limit.name: limit.smallest_share for limit in same.limits}
    found: dict[str, dict[str, Any]] = {}
    for plan in sorted(plans, key=lambda p: p.design.presses.duration_s):
        for limit in plan.limits:
            share, present = limit.smallest_share, now.get(limit.name)
            if plan is same or share is None or limit.name in found:
                continue
            if present is None or share < _BETTER * present:
                program = f"scan_{plan.design.name}.csv"
                if not (run / program).exists():
                    write_presses(plan.design.presses, problem.placement.origin_m, run / program)
                found[limit.name] = {
                    "change": plan.design.change,
                    "smallest_share": share,
                    "confused_with": list(limit.confused_with),
                    "program": program,
                }
    return found


def limit_record(limit: Limit, better: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return a limit as plain data."""
    return {
        "name": limit.name,
        "smallest_share": limit.smallest_share,
        "sizes": dict(limit.sizes),
        "visible": limit.visible,
        "confused_with": list(limit.confused_with),
        "map_bias": dict(limit.map_bias),
        "bias_at_share": SHARE,
        "untestable": limit.untestable,
        "better_scan": better,
    }


def limits_table(record: dict[str, Any], fit: JointFit) -> tuple["RenderableType", ...]:
    """Return the limits as rich renderables."""
    from rich import box
    from rich.table import Table

    values = fit.values
    table = Table(
        box=box.SIMPLE, title="what this scan can see (5 standard errors)", title_justify="left"
    )
    for column in ("effect", "from % of signal", "looks like", "E0 %", "w %", "z mm", "better"):
        text = column in ("effect", "looks like", "better")
        table.add_column(column, justify="left" if text else "right")
    for limit in record["limits"]:
        share, bias = limit["smallest_share"], limit["map_bias"]
        if share is None:
            table.add_row(limit["name"], "-", limit["untestable"] or "nothing is seen")
            continue
        better = limit["better_scan"]
        hint = f"{100 * better['smallest_share']:.2g} % {better['change']}" if better else ""
        table.add_row(
            limit["name"],
            f"{100 * share:.2g}",
            ", ".join(limit["confused_with"][:3]),
            _percent(bias, values, "background_pa"),
            _percent(bias, values, "inclusion_1.weight_pa"),
            f"{1e3 * bias['inclusion_1.z_m']:+.2g}" if "inclusion_1.z_m" in bias else "",
            hint,
        )
    note = (
        f"E0, w, z: how far the map's background, first inclusion's weight and depth move if an "
        f"effect of {100 * SHARE:.0f} % of the signal is ignored (to first order)."
    )
    return table, note


def _percent(bias: dict[str, float], values: dict[str, float], name: str) -> str:
    return f"{100 * bias[name] / values[name]:+.2g}" if name in bias else ""
