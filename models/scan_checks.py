"""Checks of a measured table's values before it becomes a Scan.

Each check takes the table's columns (a dict from column name to array) and a `Where` that names a
cell as its author finds it. The first cell that breaks a rule is reported: its value, the expected
one and the cure.
"""

import itertools
from collections.abc import Mapping

import numpy as np

from models.errors import InputError
from models.scan_columns import (
    CONTACT_PHASES,
    DIRECTION,
    OUTCOME,
    OUTCOMES,
    PHASES,
    POINT,
    TEXT,
    TIP_POSITION,
    TIP_QUATERNION,
    Where,
    cut,
    nearest,
)

LARGEST_COORDINATE_M = 3.0
LARGEST_TRAVEL_M = 0.1
LARGEST_RADIUS_M = 0.05
FALLING = -0.5  # correlation of force and displacement within a press
LARGEST_TYPICAL_FORCE_N = 20.0
LARGEST_NUMBER = 1.0e6  # of newtons and metres: beyond any rig, whatever the unit
LARGEST_PRESS = 2.0**53  # above it a float64 no longer tells two whole numbers apart
LARGEST_TIME_S = 1.0e11  # the year 5138 since 1970
STIFFEST_BODY_PA = 1.0e6
UNIT_LENGTH_TOLERANCE = 1.0e-3
SAME_CONTACT_TOLERANCE = 1.0e-6

Columns = Mapping[str, np.ndarray]


def check_columns(columns: Columns, where: Where, units_checked: bool = False) -> None:
    """Check the values of all columns, cell by cell and press by press.

    Parameters
    ----------
    columns : `press` and all measured columns (m,) float64, `phase` text; `time_s` all NaN where
        unknown
    where : names the cells
    units_checked : skip the checks that guess a wrong unit from the size of the numbers

    Raises
    ------
    InputError
        At the first cell that breaks a rule.
    """
    if len(columns["press"]) == 0:
        raise InputError(
            f"{where.file}: the table has a header and no rows; expected one row a sample"
        )
    _check_finite(columns, where)
    _check_possible(columns, where)
    _check_epoch(columns["time_s"], where)
    _check_press_order(columns["press"], where)
    _check_words(columns["phase"], "phase", PHASES, where)
    if OUTCOME in columns:
        _check_words(columns[OUTCOME], OUTCOME, OUTCOMES, where)
    _check_radius(columns["probe_radius_m"], where)
    if not units_checked:
        _check_lengths(columns, where)
    _check_unit_length(columns, DIRECTION, where)
    if TIP_QUATERNION[0] in columns:
        _check_unit_length(columns, TIP_QUATERNION, where)
    _check_time(columns["time_s"], columns["press"], where)
    _check_one_contact_a_press(columns, where)
    _check_samples(columns, where)
    _check_any_reading(columns, where)
    _check_signs(columns, where)
    if not units_checked:
        _check_forces(columns, where)


def _check_finite(columns: Columns, where: Where) -> None:
    for name, values in columns.items():
        if name in TEXT or (name == "time_s" and np.isnan(values).all()):
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            hint = "; leave the whole column empty if times are unknown" if name == "time_s" else ""
            raise InputError(
                f"{where.cell(bad[0], name)}: found {values[bad[0]]} (empty or not a number), "
                f"expected a finite number; fill the cell in or remove the row{hint}"
            )


def _check_possible(columns: Columns, where: Where) -> None:
    for name, values in columns.items():
        if name in (*TEXT, "press", "time_s"):
            continue
        row = int(np.abs(values).argmax())
        if np.abs(values[row]) > LARGEST_NUMBER:
            raise InputError(
                f"{where.cell(row, name)}: found {values[row]:g}, expected a size below "
                f"{LARGEST_NUMBER:g}; correct the reading or remove the row"
            )


def _check_epoch(time: np.ndarray, where: Where) -> None:
    row = int(np.abs(time).argmax())  # all NaN gives the first row, which is then not greater
    if not np.abs(time[row]) > LARGEST_TIME_S:
        return
    units = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
    unit = next((u for u, s in units.items() if 1e8 < abs(time[row]) / s < 1e10), None)
    hint = "convert the times"
    if unit:
        hint = (
            f"this looks like {unit} since 1970: subtract the first time, divide by {units[unit]:g}"
        )
    raise InputError(
        f"{where.cell(row, 'time_s')}: found {time[row]:.10g} s, expected seconds, at most "
        f"{LARGEST_TIME_S:g} s; {hint}"
    )


