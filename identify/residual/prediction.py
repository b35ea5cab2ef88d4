"""Prediction of a scan that the fit has not seen, with bands, and whether these are calibrated.

The fitted map, with the fitted effects at their estimates, is pressed as the other scan was. The
band of a reading holds the noise of both its columns; the covariance of the map (parameters, or the
field's posterior) and of the effects, jointly; the map's own error of each press, which holds that
of the meshes; and the error of the laws, above all at depths that the fit has not seen
(`identify.residual.law_error`).

Where a fitted press stood at the same place, what its readings ask for beside the map is known, and
belongs to the prediction; elsewhere the map's own error is part of the band.

Readings of a press share most of their error. The test therefore takes one number a press, the
error of the travel at its largest forces, with the covariance of all presses. Its chi-square, with
as many degrees of freedom as presses, says whether the errors are those of the bands; beside it the
press farthest off is judged alone. An error that all presses share is one number to that test, and
may be nearly the whole band: bands that are `WIDE` times the errors, by their rms over the presses,
are too wide, whatever chi-square says of the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtr, chdtrc, ndtr

from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.fit.free_map.field_data import FieldData, PressSums
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.result import FitResult
from identify.map import FreeMap
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.measurement.places import Places, shared_places
from identify.measurement.shared_error import lag_error_m
from identify.residual.fitted_model import carried_as, fitted_model, unit_compliance
from identify.residual.law_error import laws_off, middle_depth_m
from identify.residual.own_errors import OwnErrors, map_error, own_errors
from models import Catalogue, Scan

LEVEL = 0.01  # of the test
WIDE = 3.0  # of bands over errors: a band of one shared error is so once in four by chance
STEEPEST = 0.2  # least slope of travel over force, of the line to no force: noise makes it less
_WITHIN = 1.96

Verdict = Literal["calibrated", "too narrow", "too wide"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """A scan of m readings in j presses, predicted by a fit to another one.

    Attributes
    ----------
    scan : as placed on the fit's body
    predicted_m : (m,) travel
    sd_m : (m,) standard deviation of measured less predicted travel
    error_n : (m,) measured less predicted travel as a force, over the slope of the press's curve
    parts_m : (m,) of `sd_m` by cause: noise, map and effects, own error of the map, laws
    press_error_m, press_sd_m : (j,) error of the travel at the largest forces, and its band
    chi2 : of these, with their covariance
    """

    scan: Scan
    predicted_m: np.ndarray
    sd_m: np.ndarray
    error_n: np.ndarray
    parts_m: Mapping[str, np.ndarray]
    press_error_m: np.ndarray
    press_sd_m: np.ndarray
    chi2: float

    @property
    def residual_m(self) -> np.ndarray:
        """Measured less predicted travel, (m,)."""
        return self.scan.displacement_m - self.predicted_m

    @property
    def presses(self) -> int:
        """Number of presses."""
        return len(self.press_error_m)

    @property
    def p_too_narrow(self) -> float:
        """Probability of errors this large, were the bands right.

        By chi-square, or by the press farthest off: an error that all presses share is one number
        of many to chi-square. The smaller of the two, times two.
        """
        farthest = float(np.max(np.abs(self.press_error_m) / self.press_sd_m))
        single = self.presses * 2 * float(ndtr(-farthest))
        return min(1.0, 2 * min(float(chdtrc(self.presses, self.chi2)), single))

    @property
    def verdict(self) -> Verdict:
        """Whether the errors are those of the bands, at the level `LEVEL` on both sides.

        Too wide are also bands that are `WIDE` times the errors.
        """
        if self.p_too_narrow < LEVEL:
            return "too narrow"
        if self.band_over_error > WIDE or chdtr(self.presses, self.chi2) < LEVEL:
            return "too wide"
        return "calibrated"

    @property
    def band_over_error(self) -> float:
        """How many times the errors ask for the bands are; about 1 of bands that are right.

        By the rms over the presses, or by chi-square, whichever is more.
        """
        squares = float(np.mean((self.press_error_m / self.press_sd_m) ** 2))
        return max(min(squares, self.chi2 / self.presses), 1e-18) ** -0.5

    @property
    def within95(self) -> float:
        """Share of the presses inside their 95 % band."""
        return float(np.mean(np.abs(self.press_error_m) < _WITHIN * self.press_sd_m))

    @property
    def force_error_share(self) -> np.ndarray:
        """Error (j,) of the force at the largest forces over the press's largest force."""
        near, press = self.scan.near_largest_force, self.scan.press_index
        largest = np.full(self.presses, -np.inf)
        np.maximum.at(largest, press, self.scan.force_n)
        return _means(self.error_n, near, press) / largest


