"""Proposed scans as press programs (docs/files.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identify.design import Assessment, BetterScans, Presses, Proposal
from models import InputError, PressProgram, Scan, touching, write_program
from palpmap.result.records import LimitsRecord, NextPressesRecord
from palpmap.study.body import Body
from palpmap.study.cell_size import cell_size_m, smallest_cell_m
from palpmap.study.placement import place_scan
from palpmap.study.study import Study

PROGRAM = "next_scan_{}.csv"
PLANNED = "scan_{}.csv"
REPEAT = "repeat_presses.csv"
FINER = 2 / 3
_MOST = 3
_HOLD_S, _UNLOAD_S = 0.1, 1.0
_LEVEL_M, _LEVEL = 1e-4, 1e-2  # contacts at one height, pressed straight down
_TURN_M = 1e-2  # as which distance a direction counts, where one place has presses in several

DOWN = (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class Sites:
    """Contacts of a scan, as its models have them and as they were measured.

    Those of the models lie on a surface that finite elements can follow, up to millimetres off.

    Attributes
    ----------
    placed : (j, 6) point in the body's frame, m, and direction times `_TURN_M`
    point_m, direction : (j, 3) as measured, in the scan's frame
    """

    placed: np.ndarray
    point_m: np.ndarray
    direction: np.ndarray

    @classmethod
    def of(cls, scan: Scan, study: Study) -> Sites:
        """Return the contacts of a study's scan, which is in its own frame."""
        made = touching(scan)
        placed = place_scan(made, study).scan
        return cls(_contacts(placed), made.contact_points, made.contact_directions)

    def columns(self, presses: Presses) -> dict[str, np.ndarray]:
        """Return the columns of a program that say where presses are, in the scan's frame.

        Height and direction are among them unless the scan is level: they are those of the surface.
        """
        planned = np.hstack([presses.point_m, _TURN_M * presses.direction])
        apart = np.linalg.norm(planned[:, None] - self.placed, axis=2)
        nearest = apart.argmin(axis=1)
        (x, y, z), (nx, ny, nz) = self.point_m[nearest].T, self.direction[nearest].T
        level = np.ptp(self.point_m[:, 2]) < _LEVEL_M
        if level and np.abs(self.direction - DOWN).max() < _LEVEL:
            return {"x_m": x, "y_m": y}
        return {"x_m": x, "y_m": y, "z_m": z, "nx": nx, "ny": ny, "nz": nz}


def _contacts(scan: Scan) -> np.ndarray:
    return np.hstack([scan.contact_points, _TURN_M * scan.contact_directions])


def next_presses_records(
    assessment: Assessment, presses: int, apart: bool = False
) -> tuple[NextPressesRecord, ...]:
    """Return the best proposals for a scan of some presses, and the presses to be repeated.

    These come first where they stand `apart`: the answer leaves them out.
    """
    records = [
        NextPressesRecord(
            change=_asked(proposal, presses),
            why=_why(proposal),
            discrimination=proposal.discrimination,
            presses=len(proposal.design.presses),
            duration_s=proposal.design.presses.duration_s,
            program=PROGRAM.format(number),
            separates=bool(proposal.separated),
        )
        for number, proposal in enumerate(assessment.next_presses[:_MOST], start=1)
    ]
    if assessment.outlying:
        change, why = _repeated(assessment.outlying)
        repeat = NextPressesRecord(
            change=change,
            why=why,
            discrimination=None,
            presses=len(assessment.repeat),
            duration_s=assessment.repeat.duration_s,
            program=REPEAT,
        )
        records.insert(0 if apart else len(records), repeat)
    return tuple(records)


def write_programs(assessment: Assessment, sites: Sites, run: Path) -> None:
    """Write the programs of the next presses into a run folder, in place of earlier ones."""
    for stale in (*run.glob(PROGRAM.format("*")), run / REPEAT):
        stale.unlink(missing_ok=True)
    for number, proposal in enumerate(assessment.next_presses[:_MOST], start=1):
        write_presses(proposal.design.presses, sites, run / PROGRAM.format(number))
    if assessment.outlying:
        write_presses(assessment.repeat, sites, run / REPEAT)


