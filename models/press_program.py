"""A press program: the table of presses that an experiment makes, in order.

As a file (CSV, header row, SI units), one row a press:

| column | unit | meaning |
|---|---|---|
| `x_m`, `y_m` | m | contact point on the body's surface |
| `radius_m` | m | radius of the tip |
| `force_n` | N | peak force |
| `ramp_s`, `hold_s` | s | duration of loading and of holding |
| `unload_s` | s | optional: duration of unloading, 1 s where the column is missing |
| `pause_s` | s | optional: rest before the press; drawn at random where the column is missing |
| `z_m` | m | optional: height of the contact point; an empty cell is the upper surface at x, y |
| `nx`, `ny`, `nz` | 1 | optional: unit direction into the body; empty is the surface's normal |

Lines that begin with `#` are comments. `palpmap scan --program FILE` and the bench read it.
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass, fields
from operator import index
from pathlib import Path

import numpy as np

from models.arguments import Seed, kinds_checked
from models.errors import InputError
from models.replaced import replaced
from models.scan_columns import nearest

NEEDED = ("x_m", "y_m", "radius_m", "force_n", "ramp_s", "hold_s")
OPTIONAL = ("unload_s", "pause_s", "z_m", "nx", "ny", "nz")
PLACE = ("x_m", "y_m")
ON_SURFACE = ("z_m", "nx", "ny", "nz")
"""Columns that say where on the body and in which direction; NaN leaves it to the surface."""
UNIT_TOLERANCE = 1e-3
UNLOAD_S = 1.0
USUAL_RADIUS_M = 0.005
PAUSE_S = (0.05, 0.95)
"""Shortest and longest rest between two presses where none is given, s. Drawn at random, so that
no frequency is locked to the rhythm of the presses."""
REST = 1 / 8
"""Share of the presses after which `early_rest` rests, and for which share of their time."""


@kinds_checked
@dataclass(frozen=True)
class PressProgram:
    """Presses on a body, in their order; all arrays (j,), SI units.

    Attributes
    ----------
    x_m, y_m : contact point
    radius_m : of the tip
    force_n : peak force
    ramp_s, hold_s, unload_s : duration of the parts of a press
    pause_s : rest before each press
    z_m : height of the contact point; NaN is the upper surface at x, y
    nx, ny, nz : unit direction into the body; NaN is against the surface's normal

    Examples
    --------
    >>> import palpmap as pm
    >>> program = pm.grid_program(per_side=3)
    >>> len(program), program.x_m[:3].tolist()
    (9, [0.012, 0.048, 0.084])
    """

    x_m: np.ndarray
    y_m: np.ndarray
    radius_m: np.ndarray
    force_n: np.ndarray
    ramp_s: np.ndarray
    hold_s: np.ndarray
    unload_s: np.ndarray
    pause_s: np.ndarray
    z_m: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    nx: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    ny: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    nz: np.ndarray = None  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        shape = (len(np.atleast_1d(self.x_m)),)
        for field in fields(self):
            given = getattr(self, field.name)
            array = np.full(shape, np.nan) if given is None else np.atleast_1d(given).astype(float)
            free = np.isnan(array) if field.name in ON_SURFACE else False
            if array.shape != shape or not (np.isfinite(array) | free).all():
                raise InputError(
                    f"The press program's {field.name} has shape {array.shape}; expected "
                    f"{shape[0]} finite numbers, one a press."
                )
            low = 0.0 if field.name == "pause_s" else np.nextafter(0, 1)
            if field.name not in (*PLACE, *ON_SURFACE) and (array < low).any():
                j = int((array < low).argmax())
                raise InputError(
                    f"Press {j} of the program: {field.name} is {array[j]:g}; it has to be "
                    f"{'zero or more' if low == 0 else 'positive'}."
                )
            array.flags.writeable = False
            object.__setattr__(self, field.name, array)
        if len(self.x_m) == 0:
            raise InputError("The press program is empty; give at least one press.")
        length = np.linalg.norm(self.direction, axis=1)
        bad = np.isnan(self.direction).any(axis=1) & ~np.isnan(self.direction).all(axis=1)
        bad |= np.abs(length - 1) > UNIT_TOLERANCE
        if bad.any():
            j = int(bad.argmax())
            raise InputError(
                f"Press {j} of the program: nx, ny, nz is {self.direction[j].tolist()}; give a "
                "unit vector into the body, or leave all three out for the surface's normal."
            )

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return "pm.grid_program(...) or pm.PressProgram(...)"

    @property
    def direction(self) -> np.ndarray:
        """Unit directions into the body, (j, 3); NaN is the surface's normal."""
        return np.column_stack([self.nx, self.ny, self.nz])

    def __len__(self) -> int:
        return len(self.x_m)

    @property
    def start_s(self) -> np.ndarray:
        """Start of each press, (j,) s."""
        duration = self.ramp_s + self.hold_s + self.unload_s
        return np.cumsum(self.pause_s) + np.concatenate([[0.0], np.cumsum(duration)[:-1]])

    def only(self, presses: np.ndarray) -> PressProgram:
        """Return some of the presses (their numbers), in that order."""
        return PressProgram(**{f.name: getattr(self, f.name)[presses] for f in fields(self)})

    @kinds_checked
    def then(self, further: PressProgram, rest_s: float) -> PressProgram:
        """Return the program that makes these presses, rests, and makes further ones."""
        arrays = {
            f.name: np.concatenate([getattr(self, f.name), getattr(further, f.name)])
            for f in fields(self)
        }
        arrays["pause_s"][len(self)] += rest_s
        return PressProgram(**arrays)


