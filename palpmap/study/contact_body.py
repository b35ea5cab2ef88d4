"""The body of a study whose surface is that of a scan's contact points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fem import FoldedSurfaceError, MeshError
from models import InputError, read_scan, touching
from palpmap.study.body import Body

if TYPE_CHECKING:
    from fem.mesh import ContactSurface, SmoothedSurface

MARGIN = 0.75  # most, of the thickness: free sides there change a press at the edge by 1 to 2 %
THINNEST = 0.1  # least height of a contact over the base, of the thickness
CLEAR = 0.2  # below, beside the contacts, the surface is lifted from the base, of the thickness
DIFFERENT_DEG = 10.0  # from the surface's normal: said
CELLS = 1000  # of the size over which the surface is smoothed, where no cell size is stated
SMOOTHED = 1.5  # such sizes
STEEPEST_DEG = 75.0  # a press further off the vertical is on no surface of heights


@dataclass(frozen=True, eq=False)
class ContactBody:
    """A body under the surface through contact points, on a flat base.

    Attributes
    ----------
    through : surface through the contact points, in the frame of their scan
    surface : the same as smooth as finite elements can show; the body's
    corner_m : (3,) least x and y, and the base's z
    size_m : (3,) along x and y; along z the mean thickness under the contact points
    smoothed_m : length over which `surface` is
    """

    through: ContactSurface
    surface: SmoothedSurface
    corner_m: np.ndarray
    size_m: np.ndarray
    smoothed_m: float

    @property
    def margin_m(self) -> float:
        """Width of the body beyond the outermost contacts, m."""
        return float(self.through.points_m[:, 0].min() - self.corner_m[0])

    def box_m(self) -> np.ndarray:
        """Least and greatest coordinates of the body, (2, 3)."""
        axes = [np.linspace(0, edge, 41) for edge in self.size_m[:2]]
        places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2) + self.corner_m[:2]
        top = self.surface.heights(places).max()
        return np.array([self.corner_m, [*(self.corner_m + self.size_m)[:2], top]])

    def inside(self, points_m: np.ndarray) -> np.ndarray:
        """Whether points (p, 3) of the body's box lie below the surface, (p,) bool."""
        points = np.asarray(points_m, float)
        return points[:, 2] <= self.surface.heights(points[:, :2])


def surface_notes(body: Body, distance_m: np.ndarray, angle_deg: np.ndarray) -> tuple[str, ...]:
    """Say what the surface rests on, and how far contacts and directions are from it.

    Parameters
    ----------
    distance_m, angle_deg : (j,) of a placed scan, see `palpmap.study.placement.Placement`
    """
    made = contact_body(body)
    far = int(np.sum(angle_deg > DIFFERENT_DEG))
    directions = (
        f"Press directions differ from its normal by {np.median(angle_deg):.2g} degrees (median), "
        f"at most {angle_deg.max():.2g}"
    )
    points = made.through.points_m
    off = np.abs(made.surface.heights(points[:, :2]) - points[:, 2]).max()
    error, shift = 1e3 * np.round([made.through.error_m, off], 7)  # without a computer's rounding
    notes = [
        f"The body's surface goes through {len(points)} contact points; it "
        f"predicts points left out to {error:.2g} mm. Contacts lie at "
        f"most {1e3 * np.round(distance_m.max(), 6):g} mm off it. {directions}"
        + (f"; by more than {DIFFERENT_DEG:g} in {far} of {len(angle_deg)}." if far else "."),
        "Finite elements show no shape finer than themselves: the body is meshed under the same "
        f"surface smoothed over {1e3 * made.smoothed_m:.2g} mm, up to {shift:.2g} mm off, "
        "and pressed along its normals; body.cell_size_m sets that.",
    ]
    if margin_m := assumed_margin_m(body):
        found = (
            "the most likely of the sides tried, as the scan does not state them"
            if body.margin_assumed
            else "as the scan does not state its sides; a fit takes nearer ones where likelier"
        )
        notes.append(
            f"Beyond the probed area the body goes on for {1e3 * margin_m:.3g} mm, {found}. State "
            "body.margin_m where you know it: a press at a free side is felt up to twice as soft."
        )
    return tuple(notes)


