"""presses.json: what became of each press of a robot's scan."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from palpmap.record import FileRecord, Record

if TYPE_CHECKING:
    from sim.scan import PressOutcome, PressStatistics

FILE = "presses.json"


class FaultRecord(Record):
    """A fault in one attempt at a press."""

    kind: str = Field(description="which watchdog noticed it")
    phase: str = Field(description="of the press, when it was noticed")
    time_s: float = Field(description="since the scan began, s")
    reason: str


class MeasuredRecord(Record):
    """Quality of a press by the robot's own readings."""

    force_n: float = Field(description="mean over the second half of the hold, N")
    force_error: float = Field(description="of that mean from the set force, relative")
    overshoot: float = Field(description="largest force averaged over 50 ms, over the set force")
    place_error_m: float = Field(description="sideways distance from the planned point, m")
    tare_n: float = Field(description="taken off the force before the approach, N")
    zero_after_n: float = Field(description="read after the press, N; 0 where it is noise")
    touch_sd_m: float = Field(0.0, description="standard deviation of the first touch, m")
    rise_m: float = Field(0.0, description="of the tip on the way back under the same force, m")
    travel_m: float = Field(0.0, description="largest travel in contact, m")
    end_share: float = Field(1.0, description="force at the end of unloading over that wanted")


class SimulatorRecord(Record):
    """The same by what only the simulator knows."""

    force_error: float = Field(description="of the held force, relative")
    overshoot: float = Field(description="largest force over the set force, less one")
    contact_error_m: float = Field(description="sideways distance from the planned point, m")
    coupling_error: float = Field(description="of body and robot from each other, relative")
    touch_error_m: float = Field(description="of the point of first touch, m")
    settle_s: float = Field(description="until the force stays within 1 %, s")


class PressRecord(Record):
    """One planned press."""

    press: int = Field(description="number in the plan, and in the scan")
    outcome: Literal["made", "retried", "skipped", "aborted"]
    kept: bool = Field(description="made, with force, overshoot and place as promised")
    set_force_n: float = Field(description="N")
    reason: str = Field(
        description="why it has no readings, what was not kept, or why its force was lowered"
    )
    faults: tuple[FaultRecord, ...] = Field(description="of its attempts")
    measured: MeasuredRecord | None = Field(description="null without readings")
    simulator: SimulatorRecord | None = Field(description="null without readings")


class PressesRecord(FileRecord):
    """presses.json: every planned press, in order; written anew after each."""

    on_fault: Literal["skip", "retry", "stop"]
    presses: tuple[PressRecord, ...]


def press_record(
    outcome: "PressOutcome", statistics: "PressStatistics | None" = None
) -> PressRecord:
    """Return the record of one press; `statistics` are the simulator's, of a press with readings.

    Examples
    --------
    >>> from sim.scan import PressOutcome
    >>> press_record(PressOutcome(3, "skipped", 0.3, reason="out of reach")).outcome
    'skipped'
    """
    return PressRecord.copy_of(
        outcome,
        faults=tuple(map(FaultRecord.copy_of, outcome.faults)),
        measured=outcome.judged and MeasuredRecord.copy_of(outcome.judged),
        simulator=statistics and SimulatorRecord.copy_of(statistics),
    )