def early_rest(pause_s: np.ndarray, pressing_s: np.ndarray) -> np.ndarray:
    """Return the pauses with a rest after the first eighth of the presses, an eighth of all time.

    At an even pace what goes with the count of presses goes with time. In a rest, early, as bodies
    soften at first, only time goes on.

    Parameters
    ----------
    pause_s : rest before each press, (j,) s
    pressing_s : duration of each press, (j,) s

    Examples
    --------
    >>> early_rest(np.ones(8), np.full(8, 3.0)).tolist()
    [1.0, 5.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    rested = np.array(pause_s, float)
    first = max(int(REST * len(rested)), 1)
    rested[first : first + 1] += REST * float(np.sum(pause_s) + np.sum(pressing_s))
    return rested


def random_pauses(count: int, seed: int) -> np.ndarray:
    """Rests before `count` presses, (j,) s; the same for the same seed."""
    return np.random.default_rng([seed, 1]).uniform(*PAUSE_S, size=count)


@kinds_checked
def grid_program(
    size_m: tuple[float, float, float] = (0.096, 0.096, 0.048),
    per_side: int = 9,
    radii_m: tuple[float, ...] = (0.005,),
    force_n: float = 0.3,
    seed: Seed = 0,
    margin_share: float = 1 / 8,
    ramp_s: float = 1.0,
    hold_s: float = 2.0,
    repeats: int = 1,
    shuffled: bool = False,
    force_shares: tuple[float, ...] = (1.0,),
    rested: bool = False,
) -> PressProgram:
    """Lay out a square grid of presses, row by row; radii take turns from point to point.

    Parameters
    ----------
    size_m : edges of the block
    per_side : points along each edge
    radii_m : of the tips; with two, every other press has the second, like a chess board on a
        grid with an odd number a side
    force_n : peak force of a tip of 5 mm radius; others press in proportion to their radius, so
        that all go about as deep
    seed : of the pauses
    margin_share : of the edges, from the rim to the first points
    repeats : how often the whole grid is pressed, one time after the other
    shuffled : random order, in place of row by row
    force_shares : of the peak force; they take turns too, each for as many points as there are
        radii, so that every radius gets every force
    rested : with a rest after the first eighth of the presses (`early_rest`)

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.grid_program(per_side=2, repeats=2).y_m.tolist()
    [0.012, 0.012, 0.084, 0.084, 0.012, 0.012, 0.084, 0.084]
    """
    try:
        per_side, repeats = index(per_side), index(repeats)
        radii_m, force_shares = tuple(radii_m), tuple(force_shares)
        x_m, y_m = (float(edge) for edge in size_m[:2])
    except TypeError as error:
        raise InputError(
            "A grid needs whole numbers per_side and repeats, lists radii_m and force_shares, and "
            "the edges of the body, size_m = (x, y, z)."
        ) from error
    if per_side < 2 or repeats < 1 or not radii_m or not force_shares:
        raise InputError("A grid needs two points a side, one repeat, radius and force or more.")
    x, y = (np.linspace(margin_share, 1 - margin_share, per_side) * edge for edge in (x_m, y_m))
    count = per_side**2 * repeats
    radius = np.resize(np.array(radii_m, float), count)
    share = np.resize(np.repeat(np.array(force_shares, float), len(radii_m)), count)
    order = np.random.default_rng([seed, 4]).permutation(count) if shuffled else np.arange(count)
    pause = random_pauses(count, seed)
    if rested:
        pause = early_rest(pause, np.full(count, ramp_s + hold_s + UNLOAD_S))
    return PressProgram(
        np.tile(x, per_side * repeats)[order],
        np.tile(np.repeat(y, per_side), repeats)[order],
        radius[order],
        (force_n * share * radius / USUAL_RADIUS_M)[order],
        np.full(count, ramp_s),
        np.full(count, hold_s),
        np.full(count, UNLOAD_S),
        pause,
    )


def write_program(program: PressProgram, path: str | os.PathLike[str]) -> None:
    """Write a press program as CSV."""
    names = [f.name for f in fields(program) if not np.isnan(getattr(program, f.name)).all()]
    rows = np.column_stack([getattr(program, name) for name in names])
    cells = ([f"{v:.9g}" if v == v else "" for v in row] for row in rows)
    text = "\n".join([",".join(names), *(",".join(row) for row in cells)])
    with replaced(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def read_program(path: str | os.PathLike[str], seed: int = 0) -> PressProgram:
    """Read a press program.

    Parameters
    ----------
    path : CSV file with the columns of this module's table
    seed : of the pauses, where the file has none

    Raises
    ------
    InputError
        Naming file, row and column, what was found and what is expected.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a press program ({error})") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(lines))
    if len(rows) < 2:
        raise InputError(
            f"{path}: found {len(rows)} rows, expected a header ({', '.join(NEEDED)}) and one row "
            "a press"
        )
    header = [name.strip() for name in rows[0]]
    _check_header(path, header)
    columns: dict[str, list[float]] = {name: [] for name in header}
    for number, cells in enumerate(rows[1:], start=1):
        if len(cells) != len(header):
            raise InputError(
                f"{path}, row {number}: found {len(cells)} cells, expected {len(header)}"
            )
        for name, cell in zip(header, cells, strict=True):
            columns[name].append(_number(path, number, name, cell))
    count = len(rows) - 1
    columns.setdefault("unload_s", [UNLOAD_S] * count)
    columns.setdefault("pause_s", random_pauses(count, seed).tolist())
    return PressProgram(**{name: np.array(values) for name, values in columns.items()})


def _check_header(path: Path, header: list[str]) -> None:
    known = (*NEEDED, *OPTIONAL)
    for name in header:
        if name not in known:
            raise InputError(
                f"{path}: unknown column '{name}'{nearest(name, known)}; expected "
                f"{', '.join(known)}"
            )
    missing = [name for name in NEEDED if name not in header]
    if missing or len(set(header)) != len(header):
        what = f"the column '{missing[0]}' is missing" if missing else "a column stands twice"
        raise InputError(f"{path}: {what}; expected {', '.join(NEEDED)}")


def _number(path: Path, row: int, name: str, cell: str) -> float:
    place = name in (*PLACE, *ON_SURFACE)
    if name in ON_SURFACE and not cell.strip():
        return float("nan")
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    positive = not place and name != "pause_s"
    if not np.isfinite(value) or (not place and value < 0) or (positive and value == 0):
        kind = "positive " if positive else "" if place else "not negative "
        raise InputError(
            f"{path}, row {row}, column {name}: found '{cell.strip()}', expected a "
            f"{kind}number in SI units"
        )
    return value
