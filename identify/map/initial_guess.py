"""First guesses of a map from the presses themselves.

Each press's slope, relative to the compliance of a homogeneous body at the same place, gives an
apparent modulus free of the body's edges. The background is that of the presses beyond the reach of
inclusions; the inclusions lie under the presses that differ most from it. A few depths and radii
are proposed, because presses do not show them directly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from identify.map.gaussian_map import GaussianMap, Inclusion
from models import InputError


class _Kind(NamedTuple):
    """Sign of all inclusions, None for hard and soft ones; percentile of the background."""

    sign: float | None
    background_percent: float


_KINDS = (_Kind(1.0, 20.0), _Kind(-1.0, 80.0), _Kind(None, 50.0))
REFERENCE_PA = 1e4


@dataclass(frozen=True)
class ApparentModulus:
    """Modulus (j,) in Pa of a homogeneous body with the slope of each press, and the places."""

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


def start_maps(
    apparent: ApparentModulus,
    box: np.ndarray,
    inclusions: int,
    depths: Sequence[float],
    radii: Sequence[float],
) -> list[GaussianMap]:
    """Propose maps in a body with bounding box (2, 3) m; depths and radii in body heights."""
    if inclusions == 0:
        return [GaussianMap(float(np.median(apparent.modulus_pa)))]
    maps = []
    for kind in _KINDS if inclusions > 1 else _KINDS[:2]:
        for radius in radii:
            maps += _proposals(apparent, box, inclusions, depths, radius, kind)
    return maps


def _proposals(
    apparent: ApparentModulus,
    box: np.ndarray,
    inclusions: int,
    depths: Sequence[float],
    radius: float,
    kind: _Kind,
) -> list[GaussianMap]:
    """Propose maps with inclusions of one relative radius at several depths."""
    modulus = apparent.modulus_pa
    mean_direction = np.abs(apparent.directions.mean(axis=0))
    thickness = float((box[1] - box[0]) @ mean_direction / mean_direction.sum())
    background = float(np.percentile(modulus, kind.background_percent))
    width = 2.0 * radius * thickness
    differs = modulus / background - 1.0
    contrast = np.abs(differs) if kind.sign is None else kind.sign * differs
    peaks = []
    for _ in range(inclusions):
        top = int(np.argmax(contrast))
        height = max(float(contrast[top]), 0.05)
        peaks.append((top, height, kind.sign or float(np.sign(differs[top]))))
        distance = np.linalg.norm(apparent.points_m - apparent.points_m[top], axis=1)
        contrast = contrast - height * np.exp(-(distance**2) / (2 * width**2))
        contrast[distance < 0.5 * width] = -np.inf
    maps = []
    for depth in depths:
        # The press feels the layers above the centre, where the Gaussian has decayed.
        decay = np.exp(-0.5 * (0.5 * depth / radius) ** 2)
        placed = []
        for top, height, sign in peaks:
            share = height / max(decay, 0.2) if sign > 0 else -min(height, 0.9)
            below = apparent.points_m[top] + depth * thickness * apparent.directions[top]
            x, y, z = np.clip(below, *box).tolist()
            placed.append(Inclusion(share * background, x, y, z, radius * thickness))
        maps.append(GaussianMap(background, tuple(placed)))
    return maps


def scaled(stiffness: GaussianMap, factor: float) -> GaussianMap:
    """Return the map with all moduli multiplied; every compliance is divided by the factor."""
    values = stiffness.values
    values[0] *= factor
    values[1::5] *= factor
    return GaussianMap.from_values(values)
