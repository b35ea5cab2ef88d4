"""Areas whose presses feel a harder or softer body than the others: bands, walls, wide lumps.

Balls have a test of their own (`identify.fit.free_map.spots`); a band is none, and a prior that
bends steeply draws it without any. What a press feels is its apparent modulus on the map, that of
an even body of its compliance. Presses of one tip feel the same depths, so that layers do not
count. Draws of the posterior give its standard deviation against the half of the presses of the
tip that are most alike, and the largest that all presses together have by chance. An area holds a
press beyond that, and the neighbours that differ by more than 1.96 of their own and half as much
as the most.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.outline import beyond_presses
from identify.fit.free_map.settings import SPOTS, SpotSettings

_OWN = 1.96  # standard deviations by which the presses of an area differ


@dataclass(frozen=True)
class Area:
    """An area whose presses feel a harder or softer body than the others.

    Attributes
    ----------
    x_m, y_m, z_m : middle of its contact points, body frame
    length_m, width_m : edges of the rectangle of the same second moments
    presses : number in it
    contrast : modulus that they feel over that of the other presses, geometric means
    lower95, upper95 : interval of the contrast
    at_rim : it reaches the outermost presses, where a side of the body is felt, too
    """

    x_m: float
    y_m: float
    z_m: float
    length_m: float
    width_m: float
    presses: int
    contrast: float
    lower95: float
    upper95: float
    at_rim: bool


def find_areas(
    posterior: FieldPosterior,
    log_felt: np.ndarray,
    points_m: np.ndarray,
    tip_m: np.ndarray,
    across: np.ndarray,
    settings: SpotSettings = SPOTS,
) -> tuple[Area, ...]:
    """Return the areas that differ for sure, all presses counted.

    Those within the scan come before those at its rim; what differs most in all is first.

    Parameters
    ----------
    log_felt : (j,) logarithm of the modulus that each press feels on the map
    points_m : (j, 3) where each touches
    tip_m : (j,) radius of each tip
    across : (2, 3) directions along the surface
    """
    data = posterior.data
    told = np.flatnonzero(data.sums.normal[:, 0, 0] > 0)
    if len(told) <= settings.area_presses:
        return ()
    points, tip_m = points_m[told], tip_m[told]
    changes = posterior.draws(np.random.default_rng(0), settings.area_draws) - posterior.mean
    felt = np.vstack([log_felt[told], -changes @ data.by_field[told].T])
    for radius in np.unique(tip_m):
        of_tip = np.flatnonzero(tip_m == radius)
        alike = of_tip[_densest_half(felt[0, of_tip])]
        felt[:, of_tip] -= felt[:, alike].mean(axis=1, keepdims=True)
    unit = felt[1:].std(axis=0)
    unit[unit < 1e-12] = np.inf  # the only press of its tip
    sure = np.quantile(np.abs(felt[1:] / unit).max(axis=1), settings.area_confidence)
    apart = cdist(points, points)
    others = np.where(apart > settings.area_place * tip_m.min(), apart, np.inf)
    spacing_m = float(np.median(others.min(axis=1)))
    if not np.isfinite(spacing_m):  # presses of one place
        return ()
    at_rim = beyond_presses(points, points, across) > -spacing_m / 2
    areas = []
    for sign in (1, -1):
        beyond = sign * felt[0] / unit
        size = np.where(beyond > _OWN, sign * felt[0], 0.0)
        for inside in _lumps(size, apart < settings.area_reach * spacing_m, settings.area_edge):
            if len(inside) < settings.area_presses or beyond[inside].max() < sure:
                continue
            rest = np.delete(felt, inside, axis=1).mean(axis=1)
            contrast, *changed = (felt[:, inside].mean(axis=1) - rest).tolist()
            if abs(contrast) < settings.area_least:
                continue
            log = contrast + 1.96 * float(np.std(changed)) * np.array([0, -1, 1])
            contrast, lower, upper = np.exp(log).tolist()
            away = points[inside] - points[inside].mean(axis=0)
            moments = np.linalg.eigvalsh(away.T @ away / len(inside))[1:] + spacing_m**2 / 12
            width, length = np.sqrt(12 * moments).tolist()
            x, y, z = points[inside].mean(axis=0).tolist()
            rim = bool(at_rim[inside].any())
            areas.append(Area(x, y, z, length, width, len(inside), contrast, lower, upper, rim))
    # At the rim also the surroundings of lumps
    areas.sort(key=lambda area: (area.at_rim, -area.presses * abs(np.log(area.contrast))))
    return tuple(areas)


def _densest_half(values: np.ndarray) -> np.ndarray:
    """Return the numbers of the half of some values (n,) that lies closest together.

    Around a lump these are the presses that do not feel it; the middle half are those that feel a
    little of it.
    """
    order, count = np.argsort(values), len(values) // 2 + 1
    ranges = values[order[count - 1 :]] - values[order[: len(values) - count + 1]]
    first = int(np.argmin(ranges))
    return order[first : first + count]


def _lumps(size: np.ndarray, near: np.ndarray, edge: float) -> Iterator[np.ndarray]:
    """Yield the numbers of the presses around each peak of sizes (j,), of neighbours (j, j) bool.

    Connected, and larger than the peak's share `edge`; the slope of another peak is none.
    """
    left = size > 0
    while left.any():
        peak = int(np.argmax(np.where(left, size, 0.0)))
        left[peak] = False
        if size[near[peak]].max() > size[peak]:
            continue
        large = left & (size > edge * size[peak])
        large[peak] = True
        numbers = np.flatnonzero(large)
        _, labels = connected_components(csr_array(near[np.ix_(numbers, numbers)]), directed=False)
        inside = numbers[labels == labels[numbers == peak]]
        left[inside] = False
        yield inside
