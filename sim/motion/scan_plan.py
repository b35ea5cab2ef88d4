"""Plan of a scan: points, directions, force, tip, and the place of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from models import InputError, PressProgram
from sim.motion.body_surface import BodySurface
from sim.motion.tip import Kind, Tip
from sim.robot.laboratory import Placement

UNIT_TOLERANCE = 1e-6
OFF_SURFACE_M = 1e-3


@dataclass(frozen=True)
class ScanPlan:
    """The presses of a scan, in order.

    Attributes
    ----------
    points_m : (j, 3) m, contact points on the undeformed surface, body frame
    directions : (j, 3) unit, into the body, body frame
    force_n : N, set force of every press; of a program, the largest
    forces_n : (j,) where they differ without a program
    tip_radius_m : m, of the flat tip, where no tips are given
    body_size_m : edges of the block, from the body frame's origin
    surface : of the body, where it is no block
    body_in_world : where the body stands
    origin_m : (3,) of the body frame in the frame of the scan, which sentences name places in
    program : force, durations and rest of each press, where they differ; see `program_plan`
    press_ids : (j,) numbers of the presses in the scan; None counts from 0
    tips : (j) of the presses; the arm changes them at its home pose
    lowered : (j) why a press has less force than was asked for, empty where it has not
    """

    points_m: np.ndarray
    directions: np.ndarray
    force_n: float = 0.25
    tip_radius_m: float = 0.005
    body_size_m: tuple[float, float, float] = (0.096, 0.096, 0.048)
    body_in_world: Placement = field(default_factory=Placement)
    program: PressProgram | None = None
    surface: BodySurface | None = None
    press_ids: np.ndarray | None = None
    tips: tuple[Tip, ...] = ()
    forces_n: np.ndarray | None = None
    lowered: tuple[str, ...] = ()
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

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
        if self.tips and len(self.tips) != len(self.points_m):
            raise InputError(
                f"The plan has {len(self.points_m)} points and {len(self.tips)} tips; give one tip "
                "a press, or none."
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
        if self.program is not None:
            return float(self.program.force_n[press])
        return self.force_n if self.forces_n is None else float(self.forces_n[press])

    def tip_of(self, press: int) -> Tip:
        """Return the tip of a press."""
        return self.tips[press] if self.tips else Tip("flat", self.tip_radius_m)

    @property
    def radii_m(self) -> np.ndarray:
        """Radii of the tips, (j,) m."""
        return np.array([self.tip_of(press).radius_m for press in range(len(self))])

    @property
    def round_tips(self) -> bool:
        """True if no tip has a flat face."""
        return all(self.tip_of(press).grows for press in range(len(self)))

    @property
    def widest_m(self) -> float:
        """Radius of the largest tip, m."""
        return float(self.radii_m.max())

    @property
    def ids(self) -> np.ndarray:
        """Numbers of the presses in the scan, (j,)."""
        return np.arange(len(self)) if self.press_ids is None else self.press_ids

    @cached_property
    def body(self) -> BodySurface:
        """Surface of the body, undeformed."""
        return self.surface or BodySurface.block(self.body_size_m)

    def thickness_m(self, press: int) -> float:
        """Length of a press's line inside the body, m."""
        return self.body.thickness_m(self.points_m[press], self.directions[press])

    def tilts_rad(self) -> np.ndarray:
        """Angles between the presses and the surface's inward normals, (j,) rad."""
        normals = self.body.footing(self.points_m, self.radii_m).normals
        cosine = -np.einsum("ji,ji->j", normals, self.directions)
        return np.arccos(np.clip(cosine, -1, 1))

    def with_tips(self, tips: Sequence[Tip]) -> ScanPlan:
        """Return the plan with tips that take turns from press to press, each carried once.

        Forces are in proportion to the radii, so that all go about as deep; the widest has the
        plan's.
        """
        turn = np.arange(len(self)) % len(tips)
        order = np.argsort(turn, kind="stable")
        radii = np.array([tip.radius_m for tip in tips])[turn]
        forces = np.array([self.force_of(press) for press in range(len(self))])
        turned = replace(
            self,
            tips=tuple(tips[int(k)] for k in turn),
            forces_n=forces * radii / radii.max(),
        )
        return replace(turned.only(order), press_ids=None)

    def only(self, presses: np.ndarray) -> ScanPlan:
        """Return the plan of some of the presses (their numbers), in that order."""
        program = self.program and self.program.only(presses)
        return replace(
            self,
            points_m=self.points_m[presses],
            directions=self.directions[presses],
            program=program,
            press_ids=self.ids[presses],
            tips=tuple(self.tips[int(press)] for press in presses) if self.tips else (),
            forces_n=None if self.forces_n is None else self.forces_n[presses],
        )


