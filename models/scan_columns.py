"""The columns of a measured table: their names, and how a place in a table is named."""

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from models.errors import InputError

POINT = ("x_m", "y_m", "z_m")
DIRECTION = ("nx", "ny", "nz")
FORCE_VECTOR = ("fx_n", "fy_n", "fz_n")
TIP_POSITION = ("tip_x_m", "tip_y_m", "tip_z_m")
TIP_QUATERNION = ("tip_qw", "tip_qx", "tip_qy", "tip_qz")
TIP_POSE = TIP_POSITION + TIP_QUATERNION
REQUIRED = (
    "press",
    "time_s",
    "phase",
    *POINT,
    *DIRECTION,
    "force_n",
    "displacement_m",
    "probe_radius_m",
)
OUTCOME = "outcome"
OPTIONAL = (*FORCE_VECTOR, *TIP_POSE, OUTCOME)
TEXT = ("phase", OUTCOME)

CONTACT_PHASES = ("load", "hold", "unload")
PHASES = (*CONTACT_PHASES, "approach", "retract")
OUTCOMES = ("made", "retried")
"""Of presses with readings; those that were skipped or aborted have no rows."""


@dataclass(frozen=True)
class Where:
    """Names places of a table file.

    Attributes
    ----------
    file : name of the file, as the user wrote it
    line_of : from row (0-based) to line number of the text file; None for a file without lines
    in_study : the table belongs to a study file; else it was made in Python
    """

    file: str
    line_of: Callable[[int], int] | None = None
    in_study: bool = True

    @property
    def units_escape(self) -> str:
        """How the author says that strange units are meant."""
        how = (
            "set units_checked = true under [study]" if self.in_study else "give units_checked=True"
        )
        return f"if the values are right, {how}"

    def row(self, row: Any) -> str:
        """Name a row (0-based index) by its data row number and, in a text file, its line."""
        line = "" if self.line_of is None else f" (line {self.line_of(int(row))})"
        return f"{self.file}, row {int(row) + 1}{line}"

    def cell(self, row: Any, column: str) -> str:
        """Name a cell by row (0-based index) and column name."""
        return f"{self.row(row)}, column {column}"


_LEAST_START = 3  # letters of a name's beginning that stand for it


def nearest(name: str, known: tuple[str, ...]) -> str:
    """Return "; the nearest right name is ..." or nothing, for a name that is not known.

    >>> nearest("forze_n", ("force_n", "time_s"))
    "; the nearest right name is 'force_n'"
    >>> nearest("skin", ("skin_layer", "hysteresis"))
    "; the nearest right name is 'skin_layer'"
    >>> nearest("temp_c", ("tip_qz", "time_s"))
    ''
    """
    folded, word = {k.lower(): k for k in known}, name.strip().lower()
    match = difflib.get_close_matches(word, folded, n=1, cutoff=0.6)
    if not match and len(word) >= _LEAST_START:
        match = [k for k in folded if k.startswith(word)]
    return f"; the nearest right name is '{folded[match[0]]}'" if match else ""


def cut(text: str, most: int = 60) -> str:
    """Return a text as it can stand in a sentence.

    >>> cut("forze_n"), cut("a" * 100, 5)
    ('forze_n', 'aaaaa...')
    """
    return text if len(text) <= most else f"{text[:most]}..."


def check_header(names: list[str], where: Where) -> None:
    """Refuse double, unknown, missing and incomplete column names.

    Raises
    ------
    InputError
        Naming the file and the column.
    """
    known = REQUIRED + OPTIONAL
    if names[-1].strip() == "" and len(names) > 1:
        raise InputError(
            f"{where.file}: found a header that ends with a comma, expected the name of a last "
            "column; each line ends with a comma too many: remove it"
        )
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{where.file}: column '{cut(name)}' stands twice in the header, expected once; "
                "remove or rename one of them"
            )
        if name not in known:
            hint = nearest(name, known)
            raise InputError(
                f"{where.file}: unknown column '{cut(name)}'{hint}; "
                f"expected {', '.join(REQUIRED)} and optionally {', '.join(OPTIONAL)}; "
                f"{'rename or remove' if hint else 'remove'} the column"
            )
    for name in REQUIRED:
        if name not in names:
            hint = " (leave its cells empty where there is no time)" if name == "time_s" else ""
            raise InputError(
                f"{where.file}: column '{name}' is missing, found {', '.join(map(cut, names))}; "
                f"add the column{hint}"
            )
    for group in (FORCE_VECTOR, TIP_POSE):
        there = [name for name in group if name in names]
        if there and len(there) < len(group):
            absent = ", ".join(name for name in group if name not in names)
            raise InputError(
                f"{where.file}: column '{there[0]}' stands without {absent}; expected all of "
                f"{', '.join(group)} or none; add the missing ones or remove the others"
            )
