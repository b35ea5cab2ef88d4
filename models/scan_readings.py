"""Single readings of a Scan that neither their neighbours nor the other presses explain."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from models.scan import Scan

FACTOR = 2.0  # off by this much from both sides: a reading off by 3 is seen beside its noise
NOISE_LEVELS = 8.0  # robust standard deviations of the scan's differences to the neighbours
RESOLUTION_STEPS = 2.5  # of a sensor's: lines through rounded readings are off by up to two
LEAST_ERROR = 0.02  # of a typical press's largest value: below it nothing is worth a stop
ALIKE = 6  # presses of the same phases at least, from which a reading's place in them is known
LEVELS_OF_PRESSES = 5.0  # robust standard deviations beside the course that the presses share
ALONE = 2.0  # times the errors of its neighbours: a press that differs as a whole is none
ALONE_AT_END = 4.0  # the same beside one neighbour: a press that bends otherwise departs at its end


def bad_readings(scan: Scan) -> list[tuple[int, str, float, float]]:
    """Find single readings of force or travel that neither neighbours nor other presses explain.

    Where presses were made by one program, a reading is compared with the same one of the others,
    each press scaled to its own size. Beside that, it is compared with the line through its two
    neighbours, and with the lines through the two readings before and the two after it; the nearest
    of the three counts, so that a corner of the motion and the neighbours of a bad reading are not
    taken for one. A tip that really jumps moves force and travel alike: then neither is bad.

    Parameters
    ----------
    scan : rows in contact

    Returns
    -------
    list of (row, column, found, expected)
    """
    time = scan.time_s if scan.has_time else np.arange(len(scan), dtype=float)
    presses = [np.arange(len(scan))[rows] for _, rows in presses_of(scan)]
    found: dict[str, dict[int, tuple[float, float]]] = {}
    for column in ("force_n", "displacement_m"):
        values = getattr(scan, column)
        least = _least_error(values, presses)
        allowed = _allowed_errors(values, time, presses, least)
        alike = _off_among_presses(values, scan.phase, presses, least)
        found[column] = {row: (float(values[row]), expected) for row, expected in alike.items()}
        for rows in presses:
            others = np.array([row for row in rows if row not in alike], dtype=int)
            for row, expected in _off_in_press(others, values, time, allowed):
                found[column][row] = (float(values[row]), expected)
    both = found["force_n"].keys() & found["displacement_m"].keys()
    return sorted(
        (row, column, *pair)
        for column, pairs in found.items()
        for row, pair in pairs.items()
        if row not in both
    )


def presses_of(scan: Scan) -> list[tuple[int, slice]]:
    """Return the id and the rows of each press."""
    starts = np.unique(scan.press, return_index=True)[1]
    ends = np.append(starts[1:], len(scan))
    return [
        (int(press), slice(int(a), int(b)))
        for press, a, b in zip(scan.press_ids, starts, ends, strict=True)
    ]


def _off_among_presses(
    values: np.ndarray, phase: np.ndarray, presses: Sequence[np.ndarray], least: float
) -> dict[int, float]:
    """Rows off the course that presses of the same phases share, with their expected values."""
    groups = defaultdict(list)
    for rows in presses:
        groups[tuple(phase[rows])].append(rows)
    found: dict[int, float] = {}
    for group in groups.values():
        rows = np.array(group)
        expected = _shared_course(values[rows]) if len(rows) >= ALIKE else None
        if expected is None:
            continue
        error = np.abs(values[rows] - expected)
        near = np.pad(error, ((0, 0), (2, 2)), constant_values=np.nan)
        near = np.lib.stride_tricks.sliding_window_view(near, 5, axis=1)  # (presses, readings, 5)
        noise = 1.4826 * np.nanmedian(near, axis=(0, 2))
        allowed = np.maximum(LEVELS_OF_PRESSES * np.maximum(noise, 0.5 * np.median(noise)), least)
        beside = ALONE * np.nanmax(np.delete(near, [0, 2, 4], axis=2), axis=2)
        beside[:, [0, -1]] *= ALONE_AT_END / ALONE
        wrong = (error > np.maximum(allowed, beside)) & _apart(values[rows], expected)
        found |= dict(zip(rows[wrong].tolist(), expected[wrong].tolist(), strict=True))
    return found


def _shared_course(values: np.ndarray) -> np.ndarray | None:
    """Return the product (p, k) of a size of each press and a course of all, robustly."""
    course = np.median(values, axis=0)
    if len(course) < 4 or course.max() <= 0:
        return None
    for _ in range(4):
        large = course > 0.3 * course.max()
        size = np.median(values[:, large] / course[large], axis=1, keepdims=True)
        typical = np.abs(size) > 0.02 * np.median(np.abs(size))
        course = np.median(values[typical[:, 0]] / size[typical[:, 0]], axis=0)
    return size * course


def _apart(read: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Whether readings are off by more than `FACTOR`, or of the other sign."""
    small, large = np.sort(np.abs([read, expected]), axis=0)
    return (large > FACTOR * small) | (read * expected < 0)


