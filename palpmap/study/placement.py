"""Where the presses stand on the study's body.

The scan has its own frame (often the robot's). `place_scan` moves it into the body's frame, in
which a block reaches from 0 to its size, and refuses presses that are not on the body's surface.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from models import InputError, Scan
from palpmap.study.contact_body import contact_body
from palpmap.study.study import Study

BLOCK_TOLERANCE_M = 5.0e-4
SURFACE_TOLERANCE_M = 1.0e-3
LARGEST_TILT_DEG = 60.0


@dataclass(frozen=True)
class Placement:
    """A scan on the study's body.

    Attributes
    ----------
    scan : Scan
        In the body's frame; with `projected` on the block's top, on a body from contacts on its
        smoothed surface, pressed along the normal there. An oblique load would be felt too stiff,
        as the near field has no tangential part; a ball that slides, or sticks, is felt softer by
        less than a tenth up to 17 degrees.
    origin_m : (3,) float64
        Add it to a position in the body's frame to get the scan's frame.
    projected : bool
        Whether a block stands in for a body with another surface.
    distance_m, angle_deg : (J,) float64
        How far each contact point and direction was from the body's surface and its inward
        normal (before projection, if there was one).
    """

    scan: Scan
    origin_m: np.ndarray
    projected: bool
    distance_m: np.ndarray
    angle_deg: np.ndarray

    @property
    def onto_another_shape(self) -> bool:
        """Whether presses were moved by more than the tip: no map of the block fits them all."""
        return self.projected and bool(self.distance_m.max() > self.scan.contact_radii.min())

    def of_presses(self, ids: np.ndarray) -> "Placement":
        """Return the placement of some presses, by their ids."""
        kept = np.isin(self.scan.press_ids, ids)
        scan = self.scan.rows(kept[self.scan.press_index])
        distance_m, angle_deg = self.distance_m[kept], self.angle_deg[kept]
        return replace(self, scan=scan, distance_m=distance_m, angle_deg=angle_deg)


def place_scan(scan: Scan, study: Study) -> Placement:
    """Move a scan into the frame of the study's body and check that it lies on its surface.

    Raises
    ------
    InputError
        Naming the scan's row and column, and the key of the study that may be wrong.
    fem.errors.MeshError
        If the body's surface file cannot be used.
    """
    origin = np.array(study.body.origin_m)
    counted = study.study.travel_from or ""
    moved = scan.moved(-origin).replace(frame_m=study.body.origin_m, travel_from=counted)
    _check_radius(moved, study)
    points, directions = moved.contact_points, moved.contact_directions
    if study.body.shape == "block":
        assert study.body.size_m is not None  # the study's own rule for a block
        size = np.array(study.body.size_m)
        distance = points[:, 2] - size[2]
        normals = np.broadcast_to([0.0, 0.0, -1.0], points.shape)
        _check_outline(moved, study, size)
    elif study.body.shape == "from-contacts":
        through = contact_body(study.body).through
        heights = through.heights(points[:, :2])
        distance, normals = points[:, 2] - heights, through.inward_normals(points[:, :2])
    else:
        distance, normals = _distance_to_surface(points, study)
    cosine = np.clip(np.einsum("jc,jc->j", directions, normals), -1, 1)
    angle = np.degrees(np.arccos(cosine))
    _check_direction(moved, study, angle)
    if study.body.project_points:
        flat = moved.point_m.copy()
        flat[:, 2] = np.array(study.body.size_m)[2]
        inward = np.broadcast_to([0.0, 0.0, -1.0], flat.shape)
        moved = moved.replace(point_m=flat, direction=inward)
    else:
        _check_distance(moved, study, distance)
    if study.body.shape == "from-contacts":
        surface = contact_body(study.body).surface
        points = np.column_stack([points[:, :2], surface.heights(points[:, :2])])
        each, inward = moved.press_index, surface.inward_normals(points[:, :2])
        moved = moved.replace(point_m=points[each], direction=inward[each])
    return Placement(moved, origin, study.body.project_points, np.abs(distance), angle)


def _press(scan: Scan, study: Study, j: int, column: str) -> str:
    row = int(np.flatnonzero(scan.press_index == j)[0])
    return f"{study.scan}, row {row + 1} (press {scan.press_ids[j]}), column {column}"


def _check_radius(scan: Scan, study: Study) -> None:
    radius = study.probe.radius_m
    if not np.isclose(scan.contact_radii, radius, rtol=1e-3).any():
        raise InputError(
            f"{_press(scan, study, 0, 'probe_radius_m')}: found {scan.contact_radii[0]:g} m, "
            f"expected {radius:g} m in some press as under probe.radius_m of the study; correct "
            "one of them"
        )


def _check_outline(scan: Scan, study: Study, size: np.ndarray) -> None:
    points, radii = scan.contact_points, scan.contact_radii
    for axis, column in ((0, "x_m"), (1, "y_m")):
        low, high = radii - BLOCK_TOLERANCE_M, size[axis] - radii + BLOCK_TOLERANCE_M
        bad = np.flatnonzero((points[:, axis] < low) | (points[:, axis] > high))
        if len(bad):
            j, origin = bad[0], study.body.origin_m[axis]
            raise InputError(
                f"{_press(scan, study, j, column)}: found {points[j, axis] + origin:.6g} m, "
                f"expected {origin + radii[j]:.6g} to {origin + size[axis] - radii[j]:.6g} m, so "
                "that the tip lies inside the block's outline; check body.size_m and "
                "body.origin_m in the study"
            )


def _check_direction(scan: Scan, study: Study, angle: np.ndarray) -> None:
    limit = 90.0 if study.body.project_points else LARGEST_TILT_DEG
    bad = np.flatnonzero(angle >= limit)
    if len(bad):
        j = bad[0]
        outward = angle[j] > 90
        do = "change the sign of nx, ny, nz" if outward else "check nx, ny, nz"
        raise InputError(
            f"{_press(scan, study, j, 'nx, ny, nz')}: found a direction {angle[j]:.1f} degrees "
            f"from the surface's inward normal{', out of the body' if outward else ''}, expected "
            f"less than {limit:g}; {do}"
        )


def _check_distance(scan: Scan, study: Study, distance: np.ndarray) -> None:
    block = study.body.shape == "block"
    tolerance = BLOCK_TOLERANCE_M if block else SURFACE_TOLERANCE_M
    if study.body.shape == "from-contacts":
        tolerance = max(tolerance, float(scan.contact_radii.min()))
    bad = np.flatnonzero(np.abs(distance) > tolerance)
    if len(bad):
        j = bad[0]
        x, y, z = scan.contact_points[j] + np.array(study.body.origin_m)
        hint = "; or set body.project_points = true if the block stands in for a curved body"
        raise InputError(
            f"{_press(scan, study, j, 'z_m' if block else 'x_m, y_m, z_m')}: found the point "
            f"({x:.6g}, {y:.6g}, {z:.6g}) m, {abs(distance[j]) * 1e3:.3g} mm off the body's "
            f"{'top' if block else 'surface'} ({len(bad)} of {len(distance)} presses), expected "
            f"at most {tolerance * 1e3:g} mm; check body.{'size_m' if block else 'file'} and "
            f"body.origin_m in the study{hint if block else ''}"
        )


def _distance_to_surface(points: np.ndarray, study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Distance of points to the surface in the study's file, and the inward normals there."""
    assert study.body.file is not None  # the study's own rule for a surface
    closest, inward = closest_on_surface(points, study.body.file)
    return np.linalg.norm(points - closest, axis=1), inward


def closest_on_surface(points: np.ndarray, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the closest points (j, 3) on the surface in a file, and the inward normals there."""
    import pyvista

    from fem.mesh import read_surface

    surface = read_surface(file)
    triangles = pyvista.PolyData.from_regular_faces(surface.vertices, surface.triangles)
    # Any: the declared return type is a union that depends on the flag.
    found: Any = triangles.find_closest_cell(points, return_closest_point=True)
    cells, closest = found
    a, b, c = (surface.vertices[surface.triangles[cells, i]] for i in range(3))
    inward = np.cross(c - a, b - a)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return closest, inward
