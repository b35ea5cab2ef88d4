"""Several scans of one body as one table."""

from collections.abc import Sequence

import numpy as np

from models.arguments import kinds_checked
from models.errors import InputError
from models.scan import Scan
from models.scan_quality import identical_presses

OPTIONAL = {"force_vector_n": "fx_n, fy_n, fz_n", "tip_pose": "tip_x_m ... tip_qz",
            "outcome": "outcome"}  # fmt: skip


def stack_scans(scans: Sequence[Scan]) -> Scan:
    """Return one table from several whose press ids rise from one to the next, in their order.

    All have the same columns.
    """
    names = scans[0].columns
    return scans[0].replace(
        **{n: np.concatenate([getattr(scan, n) for scan in scans]) for n in names}
    )


@kinds_checked
def join_scans(
    scans: Sequence[Scan], names: Sequence[str] | None = None, pause_s: float | None = None
) -> tuple[Scan, tuple[str, ...]]:
    """Return one table from scans made one after the other on the same body.

    Presses are numbered on. Columns that not all scans have are left out.

    Parameters
    ----------
    scans : in the order in which they were made
    names : of each in a sentence, such as its path; None calls them scan 1, scan 2, ...
    pause_s : time from the last row of a scan to the first of the next, whatever their clocks
        say; None keeps the times

    Returns
    -------
    The table, and the names of the columns that were left out.

    Raises
    ------
    InputError
        Some scans know the time and others do not, a clock goes back and no pause is given, or a
        press stands twice; the scans have different frames, or count travel differently.

    Examples
    --------
    >>> import palpmap as pm
    >>> scan = pm.read_scan("tests/data/twelve_presses/scan.csv")
    >>> few, many = scan.rows(scan.press < 5), scan.rows(scan.press > 5)
    >>> both, left_out = pm.join_scans([few, many], ["first", "second"], pause_s=60.0)
    >>> len(both.press_ids), left_out
    (12, ())
    """
    names = [f"scan {i}" for i in range(1, len(scans) + 1)] if names is None else names
    if not scans or len(names) != len(scans):
        raise InputError(
            f"found {len(scans)} scans and {len(names)} names, expected one scan or more, and as "
            "many names"
        )
    timed = [scan.has_time for scan in scans]
    if any(timed) and not all(timed):
        with_time, without = names[timed.index(True)], names[timed.index(False)]
        raise InputError(
            f"{with_time} has times and {without} has none; expected all scans or none of them: "
            "empty the column time_s of the one, or fill it in the other"
        )
    _refuse_unlike(scans, names)
    left_out = [n for n in OPTIONAL if len({getattr(scan, n) is None for scan in scans}) > 1]
    joined: list[Scan] = []
    for scan, name in zip(scans, names, strict=True):
        changes: dict[str, np.ndarray | None] = dict.fromkeys(left_out)
        if joined:
            before = joined[-1]
            changes["press"] = scan.press - scan.press[0] + before.press[-1] + 1  # gaps count
            if timed[0]:
                changes["time_s"] = _time_after(before, scan, name, pause_s)
        joined.append(scan.replace(**changes))
    table = stack_scans(joined)
    _refuse_repeated(table, joined, scans, names)
    return table, tuple(OPTIONAL[n] for n in left_out)


def _refuse_unlike(scans: Sequence[Scan], names: Sequence[str]) -> None:
    for scan, name in zip(scans[1:], names[1:], strict=True):
        for key, words in (
            ("travel_from", "travel from"),
            ("frame_m", "a frame with its origin at"),
        ):
            first, own = getattr(scans[0], key), getattr(scan, key)
            if tuple(own) != tuple(first):
                raise InputError(
                    f"{name}: has {words} {own or 'unknown'}, expected {first or 'unknown'} as "
                    f"{names[0]}; join the scans as they were read, before a study places them"
                )


def _refuse_repeated(
    table: Scan, joined: Sequence[Scan], scans: Sequence[Scan], names: Sequence[str]
) -> None:
    def source(press: int) -> str:
        i = next(i for i, scan in enumerate(joined) if press <= scan.press[-1])
        own = scans[i].press_ids[np.searchsorted(joined[i].press_ids, press)]
        return f"{names[i]}, press {own}"

    pairs = identical_presses(table)
    if pairs:
        first, later = pairs[0]
        raise InputError(
            f"{source(later)}: holds the same readings as {source(first)} ({len(pairs)} presses "
            "are like this), expected other presses; the same noise twice would make the map look "
            "surer than it is: give each press once"
        )


def _time_after(before: Scan, scan: Scan, name: str, pause_s: float | None) -> np.ndarray:
    last, first = float(before.time_s.max()), float(scan.time_s.min())
    if pause_s is not None:
        return scan.time_s + (last + pause_s - first)
    if first <= last:
        raise InputError(
            f"{name}: its clock begins at {first:.6g} s, expected later than {last:.6g} s, where "
            "the scan before it ends; if the clock was set back, say with --pause how many seconds "
            "lay between the two"
        )
    return scan.time_s
