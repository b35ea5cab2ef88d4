"""Detection limits on the console."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from identify.design.detection_limits import SHARE
from identify.fit.result import FitResult
from palpmap.report.diagnose_console import untestable_lines

if TYPE_CHECKING:
    from rich.console import RenderableType

_WEIGHT = "inclusion_1.weight_pa"


def limits_table(record: Mapping[str, Any], fit: FitResult) -> tuple["RenderableType", ...]:
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
