"""Young's modulus as seen from above and from the side, with one colour scale for all maps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import rerun as rr
from matplotlib import colormaps
from numpy.typing import ArrayLike, NDArray

from identify.fit import FitResult
from palpmap.figures.cuts import Cut, cut_name, cuts, sample, sample_in, seen_part
from palpmap.figures.style import is_wide
from palpmap.recording.stream import Log
from palpmap.result.finding import Finding
from palpmap.result.outline import Outline

Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]
GAP = 0.14  # space between the pictures of a map, as a fraction of the body's width
_NEAR = 0.1  # of the body's height: the depth of a cut near the surface
_GROUND = (13, 16, 17)  # of the viewer, where a map has no value
_LABEL_COLOR = (235, 235, 235)


@dataclass(frozen=True)
class MapViews:
    """Two pictures of a modulus field in the box around a body.

    Along each line of sight the value farthest from the median of the field is seen, so that no
    inclusion, stiffer or softer, is missed by the choice of a cutting plane.

    Attributes
    ----------
    top_pa : (ny, nx) Pa, seen from above, rows along +y
    side_pa : (nz, nx) Pa, seen along +y, rows along +z
    lower_m, upper_m : (3,) m, corners of the box, body frame
    captions : of the two
    in_part : NaN where the map is not shown
    """

    top_pa: NDArray[np.float64]
    side_pa: NDArray[np.float64]
    lower_m: NDArray[np.float64]
    upper_m: NDArray[np.float64]
    captions: tuple[str, str] = ("from above", "from the side")
    in_part: bool = False

    @property
    def range_pa(self) -> tuple[float, float]:
        """Smallest and largest modulus in both pictures, in Pa."""
        values = np.concatenate([self.top_pa.ravel(), self.side_pa.ravel()])
        return float(np.nanmin(values)), float(np.nanmax(values))


def map_views(
    modulus: Field,
    lower_m: ArrayLike,
    upper_m: ArrayLike,
    cells: int = 64,
) -> MapViews:
    """Sample a modulus field and look at it from above and from the side.

    Parameters
    ----------
    modulus : callable
        (p, 3) points in m, body frame -> (p,) Young's modulus in Pa.
    lower_m, upper_m : (3,) m
        Corners of the box around the body.
    cells : int
        Number of cells along the longest edge.

    Examples
    --------
    >>> views = map_views(lambda p: 1e3 + 1e5 * p[:, 0], (0, 0, 0), (0.1, 0.1, 0.05), cells=10)
    >>> views.top_pa.shape, views.side_pa.shape
    ((10, 10), (5, 10))
    >>> [round(float(v)) for v in views.side_pa[0, [0, -1]]]
    [1500, 10500]
    """
    lower, upper = np.asarray(lower_m, float), np.asarray(upper_m, float)
    size = upper - lower
    counts = np.maximum(2, np.rint(cells * size / size.max()).astype(int))
    axes = [lower[i] + (np.arange(n) + 0.5) * size[i] / n for i, n in enumerate(counts)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    values = modulus(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(z.shape)
    return MapViews(_farthest(values, 0), _farthest(values, 1), lower, upper)


def cut_views(finding: Finding, fit: FitResult, modulus: Field) -> MapViews:
    """Return the cuts of a free map's report: NaN beside the body, and where the scan is blind.

    A line of sight through a map of any form would end at what the scan does not show.

    Parameters
    ----------
    fit : whose sight counts
    """
    both, outline = cuts(finding), finding.outline
    top, side = (seen_part(finding, fit, cut, sample(finding, cut, modulus)) for cut in both)
    names = (cut_name(finding, both[0]), cut_name(finding, both[1]))
    return MapViews(top, side, outline.lower_m, outline.upper_m, names, in_part=True)


def near_views(outline: Outline, modulus: Field) -> MapViews:
    """Return cuts of a free map whose sight is not known yet: near the surface, in the middle."""
    low, high = outline.lower_m, outline.upper_m
    near, middle = Cut(2, _NEAR * float(high[2] - low[2])), Cut(1, float(low[1] + high[1]) / 2)
    top, side = (sample_in(outline, cut, modulus) for cut in (near, middle))
    names = ("near the surface", "from the side, cut in the middle")
    return MapViews(top, side, low, high, names, in_part=True)


def _farthest(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Value farthest from the median of the field along one axis."""
    index = np.abs(values - np.median(values)).argmax(axis=axis, keepdims=True)
    return np.take_along_axis(values, index, axis=axis).squeeze(axis)


def modulus_colors(modulus_pa: ArrayLike, range_pa: tuple[float, float]) -> NDArray[np.uint8]:
    """Colours (n, 3) of the modulus on the scale of the maps (viridis)."""
    lower, upper = _shown(range_pa, range_pa)
    share = (_shown(modulus_pa, range_pa) - lower) / max(upper - lower, 1e-30)
    return colormaps["viridis"](np.clip(share, 0, 1), bytes=True)[..., :3].astype(np.uint8)