def _check_press_order(press: np.ndarray, where: Where) -> None:
    bad = np.flatnonzero((press != np.round(press)) | (press < 0) | (press > LARGEST_PRESS))
    if len(bad):
        raise InputError(
            f"{where.cell(bad[0], 'press')}: found {press[bad[0]]:g}, expected a whole number "
            "0, 1, 2, ...; number the presses in the order in which they were made"
        )
    back = np.flatnonzero(np.diff(press) < 0) + 1
    if len(back):
        raise InputError(
            f"{where.cell(back[0], 'press')}: found {press[back[0]]:g} after "
            f"{press[back[0] - 1]:g}, expected numbers that do not fall; sort the rows in the "
            "order in which the presses were made"
        )


def _check_words(words: np.ndarray, column: str, known: tuple[str, ...], where: Where) -> None:
    bad = np.flatnonzero(~np.isin(words, known))
    if len(bad):
        found = cut(str(words[bad[0]]))
        cure = "; leave out the rows of presses that were not made" if column == OUTCOME else ""
        raise InputError(
            f"{where.cell(bad[0], column)}: found '{found}', expected one of "
            f"{', '.join(known)}{nearest(found, known)}{cure}"
        )


def _check_radius(radius: np.ndarray, where: Where) -> None:
    bad = np.flatnonzero(radius <= 0)
    if len(bad):
        raise InputError(
            f"{where.cell(bad[0], 'probe_radius_m')}: found {radius[bad[0]]:g} m, expected the "
            "radius of the tip, greater than 0"
        )


def _check_lengths(columns: Columns, where: Where) -> None:
    touching = np.isin(columns["phase"], CONTACT_PHASES)
    limits = {name: LARGEST_COORDINATE_M for name in POINT + TIP_POSITION}
    limits |= {"displacement_m": LARGEST_TRAVEL_M, "probe_radius_m": LARGEST_RADIUS_M}
    for name, limit in limits.items():
        if name not in columns:
            continue
        size = np.abs(columns[name])
        if name == "displacement_m":
            size = np.where(touching, size, 0.0)
        row = int(size.argmax())
        if size[row] > limit:
            alone = np.count_nonzero(size > limit) == 1 and len(size) > 1
            do = "correct the reading or remove the row" if alone else "divide by 1000"
            what = "" if alone else "this looks like millimetres: "
            raise InputError(
                f"{where.cell(row, name)}: found {columns[name][row]:g} m, expected at most "
                f"{limit:g} m; {what}{do} ({where.units_escape})"
            )


def _check_unit_length(columns: Columns, names: tuple[str, ...], where: Where) -> None:
    length = np.sqrt(sum(columns[name] ** 2 for name in names))
    bad = np.flatnonzero(np.abs(length - 1) > UNIT_LENGTH_TOLERANCE)
    if len(bad):
        raise InputError(
            f"{where.cell(bad[0], ', '.join(names))}: found a length of {length[bad[0]]:.6g}, "
            f"expected 1 within {UNIT_LENGTH_TOLERANCE:g}; divide the components by their length"
        )


def _check_time(time: np.ndarray, press: np.ndarray, where: Where) -> None:
    bad = np.flatnonzero(np.diff(time) <= 0) + 1
    if len(bad):
        anew = press[bad[0]] != press[bad[0] - 1] or time[bad[0]] <= time[0]
        hint = ", or join two scans with `palpmap join --pause`" if anew else ""
        raise InputError(
            f"{where.cell(bad[0], 'time_s')}: found {time[bad[0]]:.10g} s after "
            f"{time[bad[0] - 1]:.10g} s, expected a time that increases from row to row over the "
            f"whole scan; sort the rows by time or add the start time of each press{hint}"
        )


def _check_one_contact_a_press(columns: Columns, where: Where) -> None:
    same_press = np.diff(columns["press"]) == 0
    for name in (*POINT, *DIRECTION, "probe_radius_m"):
        moved = np.abs(np.diff(columns[name])) > SAME_CONTACT_TOLERANCE
        bad = np.flatnonzero(same_press & moved) + 1
        if len(bad):
            row = bad[0]
            raise InputError(
                f"{where.cell(row, name)}: found {columns[name][row]:.9g} after "
                f"{columns[name][row - 1]:.9g} inside press {columns['press'][row]:g}, expected "
                "one value a press (contact point on the undeformed surface, direction, tip); "
                "the moving tip belongs into displacement_m"
            )


