"""Discretization error of the finite elements and its effect on an estimate.

A fit with a correction towards a finer model keeps that model's error. The estimate of this error
is the step of an extrapolation from both meshes, or for an extrapolated model its own estimate
(`fem.palpation.richardson`). It enters the covariance twice: as one error common to all presses,
and as one for each press alone.
"""

from typing import NamedTuple

import numpy as np

from fem import PalpationModel, RefinedModel
from fem.linear import POINTWISE
from fem.palpation import Response, by_contact_radius, remaining_error, shape_gain
from identify.body.compliance import ModulusField, positive_modulus
from identify.body.linear_ratio import LinearRatio
from identify.body.ratio_trend import RatioTrend
from identify.body.settings import BODY, BodySettings
from identify.body.state import ChangedMap

FineModel = PalpationModel | RefinedModel
MODEL_ERROR = "mesh_error"  # the effect by which this error becomes an unknown of a joint fit


class TipPressure(NamedTuple):
    """Traits of a solution that set the pressure under the tips.

    Attributes
    ----------
    gain : (j,) relative reduction of the compliance by the pressure of a rigid, upright flat tip
        (`fem.palpation.rigid_punch`); 0 for other contacts
    growth : (j,) change of ln C by that of ln a of a ball's contact; None for other contacts, and
        where it is not known
    """

    gain: np.ndarray | float = 0.0
    growth: np.ndarray | None = None


ASSUMED = TipPressure()
"""Before any solution: the half-space's pressure."""


def tip_pressure(response: Response, changed: ChangedMap) -> TipPressure:
    """Return the traits of a solution that set the pressure under its tips."""
    contacts = response.model.contacts
    if contacts.profile == "hertz":
        return TipPressure(growth=by_contact_radius(response) / response.compliance)
    if contacts.profile != "flat":
        return ASSUMED
    return TipPressure(
        shape_gain(response, changed.modulus(contacts.points_m)) / response.compliance
    )


class FineSolution(NamedTuple):
    """Compliance (j,) m/N of the finer model, its own relative error (j,), signed, and its fields.

    Of a model that extrapolates, `response` is the finer mesh's own.
    """

    compliance: np.ndarray
    error: np.ndarray
    response: Response