def predict(
    experiment: PlacedExperiment,
    fit: FitResult,
    catalogue: Catalogue[Effect],
    scan: Scan,
    noise: Noise,
) -> Prediction:
    """Predict a scan.

    Parameters
    ----------
    experiment : of the fit, with its body
    fit : to its scan
    catalogue : where the fit's effects are looked up
    scan : to be predicted, placed on the same body
    noise : of that scan

    Raises
    ------
    InputError
        The fit has an effect that is in no catalogue.
    """
    seen = fitted_model(experiment, fit, catalogue)
    u = seen.start(fit.map)
    there = seen.linearise(u)
    used, fitted = scan.used(), experiment.scan.used()
    model = _pressed(experiment, fit, seen, scan, noise)
    error = fit.field.hyper.error if fit.field is not None else map_error(seen, there)
    own = own_errors(seen, there, u, error)
    shared = shared_places(*(
        Places(s.contact_points, s.contact_directions, s.contact_radii) for s in (fitted, used)
    ))  # fmt: skip
    at = model.linearise(u)
    at = model.around(at.body, u, np.exp(shared @ own.change))
    doubt = _doubt(fit, there, own, error, model, at, u, shared)
    press, columns = model.readings.press, doubt.columns
    of_laws = laws_off(experiment, seen, there, catalogue, used, model, at)
    off = doubt.own[press] * model.by_log_compliance(at) ** 2 + noise.touch_m**2
    off += lag_error_m(noise, model.readings, used.displacement_m) ** 2
    variance = {
        "noise": at.sigma_m**2,
        "map and effects": np.einsum("mk,kl,ml->m", columns, doubt.covariance, columns),
        "own error of the map": off,
        "laws": of_laws.own_m**2 + np.sum(of_laws.shared_m**2, axis=1),
    }
    residual_m, near = used.displacement_m - at.predicted_m, used.near_largest_force
    middle, laws = (_means(part, near, press) for part in (columns, of_laws.shared_m))
    covariance = middle @ doubt.covariance @ middle.T + laws @ laws.T
    alone = _means(off, near, press) + _means(of_laws.own_m, near, press) ** 2
    alone += _means(at.sigma_m**2, near, press) / np.bincount(press, near)
    covariance[np.diag_indices_from(covariance)] += alone
    press_error_m = _means(residual_m, near, press)
    return Prediction(
        scan=used,
        predicted_m=at.predicted_m,
        sd_m=np.sqrt(sum(variance.values())),
        error_n=residual_m / _slope(model, at),
        parts_m={name: np.sqrt(part) for name, part in variance.items()},
        press_error_m=press_error_m,
        press_sd_m=np.sqrt(np.diag(covariance)),
        chi2=float(press_error_m @ cho_solve(cho_factor(covariance), press_error_m)),
    )


def _pressed(
    experiment: PlacedExperiment, fit: FitResult, seen: MeasurementModel, scan: Scan, noise: Noise
) -> MeasurementModel:
    """Return the model `seen` of a fit under the presses of another scan."""
    used = scan.used()
    body = experiment.body.under(used, middle_depth_m(experiment.scan.used()))
    other = replace(
        seen,
        readings=replace(Readings.of(scan), stated=seen.readings.scales),
        displacement_m=used.displacement_m,
        noise=noise.of_readings,
        mechanics=BodyMechanics.of(body.coarse, body.fine),
        press_error=0.0,
        unit_compliance=unit_compliance(body.coarse, fit),
    )
    return carried_as(fit, other, seen.start(fit.map))


class _Doubt(NamedTuple):
    """Covariance (k, k) of map and effects, and derivatives (m, k) of the predictions by them.

    `own` (j,) is the variance of each predicted press's ln C beside the map.
    """

    covariance: np.ndarray
    columns: np.ndarray
    own: np.ndarray


def _doubt(
    fit: FitResult,
    there: Linearised,
    own: OwnErrors,
    error: float,
    model: MeasurementModel,
    at: Linearised,
    u: np.ndarray,
    shared: np.ndarray,
) -> _Doubt:
    """Return the uncertainty of a fit, linear `there`, in a prediction, linear `at`."""
    press, known = model.readings.press, shared.sum(axis=1) > 0
    columns = at.jacobian * at.sigma_m[:, None]
    if isinstance(fit.map, FreeMap):
        by_press = np.zeros((len(press), model.readings.presses))
        by_press[np.arange(len(press)), press] = model.by_log_compliance(at)
        covariance = _free_covariance(own.sums, there, fit, at, shared)
        return _Doubt(covariance, np.hstack([by_press, columns]), np.where(known, 0.0, error**2))
    columns = columns / model.unknowns.slope(u)
    columns = columns[:, [model.names.index(name) for name in fit.covariance_names]]
    # A press that was seen at its place follows its readings, by its gain, and not the map
    gain = error**2 / (error**2 + own.variance)
    columns = columns * (1 - shared @ gain)[press, None]
    rest = np.where(known, shared @ (gain * own.variance), error**2)
    return _Doubt(fit.covariance, columns, rest)


def _free_covariance(
    sums: PressSums, there: Linearised, fit: FitResult, at: Linearised, shared: np.ndarray
) -> np.ndarray:
    """Covariance of ln C at the predicted presses and of the effects' scaled parameters."""
    assert isinstance(fit.map, FreeMap)
    assert fit.field is not None
    hyper, field = fit.field.hyper, np.zeros(len(fit.map.log_pa))
    if len(fit.field.errs):
        sums = sums.weighted(np.where(fit.field.errs, 0.0, 1.0))
    data = FieldData.of(sums, there.body.by_field(), field)
    prior = hyper.prior(fit.map.grid)
    return FieldPosterior(data, prior, hyper.error).predicted_covariance(at.body.by_field(), shared)


def _slope(model: MeasurementModel, at: Linearised) -> np.ndarray:
    """Slope (m,) of travel over force, m/N, at least a part of the straight line's to no force."""
    slope = model.chain.by_force(at.point)
    force = np.maximum(np.abs(at.latent_force_n), 1e-9)
    return np.maximum(slope, STEEPEST * np.abs(at.predicted_m) / force)


def _means(values: np.ndarray, rows: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Mean over some rows (m,) bool of each press, (j, ...)."""
    count = np.bincount(press[rows], minlength=int(press.max()) + 1)
    total = np.zeros((len(count), *values.shape[1:]))
    np.add.at(total, press[rows], values[rows])
    return total / count.reshape(-1, *[1] * (values.ndim - 1))