def _shown(modulus_pa: ArrayLike, range_pa: tuple[float, float]) -> NDArray[np.float64]:
    """Modulus on a scale of its colours, which is logarithmic where they reach far."""
    modulus = np.asarray(modulus_pa, float)
    return np.log10(modulus) if is_wide(range_pa) else modulus


def residual_colors(residual: ArrayLike, limit: float) -> NDArray[np.uint8]:
    """Colours (n, 3): red where the body gave way more than modelled, blue where less."""
    share = 0.5 + 0.5 * np.asarray(residual, float) / max(limit, 1e-30)
    return colormaps["coolwarm"](np.clip(share, 0, 1), bytes=True)[..., :3].astype(np.uint8)


def picture_bounds(size_m: NDArray[np.float64]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y, in mm, that show both pictures of a map with colour bar and captions."""
    width, depth, height = size_m * 1e3
    gap = GAP * width
    return (-0.5 * gap, width + 4.2 * gap), (-1.2 * gap, depth + height + 3.0 * gap)


def log_map(
    log: Log,
    entity: str,
    views: MapViews,
    range_pa: tuple[float, float],
) -> None:
    """Log both pictures of a map with its colour bar, in mm, the view from above on top.

    Parameters
    ----------
    log : callable
        ``log(entity, *archetypes)``, bound to a place on the timelines.
    entity : str
        Folder of the map.
    views : MapViews
    range_pa : (float, float)
        Ends of the colour scale, in Pa.
    """
    width, depth, height = (views.upper_m - views.lower_m) * 1e3
    gap = GAP * width
    top_of_side = depth + gap
    bottom = top_of_side + height
    # Pictures have their first row on top, a body has its y and z upwards.
    for name, image, corner, extent in (
        ("top", views.top_pa[::-1], (0.0, 0.0), (width, depth)),
        ("side", views.side_pa[::-1], (0.0, top_of_side), (width, height)),
        ("scale", _ramp(range_pa), (width + 0.8 * gap, 0.0), (0.5 * gap, bottom)),
    ):
        rows, columns = image.shape
        log(
            f"{entity}/{name}",
            rr.Transform3D(
                translation=[*corner, 0.0], scale=[extent[0] / columns, extent[1] / rows, 1.0]
            ),
            _picture(image, range_pa, views.in_part),
        )
    texts = {
        views.captions[0]: (width / 2, -0.6 * gap),
        views.captions[1]: (width / 2, bottom + 0.7 * gap),
    } | {
        f"{float(f'{value / 1e3:.3g}'):g} kPa": (width + 2.8 * gap, bottom * (1 - share))
        for share, value in zip((0, 0.5, 1), _evenly(range_pa, 3), strict=True)
    }
    log(
        f"{entity}/captions",
        rr.Points2D(
            list(texts.values()),
            labels=list(texts),
            radii=0.0,
            colors=_LABEL_COLOR,
            show_labels=True,
        ),
    )


def _picture(
    image: NDArray[np.float64], range_pa: tuple[float, float], in_part: bool
) -> rr.DepthImage | rr.Image:
    """Picture of a modulus; a depth image has a colour everywhere, and a value to look at."""
    if in_part:
        colors = modulus_colors(image, range_pa)
        colors[np.isnan(image)] = _GROUND
        return rr.Image(colors, magnification_filter="linear")
    return rr.DepthImage(
        _shown(image, range_pa).astype(np.float32),
        meter=1.0,
        colormap="viridis",
        depth_range=_shown(range_pa, range_pa),
        magnification_filter="linear",
    )


def _ramp(range_pa: tuple[float, float]) -> NDArray[np.float64]:
    return _evenly(range_pa, 64)[::-1, None].repeat(2, axis=1)


def _evenly(range_pa: tuple[float, float], count: int) -> NDArray[np.float64]:
    """Moduli (count,) at even steps of the colour scale."""
    return (np.geomspace if is_wide(range_pa) else np.linspace)(*range_pa, count)


def log_outlines(
    log: Log,
    entity: str,
    parameters: Mapping[str, float],
    views: MapViews,
    color: tuple[int, int, int],
) -> None:
    """Draw each inclusion of a Gaussian map as a circle of its radius in both pictures of a map."""
    width, depth, _ = (views.upper_m - views.lower_m) * 1e3
    bottom = depth + GAP * width + (views.upper_m - views.lower_m)[2] * 1e3
    turn = np.linspace(0, 2 * np.pi, 61)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    strips = []
    for name in sorted(n.removesuffix(".radius_m") for n in parameters if n.endswith(".radius_m")):
        center = np.array([parameters[f"{name}.{axis}_m"] for axis in "xyz"])
        x, y, z = (center - views.lower_m) * 1e3
        radius = parameters[f"{name}.radius_m"] * 1e3
        strips += [np.array([x, depth - y]) + radius * circle]
        strips += [np.array([x, bottom - z]) + radius * circle]
    if strips:
        log(f"{entity}/outline", rr.LineStrips2D(strips, colors=color, radii=0.004 * width))
