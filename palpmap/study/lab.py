"""The file of a laboratory, in TOML: arm, truth, pose of the body, robot, obstacles.

arm = "ur5"                  # or a folder with its arm.toml, relative to this file
truth = "map.toml"           # or "random"
plant = ["force_drift:3"]

[body]
position_m = [0.40, -0.05, 0.0]
quaternion = [1.0, 0.0, 0.0, 0.0]

[robot]                      # any setting of pm.ScanSettings but the seed
force_noise_n = 0.002
ramp_s = 2.0

[[obstacles]]                # boxes, world frame
size_m = [0.1, 0.02, 0.2]
position_m = [0.5, 0.2, 0.1]
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field

from models import ARMS, InputError, nearest
from palpmap.study.body import Positive, Real, Table, as_tuple
from palpmap.study.faults import read_table

if TYPE_CHECKING:
    from sim.motion import ScanPlan, ScanSettings


Triple = Annotated[tuple[Real, Real, Real], BeforeValidator(as_tuple)]


class LabBody(Table):
    """`[body]`: pose of the body's frame in the world frame, the arm's base."""

    position_m: Triple | None = None
    quaternion: Annotated[tuple[Real, Real, Real, Real], BeforeValidator(as_tuple)] = (1, 0, 0, 0)


class LabObstacle(Table):
    """One entry of `[[obstacles]]`: a box that the arm keeps clear of, world frame."""

    size_m: Annotated[tuple[Positive, Positive, Positive], BeforeValidator(as_tuple)]
    position_m: Triple = Field(description="of its centre")


class Lab(Table):
    """A laboratory."""

    arm: str = "panda"
    truth: str | None = None
    plant: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] = ()
    body: LabBody = LabBody()
    robot: dict[str, Any] = Field(default_factory=dict)
    obstacles: Annotated[tuple[LabObstacle, ...], BeforeValidator(as_tuple)] = ()

    def placed(self, plan: ScanPlan) -> ScanPlan:
        """Return the plan with the body at the laboratory's place."""
        from dataclasses import replace

        from sim.robot import Placement

        position = self.body.position_m or plan.body_in_world.position_m
        return replace(plan, body_in_world=Placement(position, self.body.quaternion))

    def settings(self, settings: ScanSettings) -> ScanSettings:
        """Return the settings of a scan in this laboratory."""
        from dataclasses import replace

        boxes = tuple((box.size_m, box.position_m) for box in self.obstacles)
        return replace(settings, arm=self.arm, obstacles=boxes, **self.robot)


def read_lab(path: Path) -> Lab:
    """Read a laboratory's file; paths in it are relative to the file.

    Raises
    ------
    InputError
        Naming file and key, what was found and what is expected.
    """
    from sim.motion import ScanSettings

    found = read_table(path, Lab, "laboratory")
    known = tuple(
        f.name for f in fields(ScanSettings) if f.name not in ("seed", "arm", "obstacles")
    )
    for key, value in found.robot.items():
        if key not in known:
            raise InputError(
                f"{path}, key robot.{key}: unknown key{nearest(key, known)}; expected "
                f"{', '.join(known)}"
            )
        if isinstance(value, list):
            found.robot[key] = tuple(value)
    changes: dict[str, Any] = {}
    if not (ARMS / found.arm).is_dir():
        changes["arm"] = str(path.parent / found.arm)
    if found.truth and found.truth != "random":
        changes["truth"] = str(path.parent / found.truth)
    changes["plant"] = tuple(
        str(path.parent / name) if name.endswith(".py") else name for name in found.plant
    )
    return found.model_copy(update=changes)
