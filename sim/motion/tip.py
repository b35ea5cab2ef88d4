"""Tips of the probe: flat, ball, cone with a rounded end, ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from models import InputError

Kind = Literal["flat", "ball", "cone", "ring"]
KINDS: tuple[Kind, ...] = ("flat", "ball", "cone", "ring")
LARGEST_M = 0.05
CONE_DEG = 45.0
INNER_SHARE = 0.6
MILLIMETRE = 1e-3


@dataclass(frozen=True)
class Tip:
    """A rigid tip with an axis of symmetry.

    Attributes
    ----------
    kind : "flat", "ball", "cone" (its end rounded) or "ring" (flat, with a hole)
    radius_m : of the flat face, the ball, the cone's rounded end, or the ring's outer rim
    angle_deg : of a cone, between its side and its axis
    inner_share : of a ring, inner over outer radius

    Examples
    --------
    >>> Tip("ball", 0.01).gap_m(np.array([0.006])).round(6).tolist()
    [0.002]
    """

    kind: Kind = "flat"
    radius_m: float = 0.005
    angle_deg: float = CONE_DEG
    inner_share: float = INNER_SHARE

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"The tip is a '{self.kind}'; expected one of {', '.join(KINDS)}.")
        if not 0 < self.radius_m <= LARGEST_M:
            raise InputError(
                f"The tip's radius is {self.radius_m:g} m; expected more than 0 and at most "
                f"{LARGEST_M:g} m."
            )
        if not 10 <= self.angle_deg <= 85:
            raise InputError(
                f"The cone's angle is {self.angle_deg:g} degrees between side and axis; expected "
                "10 to 85."
            )
        if not 0 < self.inner_share < 1:
            raise InputError(
                f"The ring's inner radius is {self.inner_share:g} of its outer one; expected "
                "between 0 and 1."
            )

    @property
    def grows(self) -> bool:
        """True if the contact grows with the force."""
        return self.kind in ("ball", "cone")

    def gap_m(self, radius_m: np.ndarray) -> np.ndarray:
        """Height of the tip over its lowest point at distances from the axis, m."""
        r = np.asarray(radius_m, float)
        if not self.grows:
            return np.zeros_like(r)
        if self.kind == "ball":
            return self.radius_m - np.sqrt(np.maximum(self.radius_m**2 - r**2, 0.0))
        slope = 1 / np.tan(np.radians(self.angle_deg))
        rounded = self.radius_m * slope / np.sqrt(1 + slope**2)  # where the ball meets the side
        end = self.radius_m - np.sqrt(self.radius_m**2 - np.minimum(r, rounded) ** 2)
        return end + slope * np.maximum(r - rounded, 0.0)

    def slope(self, radius_m: np.ndarray) -> np.ndarray:
        """Return the derivative of `gap_m`."""
        r = np.asarray(radius_m, float)
        if not self.grows:
            return np.zeros_like(r)
        inside = np.minimum(r, 0.999 * self.radius_m)
        ball = inside / np.sqrt(self.radius_m**2 - inside**2)
        if self.kind == "ball":
            return ball
        return np.minimum(ball, 1 / np.tan(np.radians(self.angle_deg)))

    @property
    def widest_m(self) -> float:
        """Largest contact radius that its shape allows."""
        return 0.95 * self.radius_m if self.kind == "ball" else LARGEST_M

    @property
    def deepest_m(self) -> float:
        """Largest depth that its shape allows."""
        return self.radius_m if self.kind == "ball" else np.inf

    def __str__(self) -> str:
        return f"{self.kind}:{self.radius_m / MILLIMETRE:g}"


def read_tips(text: str, usual: Kind = "flat") -> tuple[Tip, ...]:
    """Read tips from a text as `3,10` or `flat:3,ball:8`, radii in mm.

    A third number is a cone's angle in degrees, or a ring's inner radius in mm.

    Parameters
    ----------
    usual : kind where none is given

    Examples
    --------
    >>> [str(tip) for tip in read_tips("3,ball:8,ring:6:3")]
    ['flat:3', 'ball:8', 'ring:6']
    """
    tips = []
    for part in text.split(","):
        words = part.strip().split(":")
        kind = usual if words[0][:1].isdigit() or words[0][:1] == "." else words.pop(0)
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        expected = 2 if kind in ("cone", "ring") else 1
        if kind not in KINDS or not 1 <= len(numbers) <= expected:
            raise InputError(
                f"tips: found '{part.strip()}', expected a radius in mm, or KIND:RADIUS with one "
                f"of {', '.join(KINDS)}, as flat:3,ball:8 (cone:RADIUS:ANGLE, ring:OUTER:INNER)"
            )
        more = {}
        if len(numbers) == 2:
            angle = kind == "cone"
            more = {"angle_deg": numbers[1]} if angle else {"inner_share": numbers[1] / numbers[0]}
        tips.append(Tip(kind, numbers[0] * MILLIMETRE, **more))  # pyright: ignore[reportArgumentType]
    return tuple(tips)
