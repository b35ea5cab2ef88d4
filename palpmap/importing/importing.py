"""From a rig's own files to a scan, a study and a page of findings and assumptions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from identify import Progress, silent
from models import InputError, Scan, kinds_checked, read_scan, replaced, touching, write_scan
from palpmap.importing.mapping.rig import Rig, load_rig
from palpmap.importing.mapping.stated_units import in_mapping, other_units, told
from palpmap.importing.new_folder import new_folder
from palpmap.importing.places import at_places, with_places
from palpmap.importing.readers.read import read_recording
from palpmap.importing.readings import scan_of_readings
from palpmap.importing.streams.cutting import Cut, cut_stream
from palpmap.study.body import Body
from palpmap.study.kept_inputs import copied
from palpmap.study.placement import closest_on_surface, place_scan
from palpmap.study.study import About, Study, load_study, write_study


@dataclass(frozen=True, eq=False)
class Imported:
    """A recording in the form of a scan.

    Attributes
    ----------
    files : that were read
    rig : mapping by which they were read
    scan : the scan
    said : what was found, assumed and left out, in sentences
    cut : presses of a raw stream with their touches, lag and left-out presses; None of readings
    other_units : units that the recording states otherwise than the mapping, by the mapping's key

    Examples
    --------
    `made.write("study")` leaves scan, study and page; `import_recording` makes one.

    >>> import palpmap as pm
    >>> [name for name in pm.Imported.__dataclass_fields__]
    ['files', 'rig', 'scan', 'said', 'cut', 'other_units']
    """

    files: tuple[Path, ...]
    rig: Rig = field(repr=False)
    scan: Scan = field(repr=False)
    said: tuple[str, ...] = field(repr=False)
    cut: Cut | None = field(default=None, repr=False)
    other_units: Mapping[str, str] = field(default_factory=dict, repr=False)

    @kinds_checked
    def write(self, folder: str | os.PathLike[str], form: str = "csv") -> Path:
        """Write scan, study.toml, import.md and a copy of the body's surface; return the study.

        Parameters
        ----------
        form : csv or parquet

        Raises
        ------
        InputError
            A study that is there already; a scan or a body that cannot be right.
        """
        folder = Path(folder)
        study_file = folder / "study.toml"
        if study_file.exists():
            raise InputError(
                f"{study_file}: is already there and is not overwritten; choose another --out"
            )
        scan_file, page_file = folder / f"scan.{form}", folder / "import.md"
        names = ", ".join(path.name for path in self.files[:3]) + ", ..." * (len(self.files) > 3)
        of_scan = f"scan of {names}"
        users = {str(scan_file.resolve()): of_scan, str(scan_file): of_scan,
                 str(study_file): "mapping"}  # fmt: skip
        if self.rig.body is not None and (surface := self.rig.body.file) is not None:
            users[str(folder / surface.name)] = str(surface)
        with _naming_mapping(self.rig, self.other_units), new_folder(folder, users):
            write_scan(self.scan, scan_file)
            with replaced(page_file) as beside:
                beside.write_text(self.page(), encoding="utf-8")
            # Last, as a study that is there is not overwritten: a killed import runs again
            checked_study(_study(self, scan_file, folder), study_file)
        text = commented(
            study_file.read_text(encoding="utf-8"),
            f"# Made by palpmap import from {names}; import.md says what was found.",
        )
        with replaced(study_file) as beside:
            beside.write_text(text, encoding="utf-8")
        return study_file

    def page(self) -> str:
        """Return findings and assumptions as Markdown."""
        scan = self.scan
        used = scan.used()
        counts = {name: int(np.sum(scan.phase == name)) for name in np.unique(scan.phase)}
        rows = [
            ("Presses", str(len(scan.press_ids))),
            ("Rows", f"{len(scan)} ({', '.join(f'{n} {name}' for name, n in counts.items())})"),
            ("Force", f"{used.force_n.min():.4g} to {used.force_n.max():.4g} N"),
            (
                "Travel since first touch",
                f"{1e3 * used.displacement_m.min():.4g} to {1e3 * used.displacement_m.max():.4g} "
                "mm",
            ),
            (
                "Time",
                f"{scan.time_s.min():.4g} to {scan.time_s.max():.4g} s"
                if scan.has_time
                else "unknown",
            ),
        ]
        files = [f"- {path.name}" for path in self.files[:20]]
        if len(self.files) > 20:
            files.append(f"- and {len(self.files) - 20} more")
        return "\n".join(
            [
                f"# Import of {self.rig.name}",
                "",
                "| | |",
                "|---|---|",
                *[f"| {name} | {value} |" for name, value in rows],
                "",
                "## Files",
                "",
                *files,
                "",
                "## Found and assumed",
                "",
                *[f"- {sentence}" for sentence in self.said],
                "",
                "## Next",
                "",
                "`palpmap check study.toml` looks at each press; `palpmap explain study.toml` gives"
                " the verdict.",
                "",
            ]
        )


@kinds_checked
def import_recording(
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    rig: Rig | str | os.PathLike[str],
    *,
    progress: Progress = silent,
) -> Imported:
    """Read the files of a recording and make a scan of it.

    Parameters
    ----------
    files : one or more: text tables, Excel, MATLAB, HDF5, NumPy, Parquet, MCAP, ROS bags
    rig : mapping, or its file
    progress : is told the steps

    Raises
    ------
    InputError
        Naming file, row, topic or key, what was found and what is expected.

    Examples
    --------
    >>> import palpmap as pm
    >>> rig = getfixture("tmp_path") / "rig.toml"
    >>> _ = rig.write_text('''
    ... kind = "readings"
    ... time = {column = "time_s"}
    ... press = {number = "press", phase = "phase", direction = ["nx", "ny", "nz"]}
    ... force = {column = "force_n", unit = "N"}
    ... travel = {column = "displacement_m", unit = "m"}
    ... point = {columns = ["x_m", "y_m", "z_m"], unit = "m"}
    ... probe = {tip = "flat", radius_m = 0.005}
    ... body = {shape = "block", size_m = [0.096, 0.096, 0.048], poisson_ratio = 0.49}
    ... ''')
    >>> made = pm.import_recording("tests/data/twelve_presses/scan.csv", rig)
    >>> len(made.scan.press_ids)
    12
    """
    files = [files] if isinstance(files, (str, os.PathLike)) else list(files)
    if not isinstance(rig, Rig):
        mapping, rig = rig, load_rig(rig)
        try:
            return import_recording(files, rig, progress=progress)
        except InputError as error:
            if not str(error).startswith("key "):
                raise
            raise InputError(f"{os.fspath(mapping)}, {error}") from error
    if asked := rig.needed():
        keys = "; ".join(f"{key}: {question}" for key, question in asked)
        raise InputError(
            f"the recording does not tell everything; give in the mapping (--rig): {keys}. "
            "--propose prints a mapping to complete"
        )
    assert rig.body  # `Rig.needed` asks
    assert rig.probe
    recording, placed = with_places(read_recording(files, progress), rig)
    progress("finding the presses")
    stated = other_units(recording, rig)
    said = [*recording.notes, *told(rig, stated)]
    cut = None
    with _naming_mapping(rig, stated):
        if rig.kind == "readings":
            scan, found = scan_of_readings(recording, placed)
        else:
            cut = cut_stream(recording, placed)
            scan = at_places(cut.scan(rig.probe.radius_m), rig)
            scan, moved = put_on_surface(scan, rig.body, rig.rows.surface_m)
            found = [*cut.said, moved]
    return Imported(tuple(map(Path, files)), rig, scan, (*said, *found), cut, stated)


@contextmanager
def _naming_mapping(rig: Rig, stated: Mapping[str, str]) -> Iterator[None]:
    """Name the mapping's units in a refusal of a scan that was read in them."""
    try:
        yield
    except InputError as error:
        raise InputError(in_mapping(str(error), rig, stated)) from error


