"""Scans that the diagnosis proposes, as press programs (docs/files.md)."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.design.next_presses import Proposal, next_presses
from identify.design.predicted_limits import designs_on_body
from identify.design.scan_variants import Presses, presses_of, variations
from identify.experiment import Progress, silent
from identify.select.forward_selection import Explanation
from palpmap.study.body import Body
from palpmap.study.body_model import cell_size_m, smallest_cell_m
from palpmap.study.open_study import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType

COLUMNS = ("x_m", "y_m", "radius_m", "force_n", "ramp_s", "hold_s", "unload_s", "pause_s")
REPEAT = "repeat_presses.csv"
FINER = 2 / 3
_MOST = 3
_HOLD_S, _UNLOAD_S = 0.1, 1.0
_IN_ORDER = ("preconditioning", "hysteresis")  # told by timing and order, with those in time


def propose(
    explained: Explanation, problem: Problem, say: Progress = silent
) -> tuple[Proposal, ...]:
    """Return the scans that tell the last ambiguous group apart; the first is to be made."""
    ambiguous = [a for a in explained.accepted if len(a.equivalents) > 1]
    if not ambiguous:
        return ()
    group = ambiguous[-1]
    candidates = [(r.name, r.fit) for r in group.candidates if r.name in group.equivalents]
    readings = problem.model.readings
    in_time = any("time" in problem.catalogue[n].needs or n in _IN_ORDER for n, _ in candidates)
    timed = in_time and readings.time_s is not None
    designs = designs_on_body(candidates[0][1], variations(presses_of(readings), timed))
    return next_presses(candidates, designs, say)


def proposal_records(
    proposals: tuple[Proposal, ...], problem: Problem, run: Path
) -> list[dict[str, Any]]:
    """Write the best proposals as programs into a run folder; return their records."""
    records = []
    for number, proposal in enumerate(proposals[:_MOST], start=1):
        name = f"next_scan_{number}.csv"
        write_presses(proposal.design.presses, problem.experiment.origin_m, run / name)
        records.append(
            {
                "change": _asked(proposal, len(problem.scan.used().press_ids)),
                "why": _why(proposal),
                "discrimination": proposal.discrimination,
                "presses": len(proposal.design.presses),
                "duration_s": proposal.design.presses.duration_s,
                "program": name,
            }
        )
    return records


def _why(proposal: Proposal) -> str:
    """Say what a scan would bring, as a clause without its subject's name."""
    first, second = proposal.pair
    by = f"chi-square would differ by {proposal.discrimination:.3g}"
    if not proposal.told:
        return f"it does not yet tell them apart: between {first} and {second} {by}"
    if proposal.enough:
        return f"it tells them apart: {by}" + (
            " or more" if len(proposal.told) > 1 else f" between {first} and {second}"
        )
    pairs = ", ".join(f"{a} from {b}" for a, b in proposal.told)
    alike = ", ".join(f"{a} and {b}" for a, b in proposal.alike)
    return f"it tells {pairs} ({by} or more); still alike would be {alike}"


def _asked(proposal: Proposal, present: int) -> str:
    """Say what to do, a sentence without its full stop."""
    count, change = len(proposal.design.presses), proposal.design.change
    if count >= present:
        return f"Make the scan {change}"
    return f"Make the {count} most telling presses of the scan {change}"


def repeat_record(presses: Sequence[int], problem: Problem, run: Path) -> dict[str, Any]:
    """Write a program that repeats some presses (ids) into a run folder; return its record."""
    ids = problem.scan.used().press_ids
    again = presses_of(problem.model.readings).taken(np.flatnonzero(np.isin(ids, presses)))
    write_presses(again, problem.experiment.origin_m, run / REPEAT)
    return {
        "change": f"Repeat presses {', '.join(map(str, presses))}",
        "why": "they stand out by themselves: if they come out otherwise, they had gone wrong",
        "discrimination": None,
        "presses": len(again),
        "duration_s": again.duration_s,
        "program": REPEAT,
    }


def finer_cells(explained: Explanation, body: Body) -> str | None:
    """Say how an error of the mesh is told from the effects that it looks like, if it is asked."""
    names = {*explained.added, *(name for group in explained.ambiguous for name in group)}
    if MODEL_ERROR not in names or explained.verdict == "unexplained":
        return None
    present = cell_size_m(body)
    finer = FINER * present
    if finer < smallest_cell_m(body):
        return None
    return (
        f"Explain it again with finer elements, cell_size_m = {finer:.3g} under [body] (now "
        f"{present:.3g}), which takes several times as long: what the mesh does wrong shrinks, "
        "an effect of the body keeps its size"
    )


def next_lines(record: Mapping[str, Any], run: Path) -> tuple["RenderableType", ...]:
    """Return what to do next and what it would bring; nothing where nothing is proposed."""
    from rich.text import Text

    lines: list[RenderableType] = []
    if record["finer_cells"]:
        lines.append(Text(f"Next: {record['finer_cells']}.", style="bold"))
    if record["next_presses"]:
        best = record["next_presses"][0]
        minutes = f"{best['duration_s'] / 60:.2g} min"
        lines.append(Text(f"Next: {best['change']} ({minutes}): {best['why']}.", style="bold"))
        lines.append(f"Program: {run / best['program']}")
    return tuple(lines)


def write_presses(presses: Presses, origin_m: np.ndarray, path: Path) -> None:
    """Write presses as a program, in the scan's frame.

    Where the scan has no rows of holding or unloading, the press still has to do so.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for j in range(len(presses)):
            x, y = presses.point_m[j, :2] + origin_m[:2]
            numbers = (x, y, presses.radius_m[j], presses.force_n[j], presses.ramp_s[j],
                       presses.hold_s[j] or _HOLD_S, presses.unload_s[j] or _UNLOAD_S,
                       presses.pause_s[j])  # fmt: skip
            writer.writerow([f"{number:.6g}" for number in numbers])