def steepness_deg(directions: np.ndarray) -> np.ndarray:
    """Return the angles (j,) of directions (j, 3) to straight down, degrees.

    >>> steepness_deg(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])).tolist()
    [90.0, 0.0]
    """
    return np.degrees(np.arccos(np.clip(-directions[:, 2], -1, 1)))


def contact_body(body: Body) -> ContactBody:
    """Return the body that a study's table [body] and its scan of contacts make.

    Raises
    ------
    InputError
        The scan cannot be read, or its contact points make no surface over a base.
    """
    file = body.file
    if file is None:
        raise InputError(
            "body.file: the scan whose contact points make the surface is missing; name it"
        )
    try:
        stamp = file.stat().st_mtime_ns
    except OSError as error:
        raise InputError(
            f"{file}: cannot be read ({error.strerror}), expected the scan whose contact points "
            'make the surface of a body "from-contacts"; name it under study.scan or body.file'
        ) from error
    assert body.thickness_m is not None  # the study's own rule for this shape
    margin_m = assumed_margin_m(body) or body.margin_m or 0.0
    return _made(file, stamp, body.thickness_m, margin_m, body.cell_size_m)


def assumed_margin_m(body: Body) -> float | None:
    """Return the margin beyond the outermost contacts of a body whose study states none, m.

    The widest, unless another one was found.
    """
    if body.margin_assumed or body.thickness_m is None:
        return body.margin_m
    return MARGIN * body.thickness_m if body.margin_m is None else None


@lru_cache(maxsize=8)
def _made(
    file: Path, stamp: int, thickness_m: float, margin_m: float, cell_m: float | None
) -> ContactBody:
    from fem.mesh import ContactSurface, probed_box

    scan = touching(read_scan(file, units_checked=True))
    points, directions = scan.contact_points, scan.contact_directions
    tilt = steepness_deg(directions)
    if tilt.max() >= STEEPEST_DEG:
        j = int(tilt.argmax())
        raise InputError(
            f"{file}, press {scan.press_ids[j]}, columns nx, ny, nz: found a direction "
            f"{tilt[j]:.0f} degrees off straight down (-z), expected at most {STEEPEST_DEG:g} "
            "for a body from contacts; turn the scan's frame so that z points up (palpmap new does "
            'it), or give a closed surface (shape = "surface")'
        )
    try:
        through = ContactSurface.through(points, directions)
    except FoldedSurfaceError as error:
        apart = np.linalg.norm(points - error.points_m[:, None], axis=2)
        one, two = (scan.press_ids[j] for j in apart.argmin(axis=1))
        raise InputError(f"{file}, presses {one} and {two}: {error}") from error
    except MeshError as error:
        raise InputError(f"{file}: {error}") from error
    low, high = points[:, :2].min(axis=0) - margin_m, points[:, :2].max(axis=0) + margin_m
    heights = through.heights(through.points_m[:, :2])
    mean, lowest = float(through.points_m[:, 2].mean()), float(heights.min())
    base = mean - thickness_m
    if lowest - base < THINNEST * thickness_m:
        needed = (mean - lowest) / (1 - THINNEST)
        side = "above" if lowest >= base else "below"
        raise InputError(
            f"study, key body.thickness_m: found {thickness_m:g} m, which puts the lowest contact "
            f"{1e3 * abs(lowest - base):.3g} mm {side} the base; expected at least {needed:.2g} m, "
            "from the mean height of the contacts to the base"
        )
    size = np.array([*(high - low), thickness_m])
    top = np.column_stack([points[:, :2] - low, np.full(len(points), thickness_m)])
    radius_m = float(scan.contact_radii.min())
    probed = np.ptp(probed_box(top, np.array([np.zeros(3), size]), radius_m), axis=0)
    length_m = SMOOTHED * (cell_m or float(np.cbrt(probed.prod() / CELLS)))
    clear_m = min(CLEAR * thickness_m, lowest - base)
    surface = through.smoothed(length_m, low, high, base, clear_m)
    return ContactBody(through, surface, np.array([*low, base]), size, length_m)
