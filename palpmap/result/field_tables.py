"""Tables of a free map: its spots, and the reach of the scan."""

from collections.abc import Sequence

import numpy as np

from identify.effects import percent
from identify.fit import SPOTS, Area, Field, FitResult, RegionEstimate, Spot
from models import Scan
from palpmap import units
from palpmap.result.tables import Cell, Table, number

_LISTED_AREAS = 6  # of dozens in a dense scan; fit.json has them all
_SMOOTHNESS = {
    0.5: "0.5, which bends at steep walls",
    1.5: "1.5, for gradual changes",
}


def field_tables(fit: FitResult, origin_m: np.ndarray, scan: Scan) -> tuple[Table, ...]:
    """Return the tables of a free map: regions, spots, areas, sight; none of another map.

    Positions are in the scan's frame.
    """
    field = fit.field
    if field is None:
        return ()
    regions = (_region_table(field.regions),) if field.regions else ()
    explained = fit.chi2_per_dof < SPOTS.explained
    spots = _spot_table(field.spots, fit.success, explained, origin_m)
    odds = () if explained or not field.spots else (
        "odds of the spots",
        f"they trust noise and contact law, which leave {fit.chi2_per_dof:.2g} times the misfit of "
        "noise: believe no spot that the presses' own stiffness does not show",
    )  # fmt: skip
    rim = _rim(field.spots, origin_m)
    return (
        *regions,
        spots,
        *((_area_table(field.areas, explained, origin_m),) if field.areas else ()),
        _sight_table(field, scan, (odds, _open(field.spots, scan.probe_radius_m), rim)),
    )


def _open(spots: Sequence[Spot], radius_m: np.ndarray) -> tuple[str, ...]:
    """Return the row of the spots that may be wider than any ball, if there are any."""
    if not any(spot.wide for spot in spots):
        return ()
    return (
        "open",
        "no ball that was tried is as wide: the scan tells where such a spot lies from above, not "
        "how deep, how large or how hard; fit inclusions"
        + (", or press with a second tip" if np.ptp(radius_m) == 0 else ""),
    )


def _rim(spots: Sequence[Spot], origin_m: np.ndarray) -> tuple[str, ...]:
    """Return the row of the sure spots that the presses do not reach around, if there are any."""
    cut = [s for s in spots if s.probability >= SPOTS.probable and s.at_rim]
    if not cut:
        return ()
    x, y, _ = origin_m
    places = " and ".join(f"({1e3 * (s.x_m + x):.1f}, {1e3 * (s.y_m + y):.1f}) mm" for s in cut)
    return (
        "at the rim",
        f"{places}: felt from one side alone, where a side of the body that lies elsewhere than "
        "stated or assumed is felt, too; press beyond it, or state the sides",
    )


def _spot_table(
    spots: Sequence[Spot], success: bool, explained: bool, origin_m: np.ndarray
) -> Table:
    """Return the spots; a row says so if there are none. It fits into a terminal of 80 columns."""
    head = ("Spot", *map(number, ("x, y, z in mm", "+- mm", "Size, mm", "Contrast (95 %)",
            "Probability")))  # fmt: skip
    rows = [
        (
            Cell("hard" if s.contrast > 1 else "soft", "good" if s.found and explained else "dim"),
            _place(s, origin_m),
            f"{1e3 * s.place_sd_m:.1f}",
            _size(s),
            "open" if s.wide
            else f"{_contrast(s.contrast)} ({_contrast(s.lower95)} to {_contrast(s.upper95)})",
            Cell(f"{s.probability:.2f}" if s.probability < 0.995 else "> 0.99",
                 "good" if s.found and explained else "dim"),
        )
        for s in spots
    ]  # fmt: skip
    none = "none: no ball beside the map's own changes"
    rows = rows or [(none if success else "not looked for: the search did not end",)]
    return Table.of(head[: len(rows[0])], rows, "spots")


def _area_table(areas: Sequence[Area], explained: bool, origin_m: np.ndarray) -> Table:
    """Return the areas whose presses feel a harder or softer body than the others."""
    head = ("From above", *map(number, ("x, y in mm", "Size, mm", "Presses", "Felt, times (95 %)")))
    x, y, _ = origin_m
    rows: list[tuple[Cell | str, ...]] = [
        (
            Cell(
                f"{'hard' if a.contrast > 1 else 'soft'} area" + " (rim)" * a.at_rim,
                "good" if explained and not a.at_rim else "dim",
            ),
            f"{1e3 * (a.x_m + x):.1f}, {1e3 * (a.y_m + y):.1f}",
            f"{1e3 * a.length_m:.0f} x {1e3 * a.width_m:.0f}",
            str(a.presses),
            f"{a.contrast:.3g} ({a.lower95:.3g} to {a.upper95:.3g})",
        )
        for a in areas[:_LISTED_AREAS]
    ]
    smaller = len(areas) - len(rows)
    if smaller > 0:
        rows.append((f"and {smaller} more", "", "", "", ""))
    return Table.of(head, rows, "areas")


