"""A first study for a scan that is already in palpmap's form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from models import InputError, Scan, read_scan, replaced, scan_findings, touching
from palpmap.importing.importing import checked_study, commented
from palpmap.study.body import Body
from palpmap.study.contact_body import surface_notes
from palpmap.study.faults import fault_sentence
from palpmap.study.kept_inputs import copied, copy_file
from palpmap.study.placement import place_scan
from palpmap.study.study import About, Map, Noise, Probe, Study, load_study

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
ON_TOP_M = 1e-3


def missing(*, tip: str | None, body_known: bool, poisson_ratio: float | None) -> list[str]:
    """Return the names in `FLAGS` that are still to be given."""
    given = {"tip": tip, "size_m": body_known or None, "poisson_ratio": poisson_ratio}
    return [name for name, value in given.items() if value is None]


def new_study(
    scan_file: Path,
    folder: Path,
    *,
    tip: str,
    poisson_ratio: float,
    size_m: tuple[float, ...] | None = None,
    surface: Path | None = None,
    thickness_m: float | None = None,
    thickness_assumed: bool = False,
    origin_m: tuple[float, ...] | None = None,
    noise: Noise | None = None,
    inclusions: int | str | None = None,
    name: str | None = None,
) -> tuple[Path, list[str]]:
    """Write a commented study for a scan, with copies of the scan and of the body's surface.

    Parameters
    ----------
    scan_file : in palpmap's form
    folder : new, or without study.toml
    origin_m : where the body's frame stands in the scan's; a block's is found if its frame is the
        scan's
    inclusions : a number, "auto", or "free" for a map of any shape; None is 1, of a body from
        contacts "free"
    thickness_m : of a body whose surface the contact points make, in place of a size or a surface
    thickness_assumed : it is a guess

    Returns
    -------
    study : its path
    said : what the scan tells and what is doubtful in it

    Raises
    ------
    InputError
        A scan or a body that cannot be right; a study that is there already.
    """
    scan = read_scan(scan_file)
    study_file = folder / "study.toml"
    if study_file.exists():
        raise InputError(
            f"{study_file}: is already there and is not overwritten; choose another --out"
        )
    said = [_told(scan)]
    if origin_m is None:
        origin_m = (0.0, 0.0, 0.0) if size_m is None else _origin(scan, size_m)
    if inclusions is None:
        inclusions = 1 if thickness_m is None else "free"
    if surface:
        shape = {"shape": "surface", "file": surface.resolve()}
    elif thickness_m is not None:
        shape = {"shape": "from-contacts", "thickness_m": thickness_m}
        shape |= {"thickness_assumed": thickness_assumed}
    else:
        shape = {"shape": "block", "size_m": list(size_m or ())}
    table = shape | {"poisson_ratio": poisson_ratio, "origin_m": list(origin_m)}
    try:
        study = Study(
            study=About(name=name or scan_file.stem, scan=(folder / scan_file.name).resolve()),  # pyright: ignore[reportCallIssue]
            body=Body.model_validate(table),
            probe=Probe.model_validate({"tip": tip, "radius_m": float(scan.contact_radii[0])}),
            noise=noise or Noise(),
            map=Map.model_validate(
                {"kind": "free"} if inclusions == "free" else {"inclusions": inclusions}
            ),
        )
    except ValidationError as error:
        raise InputError(fault_sentence(study_file, error, Study)) from error
    folder.mkdir(parents=True, exist_ok=True)
    copy_file(scan_file, folder / scan_file.name)
    if surface:
        body = copied(study.body, folder / surface.name)
        study = study.model_copy(update={"body": body})
    checked_study(study, study_file)
    text = commented(
        study_file.read_text(encoding="utf-8"),
        f"# Made by palpmap new from {scan_file.name}; palpmap check looks at each press.",
    )
    with replaced(study_file) as beside:
        beside.write_text(text, encoding="utf-8")
    if thickness_m is not None:
        placed = place_scan(touching(scan), load_study(study_file))
        said += surface_notes(load_study(study_file).body, placed.distance_m, placed.angle_deg)
    said += [doubt.sentence for doubt in scan_findings(scan)]
    return study_file, said


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
    on_top = np.abs(points[:, 2] - size[2]).max() <= ON_TOP_M
    if on_top and (points[:, :2] >= 0).all() and (points[:, :2] <= size[:2]).all():
        return (0.0, 0.0, 0.0)
    height = float(np.median(points[:, 2])) - size[2]
    raise InputError(
        f"--origin is missing: the contact points do not lie on top of a block of "
        f"{', '.join(f'{s:g}' for s in size)} m whose lower corner is at 0, 0, 0; give the corner "
        f"in the scan's frame as x,y,z in m (z is {height:.4g} by the points' height)"
    )
