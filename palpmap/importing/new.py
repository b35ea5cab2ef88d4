"""A first study for a scan that is already in palpmap's form."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from models import InputError, Scan, read_scan, replaced, scan_findings, touching, write_scan
from palpmap.importing.importing import checked_study, commented
from palpmap.importing.new_folder import new_folder
from palpmap.study.contact_body import STEEPEST_DEG, steepness_deg, surface_notes
from palpmap.study.faults import fault_sentence
from palpmap.study.kept_inputs import copied, copy_file
from palpmap.study.placement import place_scan
from palpmap.study.study import Noise, Study, load_study
from palpmap.study.units_check import LARGEST_BODY_M

FLAGS = {
    "tip": ("--tip", "the tip's shape, flat or sphere"),
    "size_m": (
        "--thickness, --size or --surface",
        "the body: its thickness in m under the contact points, which make its surface; a block's "
        "size x,y,z in m; or a closed surface",
    ),
    "poisson_ratio": ("--poisson", "the body's Poisson's ratio, such as 0.49 for soft tissue"),
}
"""What a scan cannot tell: flag and question by name."""
_FLAG_OF = {
    "body.thickness_m": "--thickness",
    "body.margin_m": "--margin",
    "body.size_m": "--size",
    "body.file": "--surface",
    "body.origin_m": "--origin",
    "body.poisson_ratio": "--poisson",
    "probe.tip": "--tip",
    "map.inclusions": "--inclusions",
    "study.name": "--name",
}
"""Flag that gives a key of the study."""
ON_TOP_M = 1e-3
LEANING_DEG = 30.0  # between the presses and an axis of their frame that is taken for them


@dataclass(frozen=True)
class Facts:
    """What a scan cannot tell of its experiment; None is not given.

    Attributes
    ----------
    tip, poisson_ratio : shape of the tip; Poisson's ratio of the body
    size_m, surface, thickness_m : of the body, one of the three: a block's edges, the file of a
        closed surface, or the thickness under a surface that the contact points make
    thickness_assumed : it is a guess
    margin_m : from the outermost contacts to the sides of such a body; None is found
    origin_m : place of the body's frame in the scan's; a block's is found if both are one
    displacement_noise_m, force_noise_n : standard deviations of the readings
    touch_noise_m : of a press's depth of first touch
    inclusions : a number, "auto", or "free" for a map of any shape; None is 1, of a body from
        contacts "free"
    name : of the study; None is the scan's
    """

    tip: str | None = None
    poisson_ratio: float | None = None
    size_m: tuple[float, ...] | None = None
    surface: Path | None = None
    thickness_m: float | None = None
    thickness_assumed: bool = False
    margin_m: float | None = None
    origin_m: tuple[float, ...] | None = None
    displacement_noise_m: float | None = None
    force_noise_n: float | None = None
    touch_noise_m: float | None = None
    inclusions: int | str | None = None
    name: str | None = None

    @property
    def missing(self) -> list[str]:
        """Names in `FLAGS` that are still to be given."""
        body = self.size_m or self.surface or self.thickness_m
        given = {"tip": self.tip, "size_m": body, "poisson_ratio": self.poisson_ratio}
        return [name for name, value in given.items() if value is None]

    @property
    def noise(self) -> Noise:
        """Noise of the readings.

        Raises
        ------
        InputError
            A number that no noise has.
        """
        try:
            return Noise(
                displacement_m=self.displacement_noise_m,
                force_n=self.force_noise_n,
                touch_m=self.touch_noise_m,
            )
        except InputError as error:
            raise InputError(
                f"--displacement-noise, --force-noise or --touch-noise: found "
                f"{self.displacement_noise_m}, {self.force_noise_n} and {self.touch_noise_m}, "
                "expected positive numbers in m, N and m"
            ) from error


def read_own(path: Path) -> Scan:
    """Read a scan in palpmap's form; of a table in another one the fault names `palpmap import`."""
    try:
        return read_scan(path)
    except InputError as error:
        said = str(error)
        of_form = "column" in said or "found the ending" in said
        if not path.is_file() or not of_form or ", row " in said:
            raise
        raise InputError(
            f"{said}; or start `palpmap import` of the table as it is with "
            f"`palpmap import {path} --propose > rig.toml`"
        ) from error


