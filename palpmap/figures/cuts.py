"""Cuts through a body, on which a map is drawn: along its surface, and from side to side."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from identify.fit import SPOTS, FitResult
from identify.map import FreeMap, Inclusion
from palpmap.result.finding import Finding
from palpmap.result.outline import Outline

CELLS = 160
BLIND = SPOTS.seen  # share of the prior's variance taken away, below which a place is blind
_NEAREST = 0.03  # of the body's height: the least depth of a cut along the surface


@dataclass(frozen=True)
class Cut:
    """A cut through the body, in its frame.

    Attributes
    ----------
    normal : axis across it: 0 x, 1 y; 2 a cut that follows the body's surface
    at_m : its place along x or y, m; the depth below the surface of one that follows it
    """

    normal: int
    at_m: float

    @property
    def axes(self) -> tuple[int, int]:
        """The axes drawn to the right and upwards."""
        right, up = (a for a in range(3) if a != self.normal)
        return right, up


def cuts(f: Finding) -> tuple[Cut, Cut]:
    """Return a cut along the surface and a vertical one through the map's strongest inclusion.

    The vertical one lies across x or y, whichever comes nearer to the other inclusions.
    """
    if isinstance(f.fit.map, FreeMap):
        return _through(f.outline, _free_place(f, f.fit.map), 1)
    inclusions = f.map.inclusions
    if not inclusions:
        return _through(f.outline, (f.outline.lower_m + f.outline.upper_m) / 2, 1)
    strongest = max(inclusions, key=lambda i: abs(i.weight_pa))
    distance = {
        axis: sum((centre_m(i)[axis] - centre_m(strongest)[axis]) ** 2 for i in inclusions)
        for axis in (1, 0)
    }
    return _through(f.outline, centre_m(strongest), min(distance, key=lambda a: distance[a]))


def _through(outline: Outline, place_m: np.ndarray, axis: int) -> tuple[Cut, Cut]:
    """Return the cuts through a place (3,), or through the body's part nearest to it."""
    lower, upper = outline.lower_m, outline.upper_m
    at = np.clip(place_m, lower, upper)
    top = float(outline.top(at[None, :2])[0])
    depth = (upper[2] if np.isnan(top) else top) - at[2]
    return Cut(2, max(float(depth), _NEAREST * float(upper[2] - lower[2]))), Cut(axis, at[axis])


def _free_place(f: Finding, found: FreeMap) -> np.ndarray:
    """Place of a free map's first spot, or of its largest difference from its layer in sight."""
    field = f.fit.field
    assert field is not None
    for spot in field.spots:
        if not spot.wide:
            return np.array([spot.x_m, spot.y_m, spot.z_m])
    layers = found.log_pa.reshape(found.grid.counts)
    differs = np.abs(layers - np.median(layers, axis=(0, 1))).ravel() * field.share
    return found.grid.points_m[int(np.argmax(differs))]


def sample(f: Finding, cut: Cut, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values (rows, columns) of a field on a cut, NaN outside the body."""
    return sample_in(f.outline, cut, law)


def sample_in(outline: Outline, cut: Cut, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values (rows, columns) of a field on a cut, NaN outside a body."""
    points, inside = _points(outline, cut)
    return np.where(inside, law(points.reshape(-1, 3)).reshape(inside.shape), np.nan)


@lru_cache(maxsize=8)
def _points(outline: Outline, cut: Cut) -> tuple[np.ndarray, np.ndarray]:
    """Points (rows, columns, 3) of a cut, and which of them are in the body."""
    lower, upper = outline.lower_m, outline.upper_m
    right, up = cut.axes
    cell = max(upper - lower) / CELLS
    counts = [max(round((upper[a] - lower[a]) / cell), 2) for a in (right, up)]
    u, v = (
        lower[a] + (np.arange(n) + 0.5) / n * (upper[a] - lower[a])
        for a, n in zip((right, up), counts, strict=True)
    )
    points = np.empty((counts[1], counts[0], 3))
    points[..., right], points[..., up] = np.meshgrid(u, v)
    flat = points.reshape(-1, 3)
    if cut.normal == 2:
        top = outline.top(flat[:, :2])
        flat[:, 2] = np.where(np.isnan(top), upper[2], top) - cut.at_m
        inside = ~np.isnan(top) & (flat[:, 2] >= lower[2]) & outline.inside(flat)
    else:
        flat[:, cut.normal] = cut.at_m
        inside = outline.inside(flat)
    return points, inside.reshape(counts[1], counts[0])


def seen_share(f: Finding, fit: FitResult, cut: Cut) -> np.ndarray | None:
    """Share of a free map's prior variance taken away on a cut; of others 1 in the probed part."""
    field, found = fit.field, fit.map
    if field is not None and isinstance(found, FreeMap):
        return sample(f, cut, lambda p: found.grid.interpolated(field.share, p))
    if (probed := f.probed_m) is None:
        return None
    return sample(f, cut, lambda p: ((probed[0] <= p) & (p <= probed[1])).all(axis=1).astype(float))


def seen_part(f: Finding, fit: FitResult, cut: Cut, values: np.ndarray) -> np.ndarray:
    """Values of a cut where the scan sees; NaN elsewhere, where a map is a guess and hatched."""
    share = seen_share(f, fit, cut)
    if share is None:
        return values
    part = np.where(share >= BLIND, values, np.nan)
    return part if np.isfinite(part).any() else values


def centre_m(inclusion: Inclusion) -> np.ndarray:
    """Centre (3,) of an inclusion, m."""
    return np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])


def cut_size(f: Finding, cut: Cut) -> tuple[float, float]:
    """Width and height of a cut through the body's box, m."""
    extent = f.outline.upper_m - f.outline.lower_m
    return float(extent[cut.axes[0]]), float(extent[cut.axes[1]])


def cut_name(f: Finding, cut: Cut) -> str:
    """Name of a cut, in the scan's frame."""
    if cut.normal == 2:
        depth = 1e3 * cut.at_m
        return f"{depth:.0f} mm below the surface"
    at = 1e3 * (cut.at_m + f.origin_m[cut.normal])
    return f"from the side, cut at {'xyz'[cut.normal]} = {at:.0f} mm"