def _least_error(values: np.ndarray, presses: Sequence[np.ndarray]) -> float:
    """Error that is worth a stop, and is not the sensor's resolution."""
    least = LEAST_ERROR * np.median([np.abs(values[rows]).max() for rows in presses])
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * np.abs(values).max()]  # else rounding of the computer
    return max(least, RESOLUTION_STEPS * steps.min()) if len(steps) else least


def _allowed_errors(
    values: np.ndarray, time: np.ndarray, presses: Sequence[np.ndarray], least: float
) -> np.ndarray:
    """Largest difference to the neighbours that noise makes, by the number of lines 0..3."""
    errors, lines = [], []
    for rows in presses:
        expected, count = _from_neighbours(values[rows], time[rows])
        errors.append(np.abs(values[rows] - expected))
        lines.append(count)
    error, count = np.concatenate(errors), np.concatenate(lines)
    allowed = np.full(4, np.inf)
    for number in range(1, 4):  # one line alone is off by more than the nearest of three
        if np.any(count == number):
            noise = 1.4826 * np.median(error[count == number])
            allowed[number] = max(NOISE_LEVELS * noise, least)
    return allowed


def _off_in_press(
    rows: np.ndarray, values: np.ndarray, time: np.ndarray, allowed: np.ndarray
) -> list[tuple[int, float]]:
    """Bad readings of one press, each with its expected value.

    Of several that disagree, the one without which the others agree best is taken out first.
    """

    def off(rows: np.ndarray) -> dict[int, float]:
        read = values[rows]
        expected, lines = _from_neighbours(read, time[rows])
        wrong = (np.abs(read - expected) > allowed[lines]) & _apart(read, expected)
        return dict(zip(rows[wrong].tolist(), expected[wrong].tolist(), strict=True))

    found = []
    while doubtful := off(rows):
        left = {row: len(off(rows[rows != row])) for row in doubtful}
        worst = min(left, key=lambda row: (left[row], -abs(values[row] - doubtful[row])))
        found.append((worst, doubtful[worst]))
        rows = rows[rows != worst]
    return found


def _from_neighbours(values: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value that the neighbours in a press predict, the nearest of up to three, NaN without any.

    Second, the number of lines that there were to choose from.
    """
    best, lines = np.full(len(values), np.nan), np.zeros(len(values), dtype=int)
    for a, b in ((-1, 1), (-2, -1), (1, 2)):
        row = np.arange(max(0, -a), len(values) - max(0, b))
        slope = (values[row + b] - values[row + a]) / (time[row + b] - time[row + a])
        line = values[row + a] + slope * (time[row] - time[row + a])
        nearer = ~(np.abs(line - values[row]) >= np.abs(best[row] - values[row]))
        best[row[nearer]] = line[nearer]
        lines[row] += 1
    return best, lines
