"""Tables of a robot's scan for the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from palpmap.result.press_outcomes import FILE as PRESSES
from palpmap.result.scan_record import ScanRecord

if TYPE_CHECKING:
    from rich.console import RenderableType

    from sim.motion import Refusal

SMALL_DEPTH_SHARE = 0.2  # deeper ones are said: beyond a tenth a linear law goes wrong by so much


def scan_table(record: ScanRecord) -> "RenderableType":
    """Return how well the presses were made, as a small table."""
    from rich import box
    from rich.table import Table

    largest = record.largest
    table = Table(box=box.SIMPLE, show_header=False, title="scan", title_justify="left")
    table.add_row(
        "presses that kept force and place",
        f"{record.presses_kept} of {record.presses} at {_forces(record)}",
    )
    if set(record.outcomes) - {"made"}:
        told = ", ".join(f"{number} {name}" for name, number in record.outcomes.items())
        table.add_row("presses", told)
    if record.lowered:
        table.add_row("with less force, not to go too deep", f"{record.lowered}, see {PRESSES}")
    table.add_row(
        "largest force error, overshoot",
        f"{100 * largest.force_error:.2f} %, {100 * largest.overshoot:.1f} %",
    )
    table.add_row(
        "largest contact error, coupling error",
        f"{1e3 * largest.contact_error_m:.3f} mm, {100 * largest.coupling_error:.3f} %",
    )
    if largest.depth_share > SMALL_DEPTH_SHARE:
        table.add_row(
            "deepest press",
            f"{100 * largest.depth_share:.0f} % of the body's height; a real body is linear "
            "to about a tenth",
        )
    table.add_row(
        "robot time, computing time",
        f"{record.simulated_s:.0f} s, {record.wall_s:.1f} s "
        f"({record.real_time_factor:.0f} times real time)",
    )
    return table


def _forces(record: ScanRecord) -> str:
    """Return the set forces, one or their range.

    >>> from types import SimpleNamespace
    >>> _forces(SimpleNamespace(force_n=0.11, largest_force_n=0.3))
    '0.11 to 0.3 N'
    """
    low, high = (f"{force:.3g}" for force in (record.force_n, record.largest_force_n))
    return f"{low} N" if low == high else f"{low} to {high} N"


def refused_table(refused: "Sequence[Refusal]") -> "RenderableType":
    """Return the presses that cannot be made, and why, as a table."""
    from rich import box
    from rich.table import Column, Table

    table = Table(
        "press",
        "place, mm",
        Column("why it is left out", overflow="fold"),
        box=box.SIMPLE,
        title=f"{len(refused)} {'press' if len(refused) == 1 else 'presses'} cannot be made",
        title_justify="left",
    )
    for one in refused:
        place = ", ".join(f"{1e3 * value:.1f}" for value in one.point_m)
        table.add_row(str(one.press), place, one.reason)
    return table
