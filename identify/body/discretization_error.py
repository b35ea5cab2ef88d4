"""What the finite elements' own error does to an estimate.

A fit that is corrected towards a finer model keeps that model's error. It is put at what an
extrapolation from both meshes would add, and for a model that is extrapolated already at what it
says itself, see `fem.palpation.richardson`. It enters the covariance twice:
as one error that all presses share, and as one that is each press's own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fem import PalpationModel, RefinedModel
from fem.linear.assembly import POINTWISE
from fem.palpation.response import Response
from identify.body.compliance import ModulusField, positive_modulus

FineModel = PalpationModel | RefinedModel
MODEL_ERROR = "mesh_error"  # the effect by which this error becomes an unknown of a joint fit
_RATE = 2.5  # of meshes that are not extrapolated, presses away from edges and steep inclusions
_AT_ZERO = 0.12  # of `mesh_error_growth`


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
    """Evaluate the finer model for a map; `coarse_compliance` (j,) is the coarse one's.

    The finer meshes see the map of a soft inclusion at points where it may be softer than anywhere
    on the coarse one, or not positive at all. There the least modulus on the coarse mesh stands.
    """
    least = positive_modulus(stiffness, coarse.points_m).min()
    modulus = np.maximum(stiffness.modulus(fine.points_m), least)
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


def mesh_error_growth(poisson_ratio: float, known_at: float) -> float:
    """Logarithm of the finer compliance over the coarse one, relative to that at a known ratio.

    The error of quadratic cells grows like b - ln(1 - 2 nu), with the same pattern over the
    presses. Measured on blocks of 8 x 8 x 4 against the extrapolated pair
    (`fem.palpation.richardson`), tips of 3, 5 and 10 mm, Poisson's ratio 0.2 to 0.49: from 0.49 to
    0.46 the compliance ratio changes by 0.39 % (root mean square; 0.5 % under wide tips), of which
    the law leaves 0.03 %. Beyond 0.49, where cells keep only their mean volume
    (`fem.linear.assembly.split_lame`), it is taken as at 0.49.

    >>> round(mesh_error_growth(0.45, known_at=0.49), 2)
    0.6
    """
    here, there = (
        _AT_ZERO - np.log(1 - 2 * np.clip(nu, 0, POINTWISE)) for nu in (poisson_ratio, known_at)
    )
    return float(here / there)


def shift_covariance(covariance: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Covariance (k, k) that errors of the model add to an estimate.

    `covariance` (k, k) is that from the noise, `pull` (j, k) what one standard deviation of each
    press's error does to the gradient of half of chi-square, both by the same unknowns.
    """
    own = covariance @ pull.T
    common = own.sum(axis=1)
    return np.outer(common, common) + own @ own.T