def put_on_surface(scan: Scan, body: Body, largest_m: float) -> tuple[Scan, str]:
    """Move the contact points of a measured path onto the body's surface; second, a sentence.

    Raises
    ------
    InputError
        If a point lies further off than `largest_m`.
    """
    points = scan.contact_points
    if body.project_points:
        return scan, "The block stands in for the body (project_points): points were not moved."
    if body.shape == "from-contacts":
        return scan, "The body's surface goes through the contact points: they were not moved."
    if body.shape == "block":
        assert body.size_m is not None  # the study's own rule for a block
        closest = points.copy()
        closest[:, 2] = body.origin_m[2] + body.size_m[2]
        what, key = "the block's top", "body.size_m"
    else:
        assert body.file is not None  # the study's own rule for a surface
        origin = np.array(body.origin_m)
        closest = closest_on_surface(points - origin, body.file)[0] + origin
        what, key = "the surface", "body.file"
    distance = np.linalg.norm(closest - points, axis=1)
    j = int(distance.argmax())
    if distance[j] > largest_m:
        x, y, z = points[j]
        raise InputError(
            f"press {j}: found its first touch at ({x:.4f}, {y:.4f}, {z:.4f}) m, "
            f"{1e3 * distance[j]:.3g} mm off {what} (middle of all: "
            f"{1e3 * float(np.median(distance)):.3g} mm), expected at most {1e3 * largest_m:g} mm; "
            f"correct body.origin_m or {key}, the frame, or rows.surface_m"
        )
    said = (
        f"The contact points were moved onto {what} by {1e3 * float(np.median(distance)):.2g} mm "
        f"(at most {1e3 * distance[j]:.2g} mm)."
    )
    return scan.replace(point_m=closest[scan.press_index]), said


def _study(made: Imported, scan_file: Path, folder: Path) -> Study:
    rig = made.rig
    assert rig.body  # `Rig.needed` asks
    assert rig.probe
    body, noise = rig.body, rig.noise
    if made.cut is not None:
        found = {"touch_m": made.cut.touch_error_m, "lag_s": made.cut.lag_error_s}
        stated = noise.model_dump(exclude_none=True)
        noise = noise.model_copy(update=found | stated)
    if body.file is not None:
        body = copied(body, folder / body.file.name)
    return Study(
        study=About(name=rig.name, scan=scan_file.resolve()),  # pyright: ignore[reportCallIssue]
        body=body,
        probe=rig.probe,
        noise=noise,
        map=rig.map,
    )


def checked_study(study: Study, study_file: Path) -> None:
    """Write a study and read it back with its scan.

    Raises
    ------
    InputError
        Scan and study do not fit together.
    """
    write_study(study, study_file)
    scan = read_scan(study.scan, study.study.units_checked)
    place_scan(touching(scan), load_study(study_file))


def commented(text: str, first: str) -> str:
    """Put a comment above each table of a study file, `first` above [study]."""
    comments = {
        "[study]": first,
        "[body]": "# The body: size, file and origin_m (its frame in the scan's) in m.",
        "[probe]": "# The tip; with most_force_n, in N, presses are proposed up to that force.",
        "[noise]": "# One standard deviation: of each reading, the depth of first touch, the lag.",
        "[map]": '# A number of inclusions (or "auto"), or kind = "free": a map of any shape.',
    }
    lines = []
    for line in text.splitlines():
        if line in comments:
            lines.append(comments[line])
        lines.append(line)
    if "[noise]" not in text:
        lines += ["", "# No [noise]: it is estimated from the scan."]
    return "\n".join(lines) + "\n"
