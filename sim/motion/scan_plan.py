"""Plan of a scan: points, directions, force, tip, and the place of the body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models import InputError, PressProgram
from sim.robot.laboratory import Placement

UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ScanPlan:
    """The presses of a scan, in order.

    Attributes
    ----------
    points_m : (j, 3) m, contact points on the undeformed surface, body frame
    directions : (j, 3) unit, into the body, body frame
    force_n : N, set force of every press; of a program, the largest
    tip_radius_m : m, of the flat tip
    body_size_m : edges of the box that bounds the body, from the body frame's origin
    body_in_world : where the body stands
    program : force, durations and rest of each press, where they differ; see `program_plan`
    """

    points_m: np.ndarray
    directions: np.ndarray
    force_n: float = 0.25
    tip_radius_m: float = 0.005
    body_size_m: tuple[float, float, float] = (0.096, 0.096, 0.048)
    body_in_world: Placement = field(default_factory=Placement)
    program: PressProgram | None = None

    def __post_init__(self) -> None:
        for name in ("points_m", "directions"):
            array = np.array(getattr(self, name), float)
            if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
                raise InputError(
                    f"The plan's {name} has shape {array.shape}; expected finite numbers, one "
                    "row of three a press."
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if len(self.points_m) != len(self.directions) or len(self.points_m) == 0:
            raise InputError(
                f"The plan has {len(self.points_m)} points and {len(self.directions)} directions; "
                "give one direction for each of at least one point."
            )
        length = np.linalg.norm(self.directions, axis=1)
        worst = int(np.abs(length - 1).argmax())
        if abs(length[worst] - 1) > UNIT_TOLERANCE:
            raise InputError(
                f"Press {worst}: the direction {self.directions[worst]} has length "
                f"{length[worst]:.6g}; give a unit vector that points into the body."
            )
        for name, value in (("force_n", self.force_n), ("tip_radius_m", self.tip_radius_m)):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"The plan's {name} is {value:g}; it has to be positive.")

    def __len__(self) -> int:
        return len(self.points_m)

    def force_of(self, press: int) -> float:
        """Set force of a press, N."""
        return self.force_n if self.program is None else float(self.program.force_n[press])

    def thickness_m(self, press: int) -> float:
        """Length of a press's line inside the body's box, m."""
        point, along = self.points_m[press], self.directions[press]
        end = np.where(along > 0, self.body_size_m, 0.0)
        moving = np.abs(along) > UNIT_TOLERANCE
        return float(((end - point)[moving] / along[moving]).min())


def program_plan(
    program: PressProgram, body_size_m: tuple[float, float, float], **settings: object
) -> ScanPlan:
    """Plan the presses of a program on the top of a block.

    Parameters
    ----------
    program : the presses
    body_size_m : edges of the block
    **settings : further fields of `ScanPlan`

    Raises
    ------
    InputError
        Tips of several radii: the arm carries one; or a tip that hangs over the block's edge.
    """
    radii = np.unique(program.radius_m)
    if len(radii) > 1:
        raise InputError(
            f"The program has tips of {len(radii)} radii ({radii[0]:g} to {radii[-1]:g} m) and the "
            "robot carries one: split the program by radius_m and make one scan of each."
        )
    points = np.column_stack(
        [program.x_m, program.y_m, np.full(len(program), float(body_size_m[2]))]
    )
    room = np.minimum(points[:, :2], np.array(body_size_m[:2]) - points[:, :2]).min(axis=1)
    if room.min() < radii[0]:
        j = int(room.argmin())
        raise InputError(
            f"Press {j} of the program at x_m {points[j, 0]:g}, y_m {points[j, 1]:g}: its tip of "
            f"{radii[0]:g} m radius hangs over the edge of the block of {body_size_m[0]:g} x "
            f"{body_size_m[1]:g} m."
        )
    return ScanPlan(
        points,
        np.tile([0.0, 0.0, -1.0], (len(program), 1)),
        force_n=float(program.force_n.max()),
        tip_radius_m=float(radii[0]),
        body_size_m=body_size_m,
        program=program,
        **settings,  # pyright: ignore[reportArgumentType]
    )


def grid_plan(
    body_size_m: tuple[float, float, float] = (0.096, 0.096, 0.048),
    per_side: int = 9,
    margin_m: float = 0.012,
    **settings: object,
) -> ScanPlan:
    """Presses on the top of a block: a square grid, made in rows that run to and fro.

    Parameters
    ----------
    body_size_m : edges of the block
    per_side : points along each edge, at least 2
    margin_m : from the edges to the first points
    **settings : further fields of `ScanPlan`

    Examples
    --------
    >>> plan = grid_plan()
    >>> len(plan), plan.points_m[0].tolist(), plan.points_m[-1].tolist()
    (81, [0.012, 0.012, 0.048], [0.084, 0.084, 0.048])
    """
    if per_side < 2 or not 0 <= margin_m < min(body_size_m[:2]) / 2:
        raise InputError(
            f"A grid of {per_side} points a side with a margin of {margin_m:g} m does not fit a "
            f"top of {body_size_m[0]:g} x {body_size_m[1]:g} m; take at least 2 points and a "
            "smaller margin."
        )
    x = np.linspace(margin_m, body_size_m[0] - margin_m, per_side)
    y = np.linspace(margin_m, body_size_m[1] - margin_m, per_side)
    points = [
        (xi, yk, body_size_m[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])
    ]
    directions = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return ScanPlan(np.array(points), directions, body_size_m=body_size_m, **settings)  # pyright: ignore[reportArgumentType]