def new_study(scan_file: Path, folder: Path, facts: Facts) -> tuple[Path, list[str]]:
    """Write a commented study for a scan, with copies of the scan and of the body's surface.

    Parameters
    ----------
    scan_file : in palpmap's form
    folder : new, or without study.toml

    Returns
    -------
    study : its path
    said : what the scan tells and what is doubtful in it

    Raises
    ------
    InputError
        A scan or a body that cannot be right; a study that is there already.
    """
    scan = read_own(scan_file)
    study_file = folder / "study.toml"
    if study_file.exists():
        raise InputError(
            f"{study_file}: is already there and is not overwritten; choose another --out"
        )
    said, upright = [_told(scan)], None
    if facts.thickness_m is not None and (upright := _upright(scan)) is not None:
        scan = turned(scan, upright)
        said.append(_turning(upright, touching(scan)))
    if facts.surface and not facts.surface.is_file():
        raise InputError(
            f"--surface: {facts.surface} is no file, expected a closed surface (.stl, .obj or "
            ".ply); check the path"
        )
    copy = folder / scan_file.name
    users = {str(copy.resolve()): str(scan_file), str(copy): str(scan_file),
             f"{study_file}, key ": "", **_FLAG_OF}  # fmt: skip
    if facts.surface:
        users[str(folder / facts.surface.name)] = str(facts.surface)
    with new_folder(folder, users):
        study = _study(scan, scan_file, study_file, facts)
        if upright is None:
            copy_file(scan_file, copy)
        else:
            write_scan(scan, copy)
        if facts.surface:
            body = copied(study.body, folder / facts.surface.name)
            study = study.model_copy(update={"body": body})
        checked_study(study, study_file)
    text = commented(
        study_file.read_text(encoding="utf-8"),
        "\n".join(
            [f"# Made by palpmap new from {scan_file.name}; palpmap check looks at each press."]
            + [f"# {line}" for sentence in said[1:] for line in wrap(sentence, 96)]
        ),
    )
    with replaced(study_file) as beside:
        beside.write_text(text, encoding="utf-8")
    if facts.thickness_m is not None:
        placed = place_scan(touching(scan), load_study(study_file))
        said += surface_notes(load_study(study_file).body, placed.distance_m, placed.angle_deg)
    said += [doubt.sentence for doubt in scan_findings(scan)]
    return study_file, said


def _study(scan: Scan, scan_file: Path, study_file: Path, facts: Facts) -> Study:
    """Return the study of a scan in the folder of the study's file."""
    origin_m, inclusions = facts.origin_m, facts.inclusions
    if origin_m is None:
        origin_m = (0.0, 0.0, 0.0) if facts.size_m is None else _origin(scan, facts.size_m)
    if inclusions is None:
        inclusions = 1 if facts.thickness_m is None else "free"
    if facts.surface:
        shape = {"shape": "surface", "file": facts.surface.resolve()}
    elif facts.thickness_m is not None:
        shape = {"shape": "from-contacts", "thickness_m": facts.thickness_m}
        shape |= {"thickness_assumed": facts.thickness_assumed, "margin_m": facts.margin_m}
    else:
        shape = {"shape": "block", "size_m": list(facts.size_m or ())}
    table = shape | {"poisson_ratio": facts.poisson_ratio, "origin_m": list(origin_m)}
    about = {
        "name": facts.name or scan_file.stem,
        "scan": study_file.with_name(scan_file.name).resolve(),
    }
    tables = {
        "study": about,
        "body": table,
        "probe": {"tip": facts.tip, "radius_m": float(scan.contact_radii[0])},
        "noise": facts.noise,
        "map": {"kind": "free"} if inclusions == "free" else {"inclusions": inclusions},
    }
    try:
        return Study.model_validate(tables)
    except ValidationError as error:
        raise InputError(fault_sentence(study_file, error, Study)) from error


