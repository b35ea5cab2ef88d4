"""Two meshes of one body, extrapolated to the limit of vanishing cell size.

With the near field of each press in the space (`fem.near_field.enrichment`), the remaining error
falls like some power p of the cell size, so that two meshes give the limit

    C = C_fine + (C_fine - C_coarse)/((h_coarse/h_fine)^p - 1).

The power is not the same everywhere. Measured on 8 x 8 x 4 and 12 x 12 x 6 cells of 96 x 96 x 48 mm
it is 2.5 for tips of 5 mm 7 mm away from the edges or over mild inclusions; 1.4 to 2.1 where the
rim is 2 mm from an edge, which only the cells' own functions represent; and 1.1 to 1.7 over an
inclusion of 8 mm radius, six times as stiff and 12 mm deep (whose gradient probably bends the near
field otherwise than x, y and z times it do). With p = 1.75 no press of either kind is more than 1 %
off. The added part is then too large for the first kind and too small for the last: half of it is
the scale of the error. By accident it can be zero: small tips over steep inclusions feel the course
of the modulus between its samples, and the meshes may agree though both are wrong. The scale is
therefore at least a part of `fem.palpation.response.Response.unevenness`, and 0.1 % for the
quadrature.
`benchmarks/validate.py` counts how often twice the scale holds the true error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.contact.contacts import Contacts
from fem.errors import MeshError
from fem.palpation.fibres import Fibres, checked_fibres
from fem.palpation.model import PalpationModel, Response
from fem.palpation.skin import Skin

RATE = 1.75
LEFT = 0.5  # error as a part of the extrapolation's change ...
BETWEEN = 0.2  # ... at least this part of `unevenness` ...
LEAST = 1e-3  # ... and at least this


@dataclass(frozen=True)
class RefinedResponse:
    """Extrapolated compliance of every press.

    Attributes
    ----------
    compliance : (j,) m/N
    extrapolated : (j,) relative part that the extrapolation added to the finer mesh's
    fine : the finer mesh's own response, with its displacement fields
    """

    compliance: np.ndarray
    extrapolated: np.ndarray
    fine: Response

    @property
    def error(self) -> np.ndarray:
        """Scale of the remaining relative error, (j,), with the sign of the added part."""
        return remaining_error(self.extrapolated, self.fine.unevenness)


def remaining_error(extrapolated: np.ndarray, unevenness: np.ndarray) -> np.ndarray:
    """Return `RefinedResponse.error` (j,) from the added part and the finer mesh's unevenness."""
    scale = np.maximum(np.maximum(LEFT * np.abs(extrapolated), BETWEEN * unevenness), LEAST)
    return np.copysign(scale, extrapolated)


@dataclass(frozen=True)
class RefinedModel:
    """The same presses on two meshes of the same body, the second finer.

    Evaluated like a `PalpationModel`: for the modulus at `points_m` (p, 3).
    """

    coarse: PalpationModel
    fine: PalpationModel

    def __post_init__(self) -> None:
        if not self.coarse.contacts.same_presses(self.fine.contacts) or self._ratio <= 1.05:
            raise MeshError("extrapolation needs the same presses on two meshes, the second finer")

    @property
    def _ratio(self) -> float:
        """Ratio of the cell sizes."""
        return (len(self.fine.mesh.cells) / len(self.coarse.mesh.cells)) ** (1 / 3)

    @property
    def contacts(self) -> Contacts:
        """The presses."""
        return self.fine.contacts

    @property
    def points_m(self) -> np.ndarray:
        """Sample points of the modulus: the coarse mesh's points, then the fine one's."""
        return np.vstack([self.coarse.points_m, self.fine.points_m])

    def evaluate(
        self,
        modulus_pa: np.ndarray | float,
        support_compliance: tuple[float, float] | None = None,
        fibres: Fibres | tuple | None = None,
        skin: Skin | tuple | None = None,
        coarse_compliance: np.ndarray | None = None,
    ) -> RefinedResponse:
        """Solve on both meshes and extrapolate; see `PalpationModel.evaluate`.

        `coarse_compliance` (j,) is that of the coarse mesh, where it is known already.
        """
        modulus = np.broadcast_to(np.asarray(modulus_pa, float), len(self.points_m))
        split = len(self.coarse.points_m)
        parts: list[Fibres | None] = [None, None]
        if fibres is not None:
            direction, strength = checked_fibres(fibres, len(modulus))
            strength = np.asarray(strength)
            parts = [Fibres(direction, strength[:split]), Fibres(direction, strength[split:])]
        rest = (support_compliance, parts[0], skin), (support_compliance, parts[1], skin)
        coarse = coarse_compliance
        if coarse is None:
            coarse = self.coarse.evaluate(modulus[:split], *rest[0]).compliance
        response = self.fine.evaluate(modulus[split:], *rest[1])
        return RefinedResponse(*self.extrapolated(coarse, response.compliance), response)

    @property
    def added_share(self) -> float:
        """Step of the extrapolation over that from the coarse to the fine mesh."""
        return 1 / (self._ratio**RATE - 1)

    def extrapolated(self, coarse: np.ndarray, fine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the limit of the meshes' compliances (j,), and the added part over the finer's."""
        added = self.added_share * (fine - coarse)
        return fine + added, added / fine
