"""A hill or a dent of the surface at one place, which the robot does not know."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.placed_creep import surface
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length

_PLACES = 5  # of a grid, along each edge of the pressed surface
_RADII = 2  # of a grid, between the bounds
_LEAST_SPACINGS = 2.0  # radius of the smallest bump: a narrower one lies under single presses
_LEAST_PRESSES = 9


class SurfaceBump(Effect):
    """Height of a round bump, added to every displacement."""

    name = "surface_bump"
    family = "surface_tilt"
    title = "Bump of the surface"
    order = 83
    summary = (
        "The surface has a hill or a dent that the robot does not know, such as a fold, a blister "
        "or a seam, or first touch is declared later around one place. Displacements are off by "
        "a length that is largest at that place and falls to zero around it."
    )
    formula = "d = u + height cos^2(pi r / (2 radius)) where r < radius, the way from the place"
    latex = r"d = u + h \cos^2\!\left(\frac{\pi r}{2 R}\right) \; \text{where} \; r < R"
    source = "derivation: the simplest smooth height that ends at a radius"
    gives_away = "lines of travel over force miss the origin around one place, and not elsewhere"
    cure = "Measure the surface with light touches first, or detect first touch in each press."
    parameters = (
        EffectParameter(
            "height_m", "m", "added in the middle, above zero in a dent", 0.0, -0.01, 0.01, 1e-4
        ),
        EffectParameter("x_m", "m", "middle of the bump", None, -1.0, 1.0, 0.01),
        EffectParameter("y_m", "m", "middle of the bump", None, -1.0, 1.0, 0.01),
        EffectParameter("radius_m", "m", "where it ends", None, 1e-4, 1.0, 0.02, log=True),
    )
    needs = ("several forces", "several presses")
    examples = (
        WorkedExample(
            "Half way to the edge of the bump half of its height of 0.1 mm is added, beyond the "
            "edge nothing.",
            {"height_m": 1e-4, "x_m": 0.01, "y_m": 0.0, "radius_m": 0.02},
            {
                "press": (0.0, 1.0, 2.0),
                "point_m": ((0.01, 0.0, 0.0), (0.02, 0.0, 0.0), (0.04, 0.0, 0.0)),
                "travel_m": 3e-3,
            },
            {"displacement_m": (3.1e-3, 3.05e-3, 3e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        height_m: float,
        x_m: float,
        y_m: float,
        radius_m: float,
    ) -> np.ndarray:
        """Add the height."""
        away = np.hypot(readings.point_m[:, 0] - x_m, readings.point_m[:, 1] - y_m) / radius_m
        return travel_m + height_m * np.cos(0.5 * np.pi * np.minimum(away, 1.0)) ** 2

    def untestable(self, readings: Readings) -> str | None:
        """Refuse presses at one line, and few of them."""
        lacking = super().untestable(readings)
        if lacking is None and readings.presses < _LEAST_PRESSES:
            return f"the scan has only {readings.presses} presses, {_LEAST_PRESSES} are needed"
        edges = _edges(readings)
        return lacking or ("all presses are at one line" if min(edges) <= 0 else None)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Places all over the pressed surface, and few radii."""
        low, edges = surface(readings)[0], _edges(readings)
        shares = (np.arange(_PLACES) + 0.5) / _PLACES
        return [
            {"x_m": x, "y_m": y, "radius_m": radius}
            for x in (low[0] + shares * edges[0]).tolist()
            for y in (low[1] + shares * edges[1]).tolist()
            for radius in np.geomspace(*_radii(readings), _RADII + 2)[1:-1].tolist()
        ]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the place by the pressed surface, the radius by the presses' distances."""
        height, *places, radius = self.parameters
        low, edges = surface(readings)[0], _edges(readings)
        if min(edges) <= 0:
            return self.parameters
        narrowest, widest = _radii(readings)
        return (
            height,
            *(
                replace(p, lower=start, upper=start + edge, typical=edge / 5)
                for p, start, edge in zip(places, low.tolist(), edges.tolist(), strict=True)
            ),
            replace(radius, lower=narrowest, upper=widest, typical=float(max(edges)) / 3),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say where the bump is, how high and how wide."""
        x, y, height = 1e3 * values["x_m"], 1e3 * values["y_m"], values["height_m"]
        return (
            f"Displacements are off by {length(height)} around x = {x:.0f} mm, y = {y:.0f} mm, and "
            f"by less up to {length(values['radius_m'])} from there, at every force: the surface "
            f"has a {'dent' if height > 0 else 'hill'} there."
        )


def _edges(readings: Readings) -> np.ndarray:
    """Edges (2,) of the pressed surface, m."""
    low, high = surface(readings)
    return high - low


def _radii(readings: Readings) -> tuple[float, float]:
    """Radii of the narrowest and the widest bump, m."""
    edges = _edges(readings)
    narrowest = _LEAST_SPACINGS * float(np.sqrt(np.prod(edges) / readings.presses))
    return narrowest, max(float(max(edges)), 1.5 * narrowest)