class CarriedFine(NamedTuple):
    """The finer mesh's solution for one map, to be carried to maps nearby.

    Attributes
    ----------
    ratio : its compliances over the coarse model's
    unevenness : (j,) of its modulus, see `fem.palpation.Response.unevenness`
    tip, trend : see `identify.body.correction.Correction`
    """

    ratio: LinearRatio
    unevenness: np.ndarray
    tip: TipPressure
    trend: RatioTrend

    def at(
        self,
        fine: FineModel,
        there: ChangedMap,
        coarse: PalpationModel,
        coarse_compliance: np.ndarray,
        slack: float,
        settings: BodySettings = BODY,
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the finer model's compliance (j,) m/N and error (j,), as `fine_solution` does.

        None where the compliance might be off by more than `slack` times `ratio_error`. Unevenness
        and tip are those of the map that is carried: they change by a tenth where the
        compliance is sure.
        """
        tolerance = slack * settings.ratio_error / settings.fine_bend
        log_ratio = self.ratio.log_at(there, coarse_compliance, tolerance)
        if log_ratio is None:
            return None
        own = coarse_compliance * np.exp(log_ratio)
        if isinstance(fine, RefinedModel):
            compliance, added = fine.extrapolated(coarse_compliance, own)
            return compliance, remaining_error(added, self.unevenness)
        return own, _mesh_error(fine, coarse, own / coarse_compliance, settings)

    def estimated(
        self, fine: FineModel, there: ChangedMap, coarse_compliance: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Finer model's compliance (j,) m/N as far as it is linear, and the scale of its error."""
        log_ratio, error = self.ratio.estimated(there, coarse_compliance)
        own = coarse_compliance * np.exp(log_ratio)
        if isinstance(fine, RefinedModel):
            own = fine.extrapolated(coarse_compliance, own)[0]
        return own, error


class SupportError(NamedTuple):
    """Error of the coarse model that a support's giving way brings, beside that of a firm one.

    Attributes
    ----------
    base : compliance of the support, m/Pa, across and along
    effect : (j,) its effect on ln C on the coarse mesh
    log_ratio : (j,) of the finer compliance over the coarse one, beyond that on the firm support
    """

    base: np.ndarray
    effect: np.ndarray
    log_ratio: np.ndarray

    def serves(self, base: np.ndarray, near: float) -> bool:
        """Return whether no compliance of another support differs by more than the factor."""
        low, high = np.minimum(self.base, base), np.maximum(self.base, base)
        return bool((high <= near * low).all())

    def of(self, effect: np.ndarray) -> np.ndarray:
        """Return the logarithm (j,) of the ratio, in proportion to a support's effect on ln C."""
        return self.log_ratio * (effect @ self.effect) / max(self.effect @ self.effect, 1e-300)


def fine_solution(
    fine: FineModel,
    stiffness: ModulusField,
    coarse: PalpationModel,
    coarse_compliance: np.ndarray,
    settings: BodySettings = BODY,
    base: tuple[float, float] | None = None,
) -> FineSolution:
    """Evaluate the finer model for a map; `coarse_compliance` (j,) is the coarse one's.

    Both are on a support that gives way by `base` (m/Pa, across and along) more than its own.

    The finer meshes see the map of a soft inclusion at points where it may be softer than anywhere
    on the coarse one, or not positive at all. There the least modulus on the coarse mesh stands.
    """
    least = positive_modulus(stiffness, coarse.points_m).min()
    modulus = np.maximum(stiffness.modulus(fine.points_m), least)
    if isinstance(fine, RefinedModel):
        known = coarse_compliance if fine.coarse is coarse else None
        response = fine.evaluate(modulus, base, coarse_compliance=known)
        return FineSolution(response.compliance, response.error, response.fine)
    response = fine.evaluate(modulus, base)
    compliance = response.compliance
    error = _mesh_error(fine, coarse, compliance / coarse_compliance, settings)
    return FineSolution(compliance, error, response)


def _mesh_error(
    fine: PalpationModel, coarse: PalpationModel, ratio: np.ndarray, settings: BodySettings
) -> np.ndarray:
    """Relative error (j,) of the finer of two meshes that are not extrapolated."""
    # Cells of order p resolve like p^3 linear ones.
    cells = [len(m.mesh.cells) * m.mesh.order**3 for m in (coarse, fine)]
    gain = max((cells[1] / cells[0]) ** (settings.mesh_rate / 3) - 1, 0.5)
    contacts = fine.contacts
    common = settings.curved_contact_error[contacts.profile == "hertz"]
    return (ratio - 1) / gain + common * (contacts.curvature_per_m != 0)


def mesh_error_growth(
    poisson_ratio: float, known_at: float, settings: BodySettings = BODY
) -> float:
    """Logarithm of the finer compliance over the coarse one, relative to that at a known ratio.

    The error of quadratic cells grows like b - ln(1 - 2 nu), with the same pattern over the
    presses. Measured on blocks of 8 x 8 x 4 against the extrapolated pair
    (`fem.palpation.richardson`), tips of 3, 5 and 10 mm, Poisson's ratio 0.2 to 0.49: from 0.49 to
    0.46 the compliance ratio changes by 0.39 % (root mean square; 0.5 % under wide tips), with
    0.03 % beyond the law. Beyond 0.49, where cells keep only their mean volume
    (`fem.linear.assembly.split_lame`), it is taken as at 0.49.

    >>> round(mesh_error_growth(0.45, known_at=0.49), 2)
    0.6
    """
    here, there = (
        settings.error_at_zero - np.log(1 - 2 * np.clip(nu, 0, POINTWISE))
        for nu in (poisson_ratio, known_at)
    )
    return float(here / there)


def shift_covariance(covariance: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of an estimate by errors of the model.

    `covariance` (k, k) is that from the noise, `pull` (j, k) the change of the gradient of half of
    chi-square by one standard deviation of each press's error, both by the same unknowns.
    """
    shifts = covariance @ pull.T
    common = shifts.sum(axis=1)
    return np.outer(common, common) + shifts @ shifts.T
