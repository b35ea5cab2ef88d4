"""Spots of a free map: places that are harder or softer than all around them.

A spot is a region of the most probable field at more than half the height of a peak over the
median of the seen part of the body, in the seen part itself, or less of it where the region would
reach to a higher peak. Its contrast is that of the means of
ln E inside and in a shell around it; the probability of the spot is the share of posterior draws in
which this contrast is real. Regions that reach across most of the body are layers, not spots.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.settings import SPOTS, SpotSettings
from identify.map import Grid


@dataclass(frozen=True)
class Spot:
    """A place that is harder or softer than its surroundings.

    Attributes
    ----------
    x_m, y_m, z_m : centre, body frame
    place_sd_m : standard deviation of the centre, root mean square over the axes
    diameter_m : of a ball of the same volume, at half height, in the map as it is smeared
    width_m : over which the map is smeared there
    contrast : mean modulus inside over that around it (geometric means)
    lower95, upper95 : interval of the contrast
    probability : that the contrast is at least that of `SpotSettings.least_contrast`
    depth_seen : share of the prior's variance at the centre that the readings take away
    """

    x_m: float
    y_m: float
    z_m: float
    place_sd_m: float
    diameter_m: float
    width_m: float
    contrast: float
    lower95: float
    upper95: float
    probability: float
    depth_seen: float

    @property
    def size_m(self) -> float | None:
        """Diameter without the smearing; None for a spot that is hardly wider than that."""
        if self.diameter_m < SPOTS.resolved * self.width_m:
            return None
        return float(np.sqrt(self.diameter_m**2 - self.width_m**2))

    @property
    def found(self) -> bool:
        """Whether the spot is offered as one."""
        return self.probability >= SPOTS.probable


def find_spots(posterior: FieldPosterior, settings: SpotSettings = SPOTS) -> tuple[Spot, ...]:
    """Return the spots of a posterior, the most probable first; draws are always the same."""
    draws = posterior.draws(np.random.default_rng(0), settings.draws)
    grid = posterior.prior.grid
    seen = posterior.share > settings.seen
    if not seen.any():
        return ()
    found = []
    for sign in (1.0, -1.0):
        for inside in _regions(posterior.mean, seen, grid, sign, settings):
            spot = _spot(posterior, draws, inside, seen, sign, settings)
            if spot is not None and spot.probability >= settings.possible:
                found.append(spot)
    own: list[Spot] = []
    for spot in sorted(found, key=lambda spot: -abs(np.log(spot.contrast))):
        if not any(_is_halo(spot, stronger) for stronger in own):
            own.append(spot)
    return tuple(sorted(own, key=lambda spot: -spot.probability))


def _is_halo(spot: Spot, other: Spot) -> bool:
    """Whether a spot is the rim of a stronger one of the other sign: sharp steps overshoot."""
    own, more = np.log(spot.contrast), np.log(other.contrast)
    apart = np.linalg.norm([spot.x_m - other.x_m, spot.y_m - other.y_m, spot.z_m - other.z_m])
    near = apart < (spot.diameter_m + other.diameter_m) / 2 + other.width_m
    return bool(own * more < 0 and near)


def _regions(
    field: np.ndarray, seen: np.ndarray, grid: Grid, sign: float, settings: SpotSettings
) -> Iterator[np.ndarray]:
    """Yield the regions (g,) bool around the peaks, the highest first.

    A region is what lies above half of the peak's height, or, where that reaches to a higher peak,
    above the lowest level that does not.
    """
    height = np.where(seen, sign * (field - np.median(field[seen])), -np.inf)
    cube = height.reshape(grid.counts)
    tops = (cube == ndimage.maximum_filter(cube, size=3)).ravel()
    least = np.log(settings.least_contrast)
    peaks = [p for p in np.argsort(-height).tolist() if tops[p] and height[p] >= least]
    labels, higher, found = np.empty(grid.counts, dtype=int), np.zeros(len(height), bool), 0
    for peak in peaks:
        for share in settings.levels:
            if height[peak] * (1 - share) < least / 2:
                break  # hardly rises above its surroundings
            ndimage.label(cube > share * height[peak], output=labels)
            inside = labels.ravel() == labels.ravel()[peak]
            if not (inside & higher).any():
                if _is_compact(inside, grid, settings):
                    found += 1
                    yield inside
                break
        higher[peak] = True
        if found == settings.most:
            return


def _is_compact(inside: np.ndarray, grid: Grid, settings: SpotSettings) -> bool:
    """Whether a region is short against the body, along both horizontal axes."""
    places = np.argwhere(inside.reshape(grid.counts))
    extent = np.ptp(places, axis=0) / (np.array(grid.counts) - 1)
    return bool((extent[:2] < settings.largest_share).all())


def _dilated(inside: np.ndarray, grid: Grid, steps: int = 1) -> np.ndarray:
    return ndimage.binary_dilation(inside.reshape(grid.counts), iterations=steps).ravel()


def _spot(
    posterior: FieldPosterior,
    draws: np.ndarray,
    inside: np.ndarray,
    seen: np.ndarray,
    sign: float,
    settings: SpotSettings,
) -> Spot | None:
    grid = posterior.prior.grid
    diameter = 2 * np.cbrt(0.75 / np.pi * inside.sum() * grid.cell_m3)
    steps = max(round(diameter / 2 / min(grid.spacing_m)), 2)
    wide = _dilated(inside, grid, steps)
    around = wide & ~_dilated(inside, grid) & seen
    if not around.any():
        return None
    contrast = draws[:, inside].mean(axis=1) - draws[:, around].mean(axis=1)
    own = posterior.mean[inside].mean() - posterior.mean[around].mean()
    centre = _centre(posterior.mean, inside, around, grid, sign)
    places = np.array([_centre(draw, inside, around, grid, sign) for draw in draws])
    at = int(np.argmin(np.linalg.norm(grid.points_m - centre, axis=1)))
    low, high = np.exp(np.percentile(contrast, [2.5, 97.5])).tolist()
    x, y, z = centre.tolist()
    return Spot(
        x, y, z,
        place_sd_m=float(np.sqrt(np.mean((places - centre) ** 2))),
        diameter_m=float(diameter),
        width_m=float(posterior.smearing_m(np.array([at]))[0]),
        contrast=float(np.exp(own)),
        lower95=low,
        upper95=high,
        probability=float(np.mean(sign * contrast > np.log(settings.least_contrast))),
        depth_seen=float(posterior.share[at]),
    )  # fmt: skip


def _centre(
    field: np.ndarray, inside: np.ndarray, around: np.ndarray, grid: Grid, sign: float
) -> np.ndarray:
    """Centre (3,) of a region, weighted with its height over the shell around it."""
    weight = np.maximum(sign * (field[inside] - field[around].mean()), 0.0) + 1e-9
    return weight @ grid.points_m[inside] / weight.sum()
