"""An arm and its probe as a folder: a model (MJCF or URDF) and arm.toml, which names its parts.

| key of arm.toml | default | meaning |
|---|---|---|
| `name` | the folder's | in reports |
| `model` | required | file beside it, or `package://PACKAGE/...` of `example-robot-data` |
| `joints` | required | names of the joints, from the base outwards |
| `home_rad` | required | configuration from which a scan starts |
| `speed_limit_rad_per_s` | the URDF's | of the joints |
| `acceleration_limit_rad_per_s2` | required | of the joints |
| `armature_kg_m2`, `damping_n_m_s` | 0.1, 1 | of each joint, where the model is a URDF |
| `probe.body` | | body of the model that is the probe, with its sites and geoms |
| `probe.flange` | | else: body or link at which the standard probe is mounted, z outwards |
| `probe.mass_kg`, `.centre_m`, `.inertia_kg_m2` | the standard's | of all beyond the sensor |
| `probe.length_m` | 0.145 | from the flange to the tip |
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from models.errors import InputError
from models.scan_columns import nearest

ARMS = Path(__file__).parent / "arms"
ARM_PACKAGE = "package://example-robot-data/"
_KEYS = (
    "name", "model", "joints", "home_rad", "speed_limit_rad_per_s",
    "acceleration_limit_rad_per_s2", "armature_kg_m2", "damping_n_m_s", "probe",
)  # fmt: skip
_PROBE_KEYS = ("body", "flange", "mass_kg", "centre_m", "inertia_kg_m2", "length_m")


@dataclass(frozen=True)
class Probe:
    """What the arm carries beyond its force sensor.

    Attributes
    ----------
    body : name of it in the arm's model, empty where it is mounted at `flange`
    flange : body or link of the model, z outwards
    mass_kg, centre_m, inertia_kg_m2 : of all beyond the sensor; (3,) m from the flange, and (3,)
        about the centre of mass
    length_m : from the flange to the tip
    """

    body: str = ""
    flange: str = ""
    mass_kg: float = 0.234
    centre_m: tuple[float, ...] = (0.0, 0.0, 0.05)
    inertia_kg_m2: tuple[float, ...] = (0.00045, 0.00045, 0.00007)
    length_m: float = 0.145


@dataclass(frozen=True)
class Arm:
    """An arm; arrays are (n,) for n joints.

    Attributes
    ----------
    name : in reports
    model : MJCF or URDF file
    joints : names, from the base outwards
    home_rad : configuration from which a scan starts
    speed_limit, acceleration_limit : rad/s and rad/s^2
    armature_kg_m2, damping_n_m_s : of each joint of a URDF
    probe : what it carries
    """

    name: str
    model: Path
    joints: tuple[str, ...]
    home_rad: np.ndarray
    speed_limit: np.ndarray
    acceleration_limit: np.ndarray
    armature_kg_m2: float = 0.1
    damping_n_m_s: float = 1.0
    probe: Probe = field(default_factory=Probe)

    @property
    def is_urdf(self) -> bool:
        """True for a URDF, false for MJCF."""
        return self.model.suffix.lower() == ".urdf"


def read_arm(arm: str | Path = "panda") -> Arm:
    """Read an arm by the name of one that palpmap has, or by its folder.

    Raises
    ------
    InputError
        No such arm, a key that is missing, unknown or does not fit, a model that is not there.

    Examples
    --------
    >>> read_arm("panda").joints[-1]
    'joint7'
    """
    folder = Path(arm)
    if not folder.is_dir():
        folder = ARMS / str(arm)
    known = sorted(path.name for path in ARMS.iterdir() if path.is_dir())
    if not folder.is_dir():
        raise InputError(
            f"no arm '{arm}'{nearest(str(arm), tuple(known))}; there are {', '.join(known)}, or "
            "give the folder of another one with its arm.toml"
        )
    file = folder / "arm.toml"
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}), expected in an arm's folder; "
                         "see docs/files.md") from error  # fmt: skip
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no TOML ({error}); correct it") from error
    _refuse_unknown(table, _KEYS, file, "")
    probe = table.get("probe", {})
    if not isinstance(probe, Mapping):
        raise InputError(f"{file}, key probe: found {probe!r}, expected a table [probe]")
    _refuse_unknown(probe, _PROBE_KEYS, file, "probe.")
    if ("body" in probe) == ("flange" in probe):
        raise InputError(
            f"{file}, key probe: found {sorted(probe)}, expected either body (the probe is in the "
            "model) or flange (where the standard probe is mounted)"
        )
    joints = _words(table, "joints", file)
    model = _model_file(str(_needed(table, "model", file)), folder, file)
    count = len(joints)
    speed = (
        _positives(table, "speed_limit_rad_per_s", count, file)
        if "speed_limit_rad_per_s" in table
        else _speed_of_urdf(model, joints, file)
    )
    return Arm(
        str(table.get("name", folder.name)),
        model,
        joints,
        _numbers(table, "home_rad", count, file),
        speed,
        _positives(table, "acceleration_limit_rad_per_s2", count, file),
        _positive(table, "armature_kg_m2", 0.1, file),
        _positive(table, "damping_n_m_s", 1.0, file),
        _probe(probe, file),
    )


def _probe(table: Mapping[str, Any], file: Path) -> Probe:
    found: dict[str, Any] = {}
    for key, value in table.items():
        if key in ("body", "flange"):
            found[key] = str(value)
        elif key in ("centre_m", "inertia_kg_m2"):
            found[key] = tuple(_numbers(table, key, 3, file).tolist())
        else:
            found[key] = _positive(table, key, 0.0, file)
    return Probe(**found)


def mesh_folder(package: str) -> Path | None:
    """Return the folder that `package://PACKAGE` stands for, None where it is not installed."""
    shares = [Path(root) / "cmeel.prefix" / "share" / package for root in sys.path]
    return next((share for share in shares if share.is_dir()), None)


def _model_file(model: str, folder: Path, file: Path) -> Path:
    if model.startswith(ARM_PACKAGE):
        share = mesh_folder("example-robot-data")
        if share is None:
            raise InputError(
                f"{file}, key model: the package example-robot-data is not installed; "
                'pip install "palpmap[arms]"'
            )
        path = share / model.removeprefix(ARM_PACKAGE)
    else:
        path = folder / model
    if not path.is_file():
        raise InputError(f"{file}, key model: no file {path}; give an MJCF or URDF file beside it")
    return path


def _speed_of_urdf(model: Path, joints: tuple[str, ...], file: Path) -> np.ndarray:
    limits = {}
    if model.suffix.lower() == ".urdf":
        try:
            root = ElementTree.parse(model).getroot()
        except ElementTree.ParseError as error:
            raise InputError(f"{model}: is no URDF ({error}); correct it") from error
        for joint in root.iter("joint"):
            limit = joint.find("limit")
            if limit is not None and limit.get("velocity"):
                limits[joint.get("name")] = limit.get("velocity")
    missing = [name for name in joints if name not in limits]
    if missing:
        raise InputError(
            f"{file}, key speed_limit_rad_per_s: missing, and the model states no limit of "
            f"{missing[0]}; add one number for each joint"
        )
    try:
        speed = np.array([limits[name] for name in joints], float)
    except ValueError as error:
        raise InputError(f"{model}, limit velocity: {error}, expected a number") from error
    return _checked_positive(speed, f"{model}, limit velocity")


def _needed(table: Mapping[str, Any], key: str, file: Path) -> Any:
    if key not in table:
        raise InputError(f"{file}, key {key}: missing; see docs/files.md")
    return table[key]


def _words(table: Mapping[str, Any], key: str, file: Path) -> tuple[str, ...]:
    found = _needed(table, key, file)
    if not isinstance(found, list) or not found or not all(isinstance(n, str) for n in found):
        raise InputError(f"{file}, key {key}: found {found!r}, expected a list of names")
    return tuple(found)


def _numbers(table: Mapping[str, Any], key: str, count: int, file: Path) -> np.ndarray:
    found = _needed(table, key, file)
    right = isinstance(found, list) and len(found) == count
    if not right or not all(isinstance(n, int | float) and np.isfinite(n) for n in found):
        raise InputError(f"{file}, key {key}: found {found!r}, expected a list of {count} numbers")
    array = np.array(found, float)
    array.flags.writeable = False
    return array


def _positives(table: Mapping[str, Any], key: str, count: int, file: Path) -> np.ndarray:
    return _checked_positive(_numbers(table, key, count, file), f"{file}, key {key}")


def _checked_positive(found: np.ndarray, place: str) -> np.ndarray:
    if not np.all((found > 0) & np.isfinite(found)):
        raise InputError(f"{place}: found {found.tolist()}, expected positive numbers")
    return found


def _positive(table: Mapping[str, Any], key: str, default: float, file: Path) -> float:
    found = table.get(key, default)
    if not isinstance(found, int | float) or not 0 < found < np.inf:
        raise InputError(f"{file}, key {key}: found {found!r}, expected a positive number")
    return float(found)


def _refuse_unknown(
    table: Mapping[str, Any], known: tuple[str, ...], file: Path, before: str
) -> None:
    for key in table:
        if key not in known:
            raise InputError(
                f"{file}, key {before}{key}: unknown key{nearest(key, known)}; expected "
                f"{', '.join(known)}"
            )