def _check_samples(columns: Columns, where: Where) -> None:
    ids, first = np.unique(columns["press"], return_index=True)
    touching = np.isin(columns["phase"], CONTACT_PHASES)
    counts = np.add.reduceat(touching.astype(int), first)
    bad = np.flatnonzero(counts < 2)
    if len(bad):
        found = int(counts[bad[0]])
        raise InputError(
            f"{where.cell(first[bad[0]], 'press')}: press {ids[bad[0]]:g} has {found} "
            f"sample{'s' * (found != 1)} with phase load, hold or unload, expected at least 2; "
            "complete the press or remove it"
        )


def _check_any_reading(columns: Columns, where: Where) -> None:
    touching = np.isin(columns["phase"], CONTACT_PHASES)
    for name in ("force_n", "displacement_m"):
        if not np.any(columns[name][touching]):
            raise InputError(
                f"{where.file}, column {name}: found 0 in all rows of load, hold and unload, "
                "expected readings; check how the column was exported"
            )


def _peaks(values: np.ndarray, press: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value of largest size in each press, sign kept, and its row."""
    bounds = np.append(np.unique(press, return_index=True)[1], len(press))
    rows = np.array([a + np.abs(values[a:b]).argmax() for a, b in itertools.pairwise(bounds)])
    return values[rows], rows


def _check_signs(columns: Columns, where: Where) -> None:
    touching = np.flatnonzero(np.isin(columns["phase"], CONTACT_PHASES))
    press = columns["press"][touching]
    # A press in the air reads noise, and what the sensor's zero has drifted by, of either sign
    for name, by_noise, meaning in (
        ("force_n", 0.5, "the force that presses into the body counts positive"),
        ("displacement_m", 0.2, "travel into the body since first touch counts positive"),
    ):
        peak, row = _peaks(columns[name][touching], press)
        bad = np.flatnonzero(peak < -by_noise * np.median(np.abs(peak)))
        if len(bad):
            many = len(bad) > len(peak) / 2
            what = f"change the sign of {name}" if many else "correct or remove this press"
            at = touching[row[bad[0]]]
            raise InputError(
                f"{where.cell(at, name)}: found {peak[bad[0]]:g} as the largest value of press "
                f"{press[row[bad[0]]]:g} ({len(bad)} of {len(peak)} presses are like this), "
                f"expected a positive one: {meaning}; {what}"
            )
    starts = np.unique(press, return_index=True)[1]
    f, d = columns["force_n"][touching], columns["displacement_m"][touching]
    size = np.diff(np.append(starts, len(press)))
    df, dd = (x - np.repeat(np.add.reduceat(x, starts) / size, size) for x in (f, d))
    spread = np.sqrt(np.add.reduceat(df**2, starts) * np.add.reduceat(dd**2, starts))
    together = np.add.reduceat(df * dd, starts) / np.maximum(spread, 1e-300)
    if np.median(together) < FALLING:  # noise alone, in a hold, is about as often below 0 as above
        at = touching[starts[np.flatnonzero(together < 0)[0]]]
        raise InputError(
            f"{where.cell(at, 'displacement_m')}: found a displacement that falls while force_n "
            f"rises, in {np.count_nonzero(together < 0)} of {len(starts)} presses, expected both "
            "to rise; displacement_m is the tip's travel into the body since first touch"
        )


def _check_forces(columns: Columns, where: Where) -> None:
    touching = np.flatnonzero(np.isin(columns["phase"], CONTACT_PHASES))
    press = columns["press"][touching]
    force, row = _peaks(columns["force_n"][touching], press)
    travel, _ = _peaks(columns["displacement_m"][touching], press)
    radius = columns["probe_radius_m"][touching][row]
    # Flat punch on a half-space: F = 2 E a d / (1 - nu^2); the smallest E this force can mean.
    modulus = force / (2 * radius * np.maximum(travel, 1e-9))
    typical, stiff = np.median(force), np.median(modulus)
    if typical <= LARGEST_TYPICAL_FORCE_N and stiff <= STIFFEST_BODY_PA:
        return
    at = int(np.argmax(force))
    raise InputError(
        f"{where.cell(touching[row[at]], 'force_n')}: found {force[at]:g} N (typical press: "
        f"{typical:.3g} N, a body of {stiff / 1e3:.3g} kPa), expected at most "
        f"{LARGEST_TYPICAL_FORCE_N:g} N and {STIFFEST_BODY_PA / 1e3:g} kPa of a soft body; this "
        "looks like grams (divide by 101.97) or millinewtons (divide by 1000) "
        f"({where.units_escape})"
    )
