"""Report and console tables of a prediction."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identify.effects import digits
from identify.residual import Prediction, length
from palpmap import units
from palpmap.report.draw import console, write_page
from palpmap.result.tables import Table, number

if TYPE_CHECKING:
    from rich.console import RenderableType

TITLES = {
    "calibrated": "The prediction holds",
    "too narrow": "The errors exceed the bands",
    "too wide": "The prediction holds, its bands are too wide",
}


def statement_of(p: Prediction) -> str:
    """Return the outcome in two sentences."""
    share = np.abs(p.force_error_share)
    size = (
        f"At the largest force of a press the error of the force is {100 * np.median(share):.2g} % "
        f"(median; nine of ten below {100 * np.quantile(share, 0.9):.2g} %), that of the travel "
        f"{units.rms(float(np.sqrt(np.mean(p.press_error_m**2))))} rms"
    )
    within = (
        f"{round(p.within95 * p.presses)} of {p.presses} presses lie in their 95 % bands, and "
        f"chi-square per press is {digits(p.chi2 / p.presses)}"
    )
    return f"{size}. {within}: {_VERDICTS[p.verdict].format(digits(p.band_over_error))}."


_VERDICTS = {
    "calibrated": "the bands are calibrated",
    "too narrow": "the errors are larger than the bands say, so that the model lacks something "
    "that this scan shows",
    "too wide": "the bands are too wide, {} times what these errors ask for: a cautious prediction",
}


def parts_table(p: Prediction) -> Table:
    """Return the standard deviation of the travel near the largest forces, by cause."""
    near = p.scan.near_largest_force
    parts = {**p.parts_m, "all together, one reading": p.sd_m}
    rows = [
        (cause, length(float(np.sqrt(np.mean(sd[near] ** 2))), signed=False))
        for cause, sd in parts.items()
    ]
    return Table.of(("Cause", number("Standard deviation, rms")), rows)


def worst_table(p: Prediction, origin_m: np.ndarray) -> Table:
    """Return the presses whose errors are the most bands long, places in the scan's frame."""
    z = p.press_error_m / p.press_sd_m
    places = 1e3 * (p.scan.contact_points + origin_m)
    rows = (
        (
            f"press {p.scan.press_ids[j]}",
            ", ".join(f"{v:.1f}" for v in places[j]),
            length(float(p.press_error_m[j])),
            f"{100 * p.force_error_share[j]:+.1f} %",
            f"{z[j]:+.1f}",
        )
        for j in np.argsort(-np.abs(z))[:8]
    )
    head = ("Press", *map(number, ("x, y, z in mm", "Measured less predicted travel",
            "The same as a force", "Over the band's sd")))  # fmt: skip
    return Table.of(head, rows)


def prediction_summary(p: Prediction, origin_m: np.ndarray) -> "list[RenderableType]":
    """Return the outcome for a console."""
    return [
        f"[bold]{TITLES[p.verdict]}[/bold]",
        statement_of(p),
        console(parts_table(p)),
        console(worst_table(p, origin_m)),
    ]


def write_prediction_report(
    p: Prediction,
    path: Path,
    *,
    name: str,
    other: str,
    origin_m: np.ndarray,
    notes: Sequence[str],
    pictures: Mapping[str, bytes],
    how: Mapping[str, str],
) -> None:
    """Write the report: the outcome with its picture, what the bands hold, the worst presses."""
    write_page(
        path,
        "predict.html",
        name=name,
        other=other,
        p=p,
        title=TITLES[p.verdict],
        passed=p.verdict != "too narrow",
        statement=statement_of(p),
        parts=parts_table(p),
        presses=worst_table(p, origin_m),
        notes=tuple(notes),
        pictures=pictures,
        how=Table.of(("", ""), how.items()),
    )