def _upright(scan: Scan) -> Rotation | None:
    """Return the rotation that makes the presses point down, where one is too steep as it is.

    By right angles where these come near, so that scans of one body get one frame. None, too, where
    the contact points lie along the presses rather than across: their directions are wrong then.
    """
    felt = touching(scan)
    directions, points = felt.contact_directions, felt.contact_points
    if not len(directions) or steepness_deg(directions).max() < STEEPEST_DEG:
        return None
    along = directions.mean(axis=0)
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][-1]
    if abs(across @ along) < np.cos(np.pi / 4) * np.linalg.norm(along):
        return None
    longest = np.abs(along) == np.abs(along).max()
    right, least = (_downwards(v) for v in (np.where(longest, along, 0.0), along))
    return right if np.degrees((least * right.inv()).magnitude()) < LEANING_DEG else least


def _downwards(vector: np.ndarray) -> Rotation:
    """Return the least rotation of a vector (3,) to -z."""
    axis = np.cross(vector, (0, 0, -1.0))
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(length, -vector[2]) * axis)


def turned(scan: Scan, rotation: Rotation) -> Scan:
    """Return a scan in a frame of the same origin: places, directions and forces turned."""
    pose, force, back = scan.tip_pose, scan.force_vector_n, rotation.inv().as_matrix()
    if pose is not None:
        quaternion = rotation * Rotation.from_quat(pose[:, 3:].copy(), scalar_first=True)
        pose = np.column_stack([pose[:, :3] @ back, quaternion.as_quat(scalar_first=True)])
    return scan.replace(
        point_m=scan.point_m @ back,
        direction=scan.direction @ back,
        force_vector_n=None if force is None else force @ back,
        tip_pose=pose,
    )


def _turning(rotation: Rotation, scan: Scan) -> str:
    """Say how a scan, turned by now, was turned, and how to turn results back."""
    along = scan.contact_directions.mean(axis=0) @ rotation.as_matrix()
    angle = np.linalg.norm(vector := rotation.as_rotvec())
    direction, axis = (
        ", ".join(f"{part:.3g}" for part in np.round(v / np.linalg.norm(v), 4) + 0.0)
        for v in (along, vector)
    )
    w, x, y, z = (np.round(rotation.inv().as_quat(scalar_first=True), 6) + 0.0).tolist()
    return (
        f"The robot presses along ({direction}), not down: the study's copy of the scan is turned "
        f"by {np.degrees(angle):.4g} degrees about the axis ({axis}) through the origin, so that z "
        "points up. Results are in the turned frame; the rotation back is the quaternion (w, x, y, "
        f"z) = ({w:g}, {x:g}, {y:g}, {z:g}). If it presses down, correct nx, ny and nz."
    )


def _told(scan: Scan) -> str:
    used = scan.used()
    low, high = 1e3 * scan.contact_points.min(axis=0), 1e3 * scan.contact_points.max(axis=0)
    box = ", ".join(
        f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True)
    )
    time = "with times" if scan.has_time else "without times (effects in time are not seen)"
    return (
        f"{len(scan.press_ids)} presses, {len(used)} readings in contact {time}; contact points at "
        f"{box} mm; travel to {1e3 * used.displacement_m.max():.3g} mm, force to "
        f"{used.force_n.max():.3g} N; tip radius {1e3 * scan.contact_radii[0]:.3g} mm, as the scan "
        "says."
    )


def _origin(scan: Scan, size_m: tuple[float, ...]) -> tuple[float, float, float]:
    """Return a block's origin where the scan's frame is the block's.

    Raises
    ------
    InputError
        It is another; the height that the points tell is in the sentence.
    """
    points, size = scan.contact_points, np.array(size_m)
    if size.max() > LARGEST_BODY_M:
        raise InputError(
            f"--size: found {size.max():g} m, expected at most {LARGEST_BODY_M:g} m; this looks "
            "like millimetres: divide by 1000"
        )
    on_top = np.abs(points[:, 2] - size[2]).max() <= ON_TOP_M
    if on_top and (points[:, :2] >= 0).all() and (points[:, :2] <= size[:2]).all():
        return (0.0, 0.0, 0.0)
    height = float(np.median(points[:, 2])) - size[2]
    raise InputError(
        f"--origin is missing: the contact points do not lie on top of a block of "
        f"{', '.join(f'{s:g}' for s in size)} m whose lower corner is at 0, 0, 0; correct "
        "--size, or give the corner in the scan's frame as x,y,z in m (z is "
        f"{height:.4g} by the points' height)"
    )
