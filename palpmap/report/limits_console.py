"""Detection limits on the console."""

from typing import TYPE_CHECKING

from identify.design import DETECTION
from identify.fit import FitResult
from palpmap.report.draw import console
from palpmap.result.doubts import untestable_sentences
from palpmap.result.presses_words import left_out_sentences
from palpmap.result.records import LimitsRecord
from palpmap.result.tables import ShiftColumn, farthest_shifts, limit_table, undetermined
from palpmap.units import quantity

if TYPE_CHECKING:
    from rich.console import RenderableType

_WEIGHT = "inclusion_1.weight_pa"


def limits_screen(record: LimitsRecord, fit: FitResult) -> tuple["RenderableType", ...]:
    """Return the limits as rich renderables that fit 80 columns.

    Better scans stand as letters in the table and in words below it.
    """
    seen = [e for e in record.limits if e.smallest_share or e.largest_share]
    scans = {e.better_scan.program: e.better_scan.change for e in seen if e.better_scan}
    letters = dict(zip(scans, "ABCDEFGHIJKLMNOPQRSTUVWXYZ", strict=False))
    biased = {name for e in seen for name in e.map_bias}
    shifts = [column for column in _shift_columns(fit) if column.name in biased]
    table = limit_table(
        seen, shifts, letters, "detection limits (5 standard errors), % of the signal"
    )
    return (
        _headline(record),
        console(table),
        "Signal: the rms of the modelled displacements.",
        _of_the_map(record),
        *filter(None, [undetermined(table)]),
        *(f"{letters[name]}: the scan {change} ({name})." for name, change in scans.items()),
        *untestable_sentences(record.limits, "Not seen at any size"),
        *left_out_sentences(record),
    )


def _of_the_map(record: LimitsRecord) -> str:
    """Return the meaning of the map's columns, or the depth down to which a free one is seen."""
    if record.sight_m is not None and record.labelled:
        return (
            f"Depth of sight: {quantity(record.sight_m, 'm')} under the middle press, for changes "
            "within a region; below, these are the prior's guess."
        )
    if record.sight_m is not None:
        return (
            f"Depth of sight: {quantity(record.sight_m, 'm')} under the middle press; below, the "
            "free map is its prior's guess."
        )
    return (
        "E0, w, z: shift of the map's background, first inclusion's weight and depth by an ignored "
        f"effect of {100 * DETECTION.bias_share:.0f} % of the signal (in proportion)."
    )


def _headline(record: LimitsRecord) -> str:
    """Return the number of effects that the scan shows, and the scan that shows most of them."""
    seen = sum(effect.smallest_share is not None for effect in record.limits)
    says = f"This scan shows {seen} of {len(record.limits)} effects, each from the size below."
    if record.mixed_scan is None:
        return says
    return f"{says}\nNext: the scan {record.mixed_scan.change} ({record.mixed_scan.program})."


def _shift_columns(fit: FitResult) -> list[ShiftColumn]:
    """Return the columns of background, first weight and first depth, moduli in percent."""
    values, most = fit.values, farthest_shifts(fit)
    columns = (("background_pa", "E0 %", 1), (_WEIGHT, "w %", 0), ("inclusion_1.z_m", "z mm", 1))

    def column(name: str, heading: str, digits: int) -> ShiftColumn:
        scale = 1e3 if name.endswith("_m") else 100 / values[name]
        return ShiftColumn(name, heading, lambda v: f"{scale * v:+.{digits}f}", most[name])

    return [column(*each) for each in columns if each[0] in most]
