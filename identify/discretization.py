"""What the finite elements' own error does to an estimate.

A fit that is corrected towards a finer model keeps that model's error. It is put at what an
extrapolation from both meshes would add, and for a model that is extrapolated already at what it
says itself, see `fem.refined`. It enters the covariance twice:
as one error that all presses share, and as one that is each press's own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fem import PalpationModel, RefinedModel
from fem.response import Response
from identify.forward import ModulusField, positive_modulus

FineModel = PalpationModel | RefinedModel
_RATE = 2.5  # of meshes that are not extrapolated, presses away from edges and steep inclusions


class FineSolution(NamedTuple):
    """Compliance (j,) m/N of the finer model, its own relative error (j,), signed, and its fields.

    Of a model that extrapolates, `response` is the finer mesh's own.
    """

    compliance: np.ndarray
    error: np.ndarray
    response: Response


def fine_solution(
    fine: FineModel, stiffness: ModulusField, coarse: PalpationModel, coarse_compliance: np.ndarray
) -> FineSolution:
    """Evaluate the finer model for a map; `coarse_compliance` (j,) is the coarse one's."""
    modulus = positive_modulus(stiffness, fine.points_m)
    if isinstance(fine, RefinedModel):
        known = coarse_compliance if fine.coarse is coarse else None
        response = fine.evaluate(modulus, coarse_compliance=known)
        return FineSolution(response.compliance, response.error, response.fine)
    response = fine.evaluate(modulus)
    compliance = response.compliance
    # Cells of order p resolve like p^3 linear ones.
    cells = [len(m.mesh.cells) * m.mesh.order**3 for m in (coarse, fine)]
    gain = max((cells[1] / cells[0]) ** (_RATE / 3) - 1, 0.5)
    return FineSolution(compliance, (compliance / coarse_compliance - 1) / gain, response)


def shift_covariance(covariance: np.ndarray, jac: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Covariance (k, k) that errors of the model add to an estimate.

    `covariance` (k, k) and `jac` (j, 2, k) are those of the whitened residuals, `shift` (j, 2) is
    the change of these by one standard deviation of each press's error.
    """
    own = -np.einsum("kl,jrl,jr->kj", covariance, jac, shift)
    common = own.sum(axis=1)
    return np.outer(common, common) + own @ own.T
