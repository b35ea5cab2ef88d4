"""The free map: the logarithm of Young's modulus on a grid, of any shape."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from identify.map.gaussian_map import GAUSSIAN, GaussianMap, Shape
from identify.map.grid import Grid
from models import points_of

_NEAREST = 4  # presses around a place


class FreeMap(GaussianMap):
    """A map whose background varies from place to place, without inclusions.

    The modulus is positive everywhere by its logarithm. The field is its own record: no parameter
    has a name. Two free maps are equal only if they are one object.

    Attributes
    ----------
    grid : points of the field
    log_pa : (g,) natural logarithm of the modulus in Pa there, interpolated in between
    background_pa : median over the grid
    """

    grid: Grid
    log_pa: np.ndarray

    def __init__(self, grid: Grid, log_pa: np.ndarray) -> None:
        field = np.array(log_pa, dtype=float)
        field.setflags(write=False)
        super().__init__(float(np.exp(np.median(field))))
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "log_pa", field)

    @classmethod
    def below_presses(cls, grid: Grid, points_m: np.ndarray, modulus_pa: np.ndarray) -> FreeMap:
        """Return the map that is at each place as hard as the nearest presses find the body.

        Parameters
        ----------
        points_m : (j, 3) contact points, m
        modulus_pa : (j,) apparent Young's modulus there, Pa
        """
        nearest = min(_NEAREST, len(points_m))
        found = KDTree(points_m).query(grid.points_m, k=nearest)
        apart, press = (one.reshape(len(grid), nearest) for one in found)
        weight = 1 / (apart**2 + max(grid.spacing_m) ** 2)
        return cls(grid, np.average(np.log(modulus_pa)[press], axis=1, weights=weight))

    def __eq__(self, other: object) -> bool:
        return self is other

    __hash__ = object.__hash__

    @property
    def names(self) -> tuple[str, ...]:
        """No names."""
        return ()

    @property
    def values(self) -> np.ndarray:
        """No parameters, (0,)."""
        return np.array([self.background_pa][:0])

    def modulus(self, points: np.ndarray, shape: Shape = GAUSSIAN) -> np.ndarray:
        """Young's modulus (p,) in Pa at points (p, 3) in m; the shape of inclusions is no part."""
        return np.exp(self.grid.weights(points_of(points)) @ self.log_pa)

    def gradient(self, points: np.ndarray, shape: Shape = GAUSSIAN) -> np.ndarray:
        """Return the derivative by named parameters, of which there are none, (p, 0)."""
        return np.zeros((len(points), 0))
