"""Report and console tables of two runs on one body."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identify.residual import RunDifference
from palpmap import units
from palpmap.report.draw import console, write_page
from palpmap.result.tables import Cell, Table, number
from palpmap.study.frame import frame_shift_m

if TYPE_CHECKING:
    from rich.console import RenderableType


def title_of(d: RunDifference) -> str:
    """Return the outcome in a few words."""
    maps = "The maps differ" if d.maps_differ else "The maps agree"
    if not d.beside_maps:
        return maps
    too = "and so do" if d.maps_differ else "but not the"
    return f"{maps}, {too} effects that change the stiffness beside them"


def statement_of(d: RunDifference, origin_m: np.ndarray) -> str:
    """Return the outcome in a few sentences."""
    at, ratio = d.largest, float(np.exp(d.log_ratio[d.largest]))
    x, y, z = 1e3 * (d.grid.points_m[at] + origin_m)
    far = abs(d.standard_errors[at])
    where = (
        f"The largest difference is at ({x:.0f}, {y:.0f}, {z:.0f}) mm: the other map is "
        f"{ratio:.3g} times the one there, {far:.1f} standard errors off "
        f"(p {units.p_value(d.p_value)} among {d.independent})"
    )
    if far < 1:
        where = (
            f"The largest difference, at ({x:.0f}, {y:.0f}, {z:.0f}) mm, is smaller than its "
            f"error, {far:.1f} of it: there the two scans cannot tell the maps apart"
        )
    alone = _effects(c.name for c in d.changed if None in (c.one, c.other))
    other = _effects(c.name for c in d.changed if None not in (c.one, c.other))
    instrument = "" if alone or other else " No effect differs."
    if alone:
        instrument = (
            f" In one run alone: {', '.join(alone)}; the maps were found beside different models, "
            "and may differ by that."
        )
    if other:
        instrument += f" Effects with other values: {', '.join(other)}."
    held = f" The maps are those with {', '.join(d.in_maps)} in them." if d.in_maps else ""
    beside = (
        f" The stiffness is not in the maps alone; of what changes it beside them, the runs differ "
        f"in: {', '.join(d.beside_maps)}."
    )
    return f"{where}.{instrument}{held}{beside if d.beside_maps else ''}"


def _effects(names: Iterable[str]) -> list[str]:
    """Return the effects of some parameters, each once; those of a map are none.

    >>> _effects(["force_drift.rate_n_per_s", "inclusion_1.x_m", "background_pa"])
    ['force_drift']
    """
    effects = dict.fromkeys(name.rpartition(".")[0] for name in names if not units.is_of_map(name))
    return list(effects)


def changes_table(d: RunDifference, origin_m: np.ndarray) -> Table:
    """Return the parameters of both runs, positions in the scan's frame."""
    rows = []
    for change in d.changes:
        shift = frame_shift_m(change.name, origin_m)
        one, other = (
            "not in it" if value is None else units.quantity(value + shift, change.unit)
            for value in (change.one, change.other)
        )
        error = change.standard_errors
        far = error is None or abs(error) > 3
        rows.append(
            (change.name, one, other, Cell("" if error is None else f"{error:+.1f}",
             "bad" if far else ""))
        )  # fmt: skip
    head = ("Parameter", *map(number, ("The one", "The other", "Standard errors")))
    return Table.of(head, rows)


def difference_summary(d: RunDifference, origin_m: np.ndarray) -> "list[RenderableType]":
    """Return the outcome for a console."""
    return [
        f"[bold]{title_of(d)}[/bold]",
        statement_of(d, origin_m),
        console(changes_table(d, origin_m)),
    ]


def write_difference_report(
    d: RunDifference,
    path: Path,
    *,
    names: Sequence[str],
    origin_m: np.ndarray,
    notes: Sequence[str],
    pictures: Mapping[str, bytes],
    how: Mapping[str, str],
) -> None:
    """Write the report: the outcome with its picture, and the parameters of both runs."""
    name, other = names
    write_page(
        path,
        "difference.html",
        name=name,
        other=other,
        title=title_of(d),
        differ=d.bodies_differ,
        statement=statement_of(d, origin_m),
        changes=changes_table(d, origin_m),
        notes=tuple(notes),
        pictures=pictures,
        how=Table.of(("", ""), how.items()),
    )
