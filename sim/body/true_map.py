"""The virtual body's true stiffness: inclusions on a background, Gaussian unless told otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import erf

from models import InputError, LabelVolume
from sim.motion import BodySurface

TRIES = 200
"""Places drawn for inclusions, of which most are too near to the surface or to each other."""


def _spot(distance: np.ndarray, share: float) -> np.ndarray:
    """Blurred ball that is 1 at its centre, with the integral of exp(-distance^2/2)."""
    height = _blurred_ball(np.zeros(1), share)[0]
    return _blurred_ball(distance / height ** (1 / 3), share) / height


def _blurred_ball(distance: np.ndarray, share: float) -> np.ndarray:
    """Ball with the part `share` of the mean square radius, folded with a Gaussian of the rest.

    Its integral and its mean square radius are those of exp(-distance^2/2), which it is at 0.
    """
    radius = np.sqrt(5 * share)  # mean square radius of a ball: 3/5 R^2, of the Gaussian: 3
    if radius < 0.02:
        return np.exp(-(distance**2) / 2)
    rho = np.maximum(distance, 1e-6)
    blur = max(np.sqrt(max(1 - share, 0.0)), 1e-3)
    inner, outer = (radius - rho) / blur, (radius + rho) / blur
    even = (erf(inner / np.sqrt(2)) + erf(outer / np.sqrt(2))) / 2
    bend = blur / (np.sqrt(2 * np.pi) * rho) * (np.exp(-(inner**2) / 2) - np.exp(-(outer**2) / 2))
    return (2 * np.pi) ** 1.5 / (4 / 3 * np.pi * radius**3) * (even - bend)


@dataclass(frozen=True)
class Inclusion:
    """A hard (or soft) spot.

    Attributes
    ----------
    weight_pa : added modulus in its centre, Pa
    centre_m : (x, y, z) m, body frame
    radius_m : standard deviation of the Gaussian, m
    ball_share : 0 a Gaussian, 1 a ball of even stiffness with a sharp edge, between them a ball
        with a blurred one; the value at the centre and the integral stay
    stretch, angle_rad : it is longer by this share than wide and high, in the horizontal direction
        at this angle to x; its volume is that of the round one
    """

    weight_pa: float = 30000.0
    centre_m: tuple[float, float, float] = (0.040, 0.058, 0.034)
    radius_m: float = 0.010
    ball_share: float = 0.0
    stretch: float = 0.0
    angle_rad: float = 0.0

    def added(self, points_m: np.ndarray) -> np.ndarray:
        """Modulus that it adds at points (p, 3) m, (p,) Pa."""
        away = points_m - np.asarray(self.centre_m)
        along = away @ [np.cos(self.angle_rad), np.sin(self.angle_rad), 0.0]
        shorter = 1 - (1 + self.stretch) ** -2
        squared = (away**2).sum(axis=1) - shorter * along**2
        scaled = squared * (1 + self.stretch) ** (2 / 3) / self.radius_m**2
        shape = _spot(np.sqrt(scaled), self.ball_share)
        return self.weight_pa * shape


@dataclass(frozen=True)
class TruthMap:
    """E(p) = background + sum_i weight_i exp(-|p - centre_i|^2 / (2 radius_i^2)), Pa.

    In `regions`, in the body's frame, those with a modulus in `region_pa` have that as background.

    Examples
    --------
    >>> truth = TruthMap(6000.0, (Inclusion(12000.0, (0.05, 0.05, 0.03), 0.01),))
    >>> truth(np.array([[0.05, 0.05, 0.03]])).tolist()
    [18000.0]
    """

    background_pa: float = 6000.0
    inclusions: tuple[Inclusion, ...] = (Inclusion(),)
    regions: LabelVolume | None = field(default=None, hash=False)
    region_pa: Mapping[int, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.background_pa > 0:
            raise InputError(
                f"The background modulus is {self.background_pa:g} Pa; it has to be positive."
            )
        for i, inclusion in enumerate(self.inclusions, start=1):
            if not inclusion.radius_m > 0:
                raise InputError(
                    f"Inclusion {i} has a radius of {inclusion.radius_m:g} m; it has to be "
                    "positive."
                )
            if not self.background_pa + inclusion.weight_pa > 0:
                raise InputError(
                    f"Inclusion {i} with {inclusion.weight_pa:g} Pa takes more than the background "
                    f"of {self.background_pa:g} Pa away; the modulus has to stay positive."
                )

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """Young's modulus at points (p, 3) m, (p,) Pa."""
        modulus = np.full(len(points_m), float(self.background_pa))
        if self.regions is not None:
            labels = self.regions.at(points_m)
            for label, own in self.region_pa.items():
                modulus[labels == label] = own
        for inclusion in self.inclusions:
            modulus += inclusion.added(points_m)
        return modulus

    def record(self) -> dict[str, Any]:
        """Return the map as a JSON record."""
        regions = {str(label): own for label, own in self.region_pa.items()}
        return {
            **({"regions_pa": regions} if regions else {}),
            "background_pa": self.background_pa,
            "inclusions": [
                {
                    "weight_pa": i.weight_pa,
                    **dict(zip(("x_m", "y_m", "z_m"), i.centre_m, strict=True)),
                    "radius_m": i.radius_m,
                }
                for i in self.inclusions
            ],
        }


def drawn_truth(surface: BodySurface, seed: int, inclusions: int = 1) -> TruthMap:
    """Draw a map at random: stiff inclusions under the upper surface of a body.

    Each lies as deep as its radius to three times that, where the body is thick enough for it.

    Parameters
    ----------
    surface : of the body, in whose frame the map is
    seed : of the draw
    inclusions : their number
    """
    rng = np.random.default_rng([seed, 6])
    background = float(np.exp(rng.uniform(np.log(4e3), np.log(1e4))))
    spots: list[Inclusion] = []
    low, extent = surface.lowest_m, surface.extent_m
    for _ in range(TRIES):
        if len(spots) == inclusions:
            break
        place = low[:2] + extent[:2] * rng.uniform(0.2, 0.8, 2)
        top = surface.top(place[None])[0]
        if np.isnan(top[2]):
            continue
        thick = surface.thickness_m(top, np.array([0.0, 0.0, -1.0]))
        radius = float(rng.uniform(0.15, 0.25) * thick)
        centre = top - [0.0, 0.0, min(float(rng.uniform(1.0, 2.0)) * radius + radius, 0.6 * thick)]
        apart = all(
            np.linalg.norm(centre - spot.centre_m) > 2 * (radius + spot.radius_m) for spot in spots
        )
        room = np.abs(surface.closest(centre[None])[0][0] - centre).max() > radius
        if apart and room:
            weight = background * float(rng.uniform(1.5, 4.0))
            spots.append(Inclusion(weight, tuple(centre.tolist()), radius))
    return TruthMap(background, tuple(spots))
