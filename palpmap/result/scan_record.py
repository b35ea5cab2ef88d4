"""Output of `palpmap scan`: how well a robot's presses were made."""

from collections import Counter
from typing import TYPE_CHECKING

from pydantic import Field

from palpmap.record import FileRecord, Record

if TYPE_CHECKING:
    from sim.scan import ScanRun


class LargestRecord(Record):
    """Largest deviations of the presses from their commands, as only the simulator knows them."""

    force_error: float = Field(description="of the held force, relative")
    overshoot: float = Field(description="of the force, relative")
    contact_error_m: float = Field(description="of the contact's place, m")
    coupling_error: float = Field(description="of body and robot from each other, relative")
    depth_share: float = Field(description="depth of a press over the body's height")


class ScanRecord(FileRecord):
    """Output of `palpmap scan --json`: how well the presses were made."""

    presses: int = Field(description="planned")
    presses_kept: int = Field(description="made, with force and place kept by the readings")
    kept: bool = Field(description="whether all are")
    outcomes: dict[str, int] = Field(
        default_factory=dict, description="presses that were made, retried, skipped, aborted"
    )
    lowered: int = Field(0, description="presses made with less force, not to go too deep")
    not_kept: tuple[str, ...] = Field(default=(), description="a sentence on each other press")
    largest: LargestRecord
    force_n: float = Field(description="smallest set force of the presses, N")
    largest_force_n: float = Field(description="largest set force of the presses, N")
    simulated_s: float = Field(description="time of the robot, s")
    wall_s: float = Field(description="time of the computer, s")
    real_time_factor: float = Field(description="the robot's time over the computer's")


def scan_record(scanned: "ScanRun") -> ScanRecord:
    """Return how well the presses were made."""
    statistics = scanned.statistics
    largest = LargestRecord(
        force_error=max(abs(s.force_error) for s in statistics),
        overshoot=max(s.overshoot for s in statistics),
        contact_error_m=max(s.contact_error_m for s in statistics),
        coupling_error=max(s.coupling_error for s in statistics),
        depth_share=max(s.depth_share for s in statistics),
    )
    kept = sum(outcome.kept for outcome in scanned.outcomes)
    counts = Counter(outcome.outcome for outcome in scanned.outcomes)
    return ScanRecord(
        presses=len(scanned.outcomes),
        presses_kept=kept,
        kept=kept == len(scanned.outcomes),
        outcomes=dict(counts),
        lowered=sum(outcome.lowered for outcome in scanned.outcomes),
        not_kept=tuple(outcome.sentence for outcome in scanned.outcomes if not outcome.kept),
        largest=largest,
        force_n=min(s.set_force_n for s in statistics),
        largest_force_n=max(s.set_force_n for s in statistics),
        simulated_s=scanned.simulated_s,
        wall_s=scanned.wall_s,
        real_time_factor=scanned.real_time_factor,
    )
