"""How the finer model's compliance over the coarse one's follows the map.

With the ratio held at that of one map, a search under it ends where the coarse model has its
minimum, which along a bent valley may be far away: of a soft inclusion whose depth is hardly seen
it makes a hard grain, which the coarse mesh does not resolve. With its first derivative the
search sees the finer model's own slope.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fem.palpation import Response
from identify.body.state import ChangedMap
from identify.map.gaussian_map import GaussianMap

_MOST = 0.03  # change of the logarithm of a ratio that is believed; beyond, it levels off
_LEAST = 1e-3  # of the modulus in an inclusion's middle, over that of the background


class RatioTrend(NamedTuple):
    """Change of the ratio's logarithm along a map's traits, about linear.

    The traits of a map are the logarithms of the background, of the modulus in the middle of each
    inclusion over it and of the radii, and the places.

    Attributes
    ----------
    traits : (k,) where the ratio is known
    slope : (j, k) derivative of its logarithm by them
    """

    traits: np.ndarray
    slope: np.ndarray

    @classmethod
    def of(
        cls, coarse: Response, other: Response, compliance: np.ndarray, share: float, at: ChangedMap
    ) -> RatioTrend:
        """Return the trend around a map.

        Parameters
        ----------
        coarse, other : solutions of both meshes for it
        compliance : (j,) of the finer model, `other`'s and by `share` its change from the coarse
            one's (an extrapolation)
        """
        by_coarse, by_other = (r.gradient(at.gradient(r.model.points_m)) for r in (coarse, other))
        by_fine = by_other + share * (by_other - by_coarse)
        by_map = by_fine / compliance[:, None] - by_coarse / coarse.compliance[:, None]
        return cls(_traits(at.stiffness), by_map @ np.linalg.inv(_by_map(at.stiffness)))

    def follows(self, stiffness: Any) -> bool:
        """Return whether the map has these traits: as many inclusions, and no free field."""
        return isinstance(stiffness, GaussianMap) and len(stiffness.values) == len(self.traits)

    def around(self, stiffness: GaussianMap) -> RatioTrend:
        """Return the trend where the ratio of another map is known."""
        return self._replace(traits=_traits(stiffness))

    def log_change(self, stiffness: GaussianMap) -> np.ndarray:
        """Change (j,) of the logarithm to a map."""
        return _MOST * np.tanh(self._linear(stiffness) / _MOST)

    def by_map(self, stiffness: GaussianMap) -> np.ndarray:
        """Return the derivative (j, k) of the logarithm by the map's parameters."""
        levels = 1 - np.tanh(self._linear(stiffness) / _MOST) ** 2
        return levels[:, None] * (self.slope @ _by_map(stiffness))

    def _linear(self, stiffness: GaussianMap) -> np.ndarray:
        return self.slope @ (_traits(stiffness) - self.traits)


def _traits(stiffness: GaussianMap) -> np.ndarray:
    """Traits (k,) of a map, in the order of its parameters."""
    background, traits = stiffness.background_pa, stiffness.values.copy()
    traits[0] = np.log(background)
    traits[1::5] = np.log(np.maximum(1 + traits[1::5] / background, _LEAST))
    traits[5::5] = np.log(traits[5::5])
    return traits


def _by_map(stiffness: GaussianMap) -> np.ndarray:
    """Return the derivative (k, k) of the traits by the map's parameters."""
    values = stiffness.values
    background, weights, radii = values[0], values[1::5], values[5::5]
    diagonal = np.ones(len(values))
    diagonal[0] = 1 / background
    middle = np.maximum(background + weights, _LEAST * background)
    diagonal[1::5], diagonal[5::5] = 1 / middle, 1 / radii
    by_map = np.diag(diagonal)
    by_map[1::5, 0] = -weights / background / middle
    return by_map