def program_plan(
    program: PressProgram,
    body: tuple[float, float, float] | BodySurface,
    kind: Kind = "flat",
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **settings: object,
) -> ScanPlan:
    """Plan the presses of a program on a body.

    Parameters
    ----------
    program : the presses, in the body's frame; its radii are those of tips of a kind
    body : edges of a block, or a surface
    kind : of the tips
    origin_m : of the body's frame in the frame of the scan, for sentences
    **settings : further fields of `ScanPlan`

    Raises
    ------
    InputError
        A tip that does not lie on the body.
    """
    surface = body if isinstance(body, BodySurface) else None
    size: tuple[float, ...] = tuple(body.extent_m) if isinstance(body, BodySurface) else body
    shape = surface or BodySurface.block(size)  # pyright: ignore[reportArgumentType]
    points = np.column_stack([program.x_m, program.y_m, program.z_m])
    above = np.isnan(program.z_m)
    points[above, 2] = shape.top(points[above, :2])[:, 2]
    _refuse_beside(points, shape, np.array(origin_m))
    footing = shape.footing(points, program.radius_m)
    points = np.where(above[:, None], points, footing.points_m)
    given = program.direction / np.linalg.norm(program.direction, axis=1, keepdims=True)
    directions = np.where(np.isnan(given), -footing.normals, given)
    borne = shape.bears(points, -directions, program.radius_m)
    if not borne.all():
        j = int(np.flatnonzero(~borne)[0])
        x, y, _ = points[j] + origin_m
        raise InputError(
            f"Press {j} of the program at x_m {x:g}, y_m {y:g}: its tip of "
            f"{program.radius_m[j]:g} m radius hangs over the edge of the body of "
            f"{size[0]:.3g} x {size[1]:.3g} m."
        )
    return ScanPlan(
        points,
        directions,
        force_n=float(program.force_n.max()),
        tip_radius_m=float(program.radius_m.max()),
        tips=tuple(Tip(kind, float(radius)) for radius in program.radius_m),
        body_size_m=size,  # pyright: ignore[reportArgumentType]
        program=program,
        surface=surface,
        origin_m=origin_m,
        **settings,  # pyright: ignore[reportArgumentType]
    )


def _refuse_beside(points: np.ndarray, body: BodySurface, origin_m: np.ndarray) -> None:
    """Refuse presses beside the body or off its surface; both in the body frame."""
    beside = np.flatnonzero(np.isnan(points[:, 2]))
    if len(beside):
        low, high = body.vertices_m.min(axis=0) + origin_m, body.vertices_m.max(axis=0) + origin_m
        j = int(beside[0])
        x, y, _ = points[j] + origin_m
        raise InputError(
            f"Press {j} of the program at x_m {x:g}, y_m {y:g}: there is no "
            f"body, and its tip hangs over the edge; the body reaches from {low[0]:.4g} to "
            f"{high[0]:.4g} m in x and from {low[1]:.4g} to {high[1]:.4g} m in y."
        )
    off = np.linalg.norm(body.closest(points)[0] - points, axis=1)
    if off.max() > OFF_SURFACE_M:
        j = int(off.argmax())
        place = np.round(1e3 * (points[j] + origin_m), 2).tolist()
        raise InputError(
            f"Press {j} of the program at {place} mm is "
            f"{1e3 * off[j]:.3g} mm off the body's surface, expected at most "
            f"{1e3 * OFF_SURFACE_M:g} mm; correct z_m, or leave it out for the upper surface."
        )