def _region_table(regions: Sequence[RegionEstimate]) -> Table:
    head = ("Region", *map(number, ("Modulus", "95 % interval", "Seen")))
    rows = [
        (
            str(r.label),
            units.quantity(r.modulus_pa, "Pa"),
            units.interval(r.lower95_pa, r.upper95_pa, "Pa"),
            Cell(percent(r.seen), "good" if r.seen >= SPOTS.seen else "dim"),
        )
        for r in regions
    ]
    return Table.of(head, rows, "regions")


def _place(spot: Spot, origin_m: np.ndarray) -> str:
    x, y, z = (f"{1e3 * v:.1f}" for v in np.add((spot.x_m, spot.y_m, spot.z_m), origin_m))
    return f"{x}, {y}, open" if spot.wide else f"{x}, {y}, {z}"


def _size(spot: Spot) -> str:
    """Return the interval of the diameter, or its one limit, mm."""
    if spot.wide:
        least = spot.diameter_lower95_m
        return f"over {1e3 * least:.0f}" if least else "open"
    if spot.diameter_lower95_m is None or spot.diameter_upper95_m is None:
        return f"{1e3 * spot.diameter_m:.0f}"
    most = f"{1e3 * spot.diameter_upper95_m:.0f}"
    least = 1e3 * spot.diameter_lower95_m
    return f"{least:.0f} to {most}" if least else f"at most {most}"


def _contrast(ratio: float) -> str:
    """Return a contrast with two digits.

    >>> [_contrast(ratio) for ratio in (0.352, 6.04, 41.3, 2740.0)]
    ['0.35', '6', '41', '2700']
    """
    return f"{float(f'{ratio:.2g}'):g}"


def _listed(presses: Sequence[int], most: int = 8) -> str:
    """Return numbers of presses, the first few of many."""
    more = f" and {len(presses) - most} more" if len(presses) > most else ""
    return ", ".join(str(p) for p in presses[:most]) + more


def _sight(depth_m: float, labelled: bool) -> str:
    """Return the depth of sight; of labelled regions it is that of the changes within one.

    >>> _sight(0.0123, labelled=False)
    '12.30 mm, at the middle press'
    >>> _sight(0.0123, labelled=True)
    '12.30 mm at the middle press, for changes within its region'
    >>> _sight(0.0, labelled=True)
    'changes within a region are seen at no depth, the regions as their table says'
    """
    if not labelled:
        return f"{units.quantity(depth_m, 'm')}, at the middle press"
    if not depth_m:
        return "changes within a region are seen at no depth, the regions as their table says"
    return f"{units.quantity(depth_m, 'm')} at the middle press, for changes within its region"


def _sight_table(field: Field, scan: Scan, notes: Sequence[tuple[str, ...]]) -> Table:
    """Return the reach of a scan and the free map's prior."""
    hyper = field.hyper

    def by(name: str) -> str:
        return "as given" if name in hyper.given else "by evidence"

    error = "none" if not hyper.error else (
        f"{100 * hyper.error:.2g} % of each press's compliance: the noise is not the limit, and "
        "the map follows the presses no closer"
    )  # fmt: skip
    ids = scan.used().press_ids
    errs = ids[field.errs].tolist()
    slipped = ids[np.flatnonzero(field.slips >= SPOTS.possible)].tolist()
    ball = "seen at no depth for sure, as the map may vary as much by itself"
    if any(spot.found for spot in field.spots):
        ball += "; the spots found are harder, softer or larger"
    if field.ball_sight_m:
        ball = f"seen down to {units.quantity(field.ball_sight_m, 'm')} under the middle press"
    rows = (
        *(note for note in notes if note),
        (
            "ordinary press",
            f"fitted to {percent(field.ordinary_error)} of its compliance; met within "
            f"{percent(field.left_out_error)} by a map of the other four fifths of the presses",
        ),
        *((("presses weighted down", _listed(errs)),) if errs else ()),
        *(
            (
                (
                    "presses that slipped",
                    f"{_listed(slipped)}: their neighbours feel no ball; press there again",
                ),
            )
            if slipped
            else ()
        ),
        ("depth of sight", _sight(field.sight_m, bool(field.regions))),
        (f"a ball of {1e3 * SPOTS.ball_m:.0f} mm, {SPOTS.ball_contrast:.0f} times as hard", ball),
        ("length", f"{units.quantity(hyper.length_m, 'm')}, {by('length_m')}"),
        ("smoothness", _SMOOTHNESS[hyper.smoothness]),
        ("spread of ln E", f"{hyper.spread:.2g}, {by('spread')}"),
        ("effective parameters", f"{field.effective:.0f}"),
        ("log evidence", f"{field.log_evidence:.1f}"),
        ("error of the model", error),
    )
    return Table.of(("", ""), rows, "free map")
