"""First guesses of a map from the presses themselves.

Each press's own slope, put against the compliance of a homogeneous body at the same place, gives
an apparent modulus that is free of the body's edges. The background is read off the presses that
no inclusion reaches, the inclusions stand under the presses that differ most from it, and as the
depth and the radius cannot be read off, a few of both are proposed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identify.gaussian_map import GaussianMap, Inclusion
from models.errors import InputError

_DEPTHS = (0.15, 0.35, 0.6)
_RADII = (0.12, 0.25, 0.45)
REFERENCE_PA = 1e4


@dataclass(frozen=True)
class ApparentModulus:
    """Modulus (j,) in Pa of the homogeneous body that answers like each press; where they are."""

    modulus_pa: np.ndarray
    points_m: np.ndarray
    directions: np.ndarray


def apparent_modulus(
    slope: np.ndarray, points: np.ndarray, directions: np.ndarray, homogeneous: np.ndarray
) -> ApparentModulus:
    """Compare each press's slope (j,) m/N with the compliance (j,) of a body of `REFERENCE_PA`.

    Raises `InputError` where most presses have no positive slope.
    """
    positive = slope > 0
    if 2 * np.count_nonzero(positive) <= len(slope):
        raise InputError(
            f"in {np.count_nonzero(~positive)} of {len(slope)} presses the displacement does not "
            "grow with the force: check the signs of force_n and displacement_m in the scan"
        )
    # A press without a positive slope says nothing; it must not become the stiffest one.
    usable = np.where(positive, slope, np.median(slope[positive]))
    return ApparentModulus(REFERENCE_PA * homogeneous / usable, points, directions)


def start_maps(apparent: ApparentModulus, box: np.ndarray, inclusions: int) -> list[GaussianMap]:
    """Propose maps with so many inclusions in a body with bounding box (2, 3) m."""
    if inclusions == 0:
        return [GaussianMap(float(np.median(apparent.modulus_pa)))]
    maps = []
    for hard in (True, False):
        for radius in _RADII:
            maps += _proposals(apparent, box, inclusions, radius, hard=hard)
    return maps


def _proposals(
    apparent: ApparentModulus, box: np.ndarray, inclusions: int, radius: float, *, hard: bool
) -> list[GaussianMap]:
    """Propose maps with inclusions of one relative radius at several depths."""
    modulus = apparent.modulus_pa
    mean_direction = np.abs(apparent.directions.mean(axis=0))
    thickness = float((box[1] - box[0]) @ mean_direction / mean_direction.sum())
    background = float(np.percentile(modulus, 20 if hard else 80))
    sign = 1.0 if hard else -1.0
    width = 2.0 * radius * thickness
    contrast = sign * (modulus / background - 1.0)
    peaks = []
    for _ in range(inclusions):
        top = int(np.argmax(contrast))
        height = float(contrast[top])
        peaks.append((top, max(height, 0.05) if hard else min(max(height, 0.05), 0.9)))
        distance = np.linalg.norm(apparent.points_m - apparent.points_m[top], axis=1)
        contrast = contrast - max(height, 0.05) * np.exp(-(distance**2) / (2 * width**2))
        contrast[distance < 0.5 * width] = -np.inf
    maps = []
    for depth in _DEPTHS:
        # The press feels the layers above the centre, where the Gaussian has decayed.
        decay = np.exp(-0.5 * (0.5 * depth / radius) ** 2)
        placed = []
        for top, height in peaks:
            weight = sign * background * (height / max(decay, 0.2) if hard else height)
            below = apparent.points_m[top] + depth * thickness * apparent.directions[top]
            x, y, z = np.clip(below, *box).tolist()
            placed.append(Inclusion(weight, x, y, z, radius * thickness))
        maps.append(GaussianMap(background, tuple(placed)))
    return maps


def scaled(stiffness: GaussianMap, factor: float) -> GaussianMap:
    """Return the map with all moduli multiplied; every compliance is divided by the factor."""
    values = stiffness.values
    values[0] *= factor
    values[1::5] *= factor
    return GaussianMap.from_values(values)
