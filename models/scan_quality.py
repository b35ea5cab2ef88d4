"""Implausible readings of a Scan, found from the table alone.

All tests compare readings of one press with each other, or presses with each other; none needs a
mesh or a modulus. Each returns findings that name the press, and the row where there is one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import InputError
from models.scan import Scan
from models.scan_neighbours import too_strong
from models.scan_readings import bad_readings, presses_of
from models.scan_units import too_slow, too_stiff

NO_FORCE = 0.05  # of the largest force: below it the tip is taken to be free
LITTLE_FORCE = 0.3  # of a typical press's largest: only below it can a rise be none
NO_RISE = 3.0  # standard deviations of the force's slope over travel
FREE_TRAVEL = 0.35  # of the largest travel; a sphere's force is below NO_FORCE up to 0.14
FREE_OF_ONE = 0.55  # the same of a single reading
STEEPEST = 4.0  # power of the travel with which no force of a body rises
FREE_RISE = 0.015  # of the largest force, from the first to the last third of the free travel
CLIPPED_ROWS = 3
CLIPPED_TRAVEL = 0.1  # of the largest travel, made while the force reads its largest value
COLLAPSE = 0.1  # of the force before it
LISTED = 5
OUTLYING = ("clipped", "no_contact", "collapsed", "repeated_press", "force_unit",
            "lone_force")  # fmt: skip
"""Kinds of doubt whose presses are to be left out."""


@dataclass(frozen=True)
class Doubt:
    """A doubt about some presses.

    Attributes
    ----------
    kind : bad_reading, free_travel, clipped, no_contact, collapsed, missing_phase, repeated_press,
        force_unit, lone_force, time_unit
    presses : ids of the presses
    rows : rows (0-based) of the table, where single readings are meant
    sentence : the finding, its place, and the cure
    """

    kind: str
    presses: tuple[int, ...]
    rows: tuple[int, ...]
    sentence: str

    @property
    def leaves_out(self) -> bool:
        """True if `without_outliers` leaves its readings or presses out."""
        return bool(self.rows) or self.kind in OUTLYING


def scan_findings(scan: Scan) -> list[Doubt]:
    """Return all doubts about a Scan, single readings first."""
    rows = np.flatnonzero(scan.in_contact)
    used = scan.rows(rows)
    wrong = bad_readings(used)
    found = [
        _bad_reading(scan, int(rows[row]), column, value, expected)
        for row, column, value, expected in wrong
    ]
    others = used.rows(~np.isin(np.arange(len(used)), [row for row, *_ in wrong]))
    bad = {press for finding in found for press in finding.presses}
    tests: Sequence[tuple[str, Callable[[Scan], list[int]], str]] = (
        ("clipped", _clipped, "the force stays at one largest value while the tip goes on into "
         "the body: the sensor was at its limit; press less deep or leave these presses out"),
        ("no_contact", _without_contact, "the force does not rise with the travel, or the hold is "
         "below 5 % of a typical press's force: the tip met no body; no model is fitted to these "
         "presses; check place and depth"),
        ("collapsed", _collapsed, "the force falls to a tenth or less while the tip stays in the "
         "body: the tip slipped or the sensor failed; leave these presses out"),
    )  # fmt: skip
    for kind, test, words in tests:
        presses = [press for press in test(others) if press not in bad]
        if presses:
            found.append(Doubt(kind, tuple(presses), (), f"{_named(presses, used)}: {words}."))
    found += _free_travel(others) + _missing_phases(used) + _repeated(used)
    return found + _other_units(others)


def without_outliers(scan: Scan) -> tuple[Scan, tuple[str, ...]]:
    """Return a Scan without its bad readings and outlying presses, and a sentence for each.

    A press with fewer than two readings in contact after that is omitted as a whole.

    Raises
    ------
    InputError
        No press would be left.

    Examples
    --------
    >>> import palpmap as pm
    >>> scan = pm.read_scan("tests/data/twelve_presses/scan.csv")
    >>> force = scan.force_n.copy()
    >>> force[5] = 30.0
    >>> left, sentences = without_outliers(scan.replace(force_n=force))
    >>> len(scan) - len(left), sentences  # doctest: +NORMALIZE_WHITESPACE
    (1, ('Left out: Row 6 (press 0), column force_n: found 30 N, expected about 0.2226 N by its
    press and the others.',))
    """
    keep, sentences = np.ones(len(scan), dtype=bool), []
    for doubt in scan_findings(scan):
        if not doubt.leaves_out:
            continue
        keep[list(doubt.rows) if doubt.rows else np.isin(scan.press, doubt.presses)] = False
        sentences.append(f"Left out: {doubt.sentence.split(';')[0].rstrip('.')}.")
    touching = np.bincount(scan.press_index, keep & scan.in_contact, len(scan.press_ids))
    keep &= touching[scan.press_index] >= 2
    if not keep.any():
        raise InputError("found no press without doubtful readings, expected some; measure again")
    return scan.rows(keep), tuple(sentences)


def identical_presses(scan: Scan) -> list[tuple[int, int]]:
    """Return pairs of press ids with the same place and the very same readings, later one last.

    Two measurements never have the same noise; presses whose readings are all whole multiples of
    a coarse step need at least four different forces to count.
    """
    first: dict[bytes, int] = {}
    pairs = []
    used = scan.used()
    for press, rows in presses_of(used):
        parts = (used.point_m[rows], used.direction[rows], used.force_n[rows])
        key = b"".join(part.tobytes() for part in (*parts, used.displacement_m[rows]))
        if len(np.unique(used.force_n[rows])) < 4:
            continue
        if key in first:
            pairs.append((first[key], press))
        first.setdefault(key, press)
    return pairs


def _named(presses: Sequence[int], scan: Scan) -> str:
    some = ", ".join(map(str, presses[:LISTED])) + (" ..." if len(presses) > LISTED else "")
    return f"Press {some} ({len(presses)} of {len(scan.press_ids)})"


def _bad_reading(scan: Scan, row: int, column: str, found: float, expected: float) -> Doubt:
    press, unit = int(scan.press[row]), "N" if column == "force_n" else "m"
    return Doubt(
        "bad_reading",
        (press,),
        (row,),
        f"Row {row + 1} (press {press}), column {column}: found {found:.4g} {unit}, expected about "
        f"{expected:.4g} {unit} by its press and the others; correct the reading or remove the "
        "row.",
    )


def _clipped(scan: Scan) -> list[int]:
    largest = scan.force_n.max()
    found = []
    for press, rows in presses_of(scan):
        at, load = scan.force_n[rows] == largest, scan.phase[rows] == "load"
        travel = scan.displacement_m[rows]
        way = float(np.ptp(travel[at & load])) if np.any(at & load) else 0.0
        if np.sum(at) >= CLIPPED_ROWS and way > CLIPPED_TRAVEL * travel.max():
            found.append(press)
    return found


def touching(scan: Scan) -> Scan:
    """Return a Scan without the presses that met no body; all of it where none did.

    Such a press tells no stiffness, and its point lies on no surface. `scan_findings` names them.
    """
    missed = _without_contact(scan.used())
    if not missed or len(missed) == len(scan.press_ids):
        return scan
    return scan.rows(~np.isin(scan.press, missed))


def _without_contact(scan: Scan) -> list[int]:
    """Presses without any force, held at almost none, or with one that noise alone explains.

    Noise is told by the third differences within presses, robustly; the slope of force over travel
    then has the standard deviation noise / sqrt(sum of squares of the travel).
    """
    presses = presses_of(scan)
    typical = float(np.median([scan.force_n[rows].max() for _, rows in presses]))
    rough = np.concatenate([np.diff(scan.force_n[rows], 3) for _, rows in presses])
    noise = 1.4826 * float(np.median(np.abs(rough))) / np.sqrt(20) if len(rough) else 0.0
    found = []
    for press, rows in presses:
        force, travel = scan.force_n[rows], scan.displacement_m[rows]
        held = force[scan.phase[rows] == "hold"]
        away = travel - travel.mean()
        rise, size = float(away @ force), float(np.sqrt(away @ away))
        none = len(force) > 3 and rise <= NO_RISE * noise * size
        if not force.any() or (none and force.max() < LITTLE_FORCE * typical):
            found.append(press)
        elif len(held) and held.max() < NO_FORCE * typical:
            found.append(press)
    return found


def _collapsed(scan: Scan) -> list[int]:
    """Presses whose force falls from one reading to the next and stays down, the tip inside."""
    found = []
    typical = np.median([scan.force_n[rows].max() for _, rows in presses_of(scan)])
    for press, rows in presses_of(scan):
        going = scan.phase[rows] != "unload"
        force, travel = scan.force_n[rows][going], scan.displacement_m[rows][going]
        if len(force) < 3:
            continue
        after = np.maximum.accumulate(force[::-1])[::-1][1:]  # the largest force from here on
        still_in = np.minimum.accumulate(travel[::-1])[::-1][1:] >= 0.9 * travel[:-1]
        fell = (force[:-1] > 0.3 * typical) & (after < COLLAPSE * force[:-1]) & still_in
        if np.any(fell[:-1]):  # two readings and more stay down: one alone is a bad reading
            found.append(press)
    return found


def _free_travel(scan: Scan) -> list[Doubt]:
    """Find travel that was counted from above the surface: the tip moves and feels nothing."""
    free, rises = {}, []
    for press, rows in presses_of(scan):
        load = scan.phase[rows] == "load"
        force, travel = scan.force_n[rows][load], scan.displacement_m[rows][load]
        if len(force) < 3:
            continue
        zero = scan.force_n[rows].min()  # also of the way back: the first reading may bear a load
        force = force - zero
        touch = int(np.argmax(force > NO_FORCE * force.max()))
        share = travel[0] / travel.max()
        if touch < 2:  # one reading alone, as of a ball, cannot say that nothing was felt
            touch = int(share > FREE_OF_ONE and force[0] < share**STEEPEST * force.max())
        if touch and travel[touch - 1] > FREE_TRAVEL * travel.max():
            free[press] = travel[touch - 1]
            third = max(touch // 3, 1)
            begin, end = force[:third].mean(), force[touch - third : touch].mean()
            rises.append((end - begin) / force.max())
    if not free or np.median(rises) > FREE_RISE:  # a body that stiffens is felt from the start
        return []
    start = np.array(list(free.values())) * 1e3
    about = (
        f"{start.min():.3g}" if np.ptp(start) < 0.05 else f"{start.min():.3g} to {start.max():.3g}"
    )
    sentence = (
        f"{_named(list(free), scan)}: the tip travels without force at first: displacement_m is "
        f"counted from above the surface; count it from first touch (now at about {about} mm)."
    )
    return [Doubt("free_travel", tuple(free), (), sentence)]


def _missing_phases(scan: Scan) -> list[Doubt]:
    found = []
    presses = presses_of(scan)
    for phase in ("load", "hold", "unload"):
        without = [press for press, rows in presses if not np.any(scan.phase[rows] == phase)]
        if without and (phase == "load" or len(without) < len(presses) / 2):
            others = "" if len(without) == len(presses) else ", as the others have"
            sentence = f"{_named(without, scan)}: no row of phase {phase}{others}; check the cut."
            found.append(Doubt("missing_phase", tuple(without), (), sentence))
    return found


def _repeated(scan: Scan) -> list[Doubt]:
    pairs = identical_presses(scan)
    if not pairs:
        return []
    presses = tuple(later for _, later in pairs)
    first, later = pairs[0]
    sentence = (
        f"{_named(presses, scan)}: the same readings as an earlier press at the same place "
        f"(press {later} as press {first}); the same noise twice makes the map look surer than it "
        "is: keep each press once."
    )
    return [Doubt("repeated_press", presses, (), sentence)]


def _other_units(scan: Scan) -> list[Doubt]:
    stiff, felt = too_stiff(scan), touching(scan)
    strong = too_strong(felt.rows(~np.isin(felt.press, list(stiff))))
    forces = (
        ("force_unit", stiff, "about {:.0f} times those of the others at the same travel, as no "
         "soft body shows; if these are millinewtons divide by 1000, else leave the presses out."),
        ("lone_force", strong, "{:.1f} times those of any press beside it at the same travel, "
         "nearer than a hard spot could hide; check zero and gain of the sensor there, or leave "
         "the presses out."),
    )  # fmt: skip
    found = []
    for kind, larger, times in forces:
        if larger:
            said = times.format(np.median(list(larger.values())))
            sentence = f"{_named(list(larger), scan)}: forces {said}"
            found.append(Doubt(kind, tuple(larger), (), sentence))
    if slow := too_slow(scan):
        sentence = (
            f"A press lasts {slow[0]:.4g} s, its readings {slow[1]:.4g} s apart, by time_s: if "
            "these are milliseconds divide by 1000."
        )
        found.append(Doubt("time_unit", (), (), sentence))
    return found
