"""The Scan: the one table between measuring and explaining.

One row a sample, SI units; a press is a run of rows with the same id.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from models.arguments import kinds_checked, path_or, refuse_other_kind, shortened
from models.errors import InputError
from models.scan_columns import CONTACT_PHASES, OUTCOMES, PHASES

_WORDS = {"phase": PHASES, "outcome": OUTCOMES}
_OTHER_KINDS = {
    "frame_m": tuple[float, float, float],
    "travel_from": Literal["", "touch", "plane"],
}
_NO_COLUMNS = tuple(_OTHER_KINDS)


@dataclass(frozen=True, eq=False)
class Scan:
    """Measured table of a palpation: m samples of J presses; all arrays are read-only.

    Attributes
    ----------
    press : (m,) id of the press of each sample, in the order in which the presses were made
    time_s : (m,) s, over the whole scan; all NaN where the source has none
    phase : (m,) load, hold, unload, approach or retract
    point_m : (m, 3) m, contact point on the undeformed surface, body frame; one a press
    direction : (m, 3) unit direction of pressing, into the body; one a press
    force_n : (m,) N, contact force along the direction, pressing positive
    displacement_m : (m,) m, travel of the tip along the direction since first touch, inwards +
    probe_radius_m : (m,) m, radius of the flat tip, or of the sphere; one a press
    force_vector_n : (m, 3) N, force vector on the body, or None
    tip_pose : (m, 7) measured pose of the tip: position in m and quaternion w, x, y, z; or None
    outcome : (m,) made, or retried where an earlier attempt at the press failed; or None
    frame_m : (3,) m, origin of the body's frame in that of the scan, once it was placed
    travel_from : "touch" if travel counts from each press's own first touch, "plane" if from where
        the surface was planned; empty where that is not known

    Raises
    ------
    ValueError
        If the arrays' lengths differ, a phase or an outcome is unknown, or the press ids fall.

    Examples
    --------
    >>> import palpmap as pm
    >>> scan = pm.read_scan("tests/data/twelve_presses/scan.csv")
    >>> len(scan), len(scan.press_ids), float(scan.probe_radius_m[0])
    (264, 12, 0.004)
    """

    press: np.ndarray
    time_s: np.ndarray
    phase: np.ndarray
    point_m: np.ndarray
    direction: np.ndarray
    force_n: np.ndarray
    displacement_m: np.ndarray
    probe_radius_m: np.ndarray
    force_vector_n: np.ndarray | None = None
    tip_pose: np.ndarray | None = None
    outcome: np.ndarray | None = None
    frame_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    travel_from: Literal["", "touch", "plane"] = ""

    def __post_init__(self):
        m = np.shape(self.press)[:1]
        widths = {"point_m": 3, "direction": 3, "force_vector_n": 3, "tip_pose": 7}
        kinds: dict[str, Any] = {"press": np.int64}
        kinds |= {name: f"U{max(map(len, words))}" for name, words in _WORDS.items()}
        for name, value in self.columns.items():
            array, words = _array(name, value), _WORDS.get(name)
            shape = (*m, widths[name]) if name in widths else m
            if array.shape != shape or not shape:
                raise InputError(f"{name} has shape {array.shape}, expected {shape or '(m,)'}")
            if words and not np.isin(array, words).all():
                unknown = set(array.tolist()) - set(words)
                raise InputError(f"{name} holds {unknown}, expected {words}")
            array = array.astype(kinds.get(name, np.float64))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in _NO_COLUMNS:
            refuse_other_kind(name, getattr(self, name), _OTHER_KINDS[name])
        if np.any(np.diff(self.press) < 0):
            raise InputError("press ids fall, expected the order in which the presses were made")

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return f"pm.read_scan({path_or(found, 'path')})"

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The arrays that the table has, by name."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _NO_COLUMNS}
        return {name: array for name, array in arrays.items() if array is not None}

    def __len__(self) -> int:
        """Return the number of samples m."""
        return len(self.press)

    @cached_property
    def _first_row(self) -> np.ndarray:
        return _read_only(np.unique(self.press, return_index=True)[1])

    @property
    def press_ids(self) -> np.ndarray:
        """Ids of the presses, (J,)."""
        return self.press[self._first_row]

    @cached_property
    def press_index(self) -> np.ndarray:
        """Index 0..J-1 of the press of each row, (m,)."""
        return _read_only(np.searchsorted(self.press_ids, self.press))

    @property
    def contact_points(self) -> np.ndarray:
        """Contact point of each press in m, (J, 3)."""
        return self.point_m[self._first_row]

    @property
    def contact_directions(self) -> np.ndarray:
        """Unit direction of pressing of each press, into the body, (J, 3)."""
        return self.direction[self._first_row]

    @property
    def contact_radii(self) -> np.ndarray:
        """Tip radius of each press in m, (J,)."""
        return self.probe_radius_m[self._first_row]

    @property
    def deepest_rows(self) -> np.ndarray:
        """Row of the largest force of each press, (J,)."""
        order = np.lexsort((self.force_n, self.press_index))
        return order[np.cumsum(np.bincount(self.press_index)) - 1]

    @property
    def has_time(self) -> bool:
        """True if the source knew the time of its samples."""
        return not bool(np.isnan(self.time_s).any())

    @property
    def in_contact(self) -> np.ndarray:
        """Rows of phase load, hold or unload, (m,) bool."""
        return np.isin(self.phase, CONTACT_PHASES)

    @property
    def ignored_rows(self) -> int:
        """Number of approach and retract rows, which models do not use."""
        return int(np.count_nonzero(~self.in_contact))

    @kinds_checked
    def rows(self, which: np.ndarray) -> "Scan":
        """Return the Scan of the chosen rows (mask or indices in rising order)."""
        if np.asarray(which).dtype.kind not in "bui" or np.ndim(which) != 1:
            raise InputError(f"which: found {shortened(which)}, expected a mask or indices")
        return replace(self, **{name: array[which] for name, array in self.columns.items()})

    def used(self) -> "Scan":
        """Return the Scan without approach and retract rows; `ignored_rows` counts those."""
        return self.rows(self.in_contact)

    @property
    def near_largest_force(self) -> np.ndarray:
        """Rows within 10 % of their press's largest force, (m,) bool.

        The single largest would be the one whose noise is largest.
        """
        largest = np.full(len(self.press_ids), -np.inf)
        np.maximum.at(largest, self.press_index, self.force_n)
        return self.force_n >= 0.9 * largest[self.press_index]

    def at_largest_force(self, values: np.ndarray) -> np.ndarray:
        """Return each press's mean (J,) of values (m,) near its largest force."""
        if np.shape(values) != self.force_n.shape:
            raise InputError(
                f"values: found {shortened(values)}, expected {len(self)}, one a row of the scan"
            )
        near = self.near_largest_force
        count = np.bincount(self.press_index, near)
        return np.bincount(self.press_index, near * values) / np.maximum(count, 1.0)

    @kinds_checked
    def moved(self, by_m: np.ndarray) -> "Scan":
        """Return the table in another frame: positions plus (3,) m."""
        if np.shape(by_m) != (3,):
            raise InputError(f"by_m: found {shortened(by_m)}, expected 3 numbers")
        pose = self.tip_pose
        if pose is not None:
            pose = np.column_stack([pose[:, :3] + by_m, pose[:, 3:]])
        return self.replace(point_m=self.point_m + by_m, tip_pose=pose)

    def replace(self, **changes) -> "Scan":
        """Return a copy with some arrays replaced."""
        return replace(self, **changes)


def _array(name: str, value: Any) -> np.ndarray:
    """Return a column as an array of its own, of text or of numbers."""
    kinds = "U" if name in _WORDS else "biuf"
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0, object)
    if array.dtype.kind not in kinds and array.size + (array.dtype == object):
        told = "texts" if name in _WORDS else "numbers"
        raise InputError(f"{name}: found {shortened(value)}, expected {told}, one a row")
    return array


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array