def write_planned(better: BetterScans, sites: Sites, run: Path) -> None:
    """Write the programs of better scans into a run folder, in place of earlier ones."""
    for stale in _planned_before(run):
        stale.unlink(missing_ok=True)
    mixed = () if better.mixed is None else (better.mixed.design,)
    for design in (*(design for design, _ in better.by_effect.values()), *mixed):
        write_presses(design.presses, sites, run / PLANNED.format(design.name))


def _planned_before(run: Path) -> list[Path]:
    """Return the programs that the folder's limits name; other scans are none of them."""
    file = run / "limits.json"
    if not file.is_file():
        return []
    try:
        known = LimitsRecord.read(file)
    except InputError:  # a damaged one is replaced, and names nothing
        return []
    planned = [known.mixed_scan, *(limit.better_scan for limit in known.limits)]
    return [run / Path(scan.program).name for scan in planned if scan is not None]


def _why(proposal: Proposal) -> str:
    """Return the gain of a scan, as a clause without its subject's name."""
    first, second = proposal.pair
    by = f"chi-square would differ by {proposal.discrimination:.3g}"
    if not proposal.separated:
        return f"it does not yet separate them: between {first} and {second} {by}"
    if proposal.enough:
        return f"it separates them: {by}" + (
            " or more" if len(proposal.separated) > 1 else f" between {first} and {second}"
        )
    pairs = ", ".join(f"{a} from {b}" for a, b in proposal.separated)
    alike = ", ".join(f"{a} and {b}" for a, b in proposal.alike)
    return f"it separates {pairs} ({by} or more); still alike would be {alike}"


def _repeated(ids: Sequence[int]) -> tuple[str, str]:
    """Return what is asked of outlying presses, and why.

    >>> _repeated((340,))
    ('Repeat press 340', 'if it comes out otherwise this time, it had gone wrong')
    >>> _repeated((6, 17))
    ('Repeat presses 6, 17', 'if they come out otherwise this time, they had gone wrong')
    """
    presses, come, they = ("press", "it comes", "it")
    if len(ids) > 1:
        presses, come, they = ("presses", "they come", "they")
    change = f"Repeat {presses} {', '.join(map(str, ids))}"
    return change, f"if {come} out otherwise this time, {they} had gone wrong"


def _asked(proposal: Proposal, present: int) -> str:
    """Return the request for a scan, a sentence without its full stop."""
    count, change = len(proposal.design.presses), proposal.design.change
    if count >= present:
        return f"Make the scan {change}"
    return f"Make the {count} most informative presses of the scan {change}"


def finer_cells(body: Body, probed_m: np.ndarray | None = None) -> str | None:
    """Return the test by a finer mesh, a sentence without its full stop; None if impossible.

    Parameters
    ----------
    probed_m : part of the body that has these cells, `palpmap.study.cell_size.probed_part`
    """
    present = cell_size_m(body, probed_m)
    finer = FINER * present
    if finer < smallest_cell_m(body, probed_m):
        return None
    return (
        f"Explain it again with finer elements, cell_size_m = {finer:.3g} under [body] (now "
        f"{present:.3g}), which takes several times as long: the error of the mesh shrinks, "
        "an effect of the body keeps its size"
    )


def write_presses(presses: Presses, sites: Sites, path: Path) -> None:
    """Write presses as a program, in the scan's frame.

    Where the scan has no rows of holding or unloading, the press still has to do so.
    """
    program = PressProgram(
        **sites.columns(presses),
        radius_m=presses.radius_m,
        force_n=presses.force_n,
        ramp_s=presses.ramp_s,
        hold_s=np.where(presses.hold_s > 0, presses.hold_s, _HOLD_S),
        unload_s=np.where(presses.unload_s > 0, presses.unload_s, _UNLOAD_S),
        pause_s=presses.pause_s,
    )
    write_program(program, path)
