"""Prediction of a scan that the fit has not seen, with bands, and whether these are calibrated.

The fitted map, with the fitted effects at their estimates, is pressed as the other scan was. The
band of a reading holds the noise of both its columns; the covariance of the map (parameters, or the
field's posterior) and of the effects, jointly; the map's own error of each press, which holds that
of the meshes; and the error of the laws at depths that the fit has not seen (`law_error`).

Where a fitted press stood at the same place, what its readings ask for beside the map is known, and
belongs to the prediction; elsewhere the map's own error is part of the band.

Readings of a press share most of their error. The test therefore takes one number a press, the
error of the travel at its largest forces, with the covariance of all presses. Its chi-square, with
as many degrees of freedom as presses, says whether the errors are those of the bands; beside it the
press farthest off is judged alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtr, chdtrc, ndtr

from fem import PalpationModel
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.experiment import Experiment
from identify.fit.free_compliance_start import free_compliance
from identify.fit.free_map.field_data import FieldData, PressSums
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.result import FitResult
from identify.map import FreeMap, GaussianMap
from identify.map.initial_guess import REFERENCE_PA
from identify.map.parameters import ParameterSpace, parameter_space
from identify.measurement.chain import judge
from identify.measurement.linearised import Linearised
from identify.measurement.model import EffectInModel, MeasurementModel
from identify.measurement.noise import Noise
from models import Catalogue, InputError, Scan

LEVEL = 0.01  # of the test
LEAST_REACH, DEEP = 0.35, 0.8  # shares of a press's depth, for the error of the laws
UNEVEN = 0.5  # part of a common error of the laws that may differ from press to press
SAME_PLACE, SAME_DIRECTION = 0.2, 0.97  # tip radii; cosine: a press at the same place
ROUNDS, LONGEST = 4, 0.5  # of the search for each press's own ln C, and its longest step
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
        """Whether the errors are those of the bands, at the level `LEVEL` on both sides."""
        if self.p_too_narrow < LEVEL:
            return "too narrow"
        return "too wide" if chdtr(self.presses, self.chi2) < LEVEL else "calibrated"

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
    experiment: Experiment, fit: FitResult, catalogue: Catalogue[Effect], scan: Scan, noise: Noise
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
    used = scan.used()
    depth_m = _depth_m(experiment.scan.used())
    body = experiment.body.under(used, depth_m)
    readings = Readings.of(scan)
    alone = replace(noise, touch_m=0.0)
    model = replace(
        seen,
        readings=readings,
        displacement_m=used.displacement_m,
        noise=alone,
        mechanics=BodyMechanics.of(body.coarse, body.fine),
        press_error=0.0,
        unit_compliance=_unit_compliance(body.coarse, fit),
    ).corrected(u)
    free = isinstance(fit.map, FreeMap)
    assert fit.field is not None or not free
    own_error = fit.field.hyper.error if fit.field is not None else map_error(seen, there)
    own = _own_errors(seen, there, u, own_error)
    shared = _shared_places(experiment.scan.used(), used)
    at = model.linearise(u)
    at = model.around(at.body, u, np.exp(shared @ own.change))
    press = readings.press
    of_press = model.by_log_compliance(at)
    by_unknown = at.jacobian * at.sigma_m[:, None]
    known = shared.sum(axis=1) > 0
    if free:
        joint = _free_covariance(own.sums, there, fit, at, shared)
        by_press = np.zeros((len(press), readings.presses))
        by_press[np.arange(len(press)), press] = of_press
        columns = np.hstack([by_press, by_unknown])
        rest = np.where(known, 0.0, own_error**2)
    else:
        joint, columns = fit.covariance, by_unknown / model.unknowns.slope(u)
        joint, columns = _matched(joint, columns, fit.covariance_names, model.names)
        # A press that was seen at its place follows its readings, by its gain, and not the map
        gain = own_error**2 / (own_error**2 + own.variance)
        columns = columns * (1 - shared @ gain)[press, None]
        rest = np.where(known, shared @ (gain * own.variance), own_error**2)
    of_map = np.einsum("mk,kl,ml->m", columns, joint, columns)
    of_error = rest[press] * of_press**2 + noise.touch_m**2
    laws = law_error(experiment, seen, there, min(depth_m / _depth_m(used), 1.0))
    of_laws = (laws.common**2 + laws.own**2) * used.displacement_m**2
    total = at.sigma_m**2 + of_map + of_error + of_laws
    near = used.near_largest_force
    error = _means(used.displacement_m - at.predicted_m, near, press)
    middle = _means(columns, near, press)
    count = np.bincount(press, near)
    travel = _means(used.displacement_m, near, press)
    own = _means(of_error, near, press) + _means(at.sigma_m**2, near, press) / count
    own += (laws.own * travel) ** 2
    covariance = middle @ joint @ middle.T + laws.common**2 * np.outer(travel, travel)
    covariance[np.diag_indices_from(covariance)] += own
    return Prediction(
        scan=used,
        predicted_m=at.predicted_m,
        sd_m=np.sqrt(total),
        error_n=(used.displacement_m - at.predicted_m) / _slope(model, at),
        parts_m={
            "noise": at.sigma_m,
            "map and effects": np.sqrt(of_map),
            "own error of the map": np.sqrt(of_error),
            "laws": np.sqrt(of_laws),
        },
        press_error_m=error,
        press_sd_m=np.sqrt(np.diag(covariance)),
        chi2=float(error @ cho_solve(cho_factor(covariance), error)),
    )


def fitted_model(
    experiment: Experiment, fit: FitResult, catalogue: Catalogue[Effect]
) -> MeasurementModel:
    """Return the model of a fit, also of one that was read from a file, at its estimate.

    Raises
    ------
    InputError
        An effect that is in no catalogue.
    """
    readings, body = Readings.of(experiment.scan), experiment.body
    mechanics = BodyMechanics.of(body.coarse, body.fine)
    free = [name for name, estimate in fit.parameters.items() if estimate.free]
    if isinstance(fit.map, FreeMap):
        space = ParameterSpace(fit.map, (), ())
    else:
        names = [name for name in free if name in fit.map.names]
        space = parameter_space(fit.map, body.coarse.mesh.box_m, names)
    values: dict[str, dict[str, float]] = {}
    for name, estimate in fit.parameters.items():
        effect, _, parameter = name.partition(".")
        if parameter and name not in fit.map.names:
            values.setdefault(effect, {})[parameter] = estimate.value
    known = {effect.name for effect in catalogue}
    unknown = [name for name in values if name not in known]
    if unknown:
        raise InputError(
            f"the fit has the effect '{unknown[0]}', which is not in the catalogue; give the file "
            "that it came from in the study"
        )
    state = mechanics.state().changed(background_pa=fit.map.background_pa)
    parts = tuple(
        EffectInModel(catalogue[name], catalogue[name].bounded(readings, state), given)
        for name, given in values.items()
    )
    model = MeasurementModel(
        readings, experiment.scan.used().displacement_m, replace(fit.noise, touch_m=0.0),
        mechanics, space, parts, unit_compliance=_unit_compliance(body.coarse, fit),
    )  # fmt: skip
    return model.corrected(model.start(fit.map))


def _unit_compliance(model: PalpationModel, fit: FitResult) -> np.ndarray | None:
    """Compliance (j,) of a body of 1 Pa, from which a free map's modulus under a tip follows."""
    if not isinstance(fit.map, FreeMap):
        return None
    return REFERENCE_PA * compliance(model, GaussianMap(REFERENCE_PA))


def map_error(model: MeasurementModel, at: Linearised) -> float:
    """Relative error of a map in a press's compliance beyond what the noise explains.

    The best change of ln C of each press alone, robustly, less its own variance and that of the
    unknowns that followed it.
    """
    press, presses = model.readings.press, model.readings.presses
    own = model.by_log_compliance(at) / at.sigma_m
    square = np.maximum(np.bincount(press, own**2, presses), 1e-30)
    change = np.bincount(press, own * at.residual, presses) / square
    freedom = max(1 - at.jacobian.shape[1] / presses, 1 / presses)
    variance = (1.4826 * np.median(np.abs(change))) ** 2 / freedom
    return float(np.sqrt(max(variance - np.median(1 / square), 0.0)))


class LawError(NamedTuple):
    """Error of the laws as shares of the travel: common to all presses, and of each alone."""

    common: float
    own: float


def law_error(
    experiment: Experiment, model: MeasurementModel, at: Linearised, reach: float
) -> LawError:
    """Error that the laws of a fit make at depths that it has not seen.

    Measured on the fit's own scan: laws and each press's compliance follow the readings up to a
    share `reach` of the press's depth, without a map (`identify.fit.free_compliance`), and predict
    the deepest of them. With a reach of 1 it is the error of the curves' shape itself.

    Parameters
    ----------
    reach : depth of the fit's presses over that of the predicted ones, at most 1
    """
    press, presses = model.readings.press, model.readings.presses
    travel, own = model.displacement_m, model.by_log_compliance(at) / at.sigma_m
    deepest = np.zeros(presses)
    np.maximum.at(deepest, press, travel)
    shallow = travel <= max(reach, LEAST_REACH) * deepest[press]
    deep = travel >= (reach if reach < 1 else DEEP) * deepest[press]
    square = np.bincount(press, shallow * own**2, presses)
    known = square > 0
    weight = shallow * own / np.where(known, square, np.inf)[press]
    change = np.bincount(press, weight * at.residual, presses)
    left = (at.residual - own * change[press]) * at.sigma_m
    if reach < 1 and known.all():
        left = _beyond(experiment, model, shallow)
    count = np.maximum(np.bincount(press, deep, presses), 1)
    mean = np.bincount(press, deep * left, presses) / count
    pull = np.bincount(press, deep * own * at.sigma_m, presses) / count
    # Noise of the deep readings, and of the compliance that the shallow ones give
    noise = np.bincount(press, deep * at.sigma_m**2, presses) / count**2
    noise += pull**2 / np.where(known, square, np.inf)
    share, noise = (mean / deepest)[known], float(np.median((noise / deepest**2)[known]))
    common, many = float(np.median(share)), max(int(known.sum()), 1)
    spread = (1.4826 * np.median(np.abs(share - common))) ** 2
    # What noise makes is none: two standard deviations of the median, and of the squared spread
    common = 0.0 if common**2 < 4 * np.pi / 2 * noise / many else abs(common)
    excess = 0.0 if spread - noise < 2 * 1.65 * np.sqrt(2 / many) * noise else spread - noise
    # The predicted presses are deeper than these by 1/reach, and a law's error grows with depth
    return LawError(common / reach, float(np.hypot(np.sqrt(excess), UNEVEN * common)) / reach)


def _beyond(experiment: Experiment, model: MeasurementModel, shallow: np.ndarray) -> np.ndarray:
    """Residual (m,) m of laws and compliances that follow the shallow (m,) readings alone."""
    whole = free_compliance(experiment.scan, experiment.body, model.noise)
    part = replace(
        whole,
        readings=Readings.of(experiment.scan.used().rows(shallow)),
        displacement_m=whole.displacement_m[shallow],
    )
    found = part.fit([p for p in model.effects if part.shows(p.effect)])
    chain = whole.chain([p.effect for p in found.parts])
    c = found.compliance
    e = whole.unit_compliance / c
    return judge(chain, c, e, whole.displacement_m, model.noise, found.values).residual_m


def _depth_m(scan: Scan) -> float:
    """Largest travel of the middle press, m."""
    deepest = np.zeros(len(scan.press_ids))
    np.maximum.at(deepest, scan.press_index, scan.displacement_m)
    return float(np.median(deepest))


class _OwnErrors(NamedTuple):
    """Error (j,) of ln C that each press of the fit asks for beside the map, and its variance.

    `sums` are those of the readings there.
    """

    change: np.ndarray
    variance: np.ndarray
    sums: PressSums


def _own_errors(
    model: MeasurementModel, there: Linearised, u: np.ndarray, error: float
) -> _OwnErrors:
    change, at = np.zeros(model.readings.presses), there
    for _ in range(ROUNDS):
        found, variance = PressSums.of(model, at).errors(change)
        share = error**2 / (error**2 + variance) if error else np.zeros_like(found)
        step = np.clip(share * found - change, -LONGEST, LONGEST)
        change = change + step
        at = model.around(there.body, u, np.exp(change))
    sums = PressSums.of(model, at)
    return _OwnErrors(change, sums.errors(change)[1], sums)


def _shared_places(fitted: Scan, predicted: Scan) -> np.ndarray:
    """Matrix (n, j) of ones where a predicted press stands where a fitted one stood."""
    apart = np.linalg.norm(predicted.contact_points[:, None] - fitted.contact_points[None], axis=2)
    turned = predicted.contact_directions @ fitted.contact_directions.T
    same = (apart < SAME_PLACE * predicted.contact_radii[:, None]) & (turned > SAME_DIRECTION)
    same &= np.isclose(predicted.contact_radii[:, None], fitted.contact_radii, rtol=1e-3)
    nearest = np.where(same, apart, np.inf).argmin(axis=1)
    found = np.zeros_like(apart)
    each = np.arange(len(apart))
    found[each, nearest] = same[each, nearest]
    return found


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


def _matched(
    covariance: np.ndarray, columns: np.ndarray, names: tuple[str, ...], own: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Bring columns of a model's unknowns into the order of a covariance's names."""
    return covariance, columns[:, [own.index(name) for name in names]]


def _slope(model: MeasurementModel, at: Linearised) -> np.ndarray:
    """Slope (m,) of travel over force, m/N, at least a part of the straight line's to no force."""
    slope = model.chain.by_force(at.compliance, at.modulus, at.latent_force_n, at.values)
    force = np.maximum(np.abs(at.latent_force_n), 1e-9)
    return np.maximum(slope, STEEPEST * np.abs(at.predicted_m) / force)


def _means(values: np.ndarray, rows: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Mean over some rows (m,) bool of each press, (j, ...)."""
    count = np.bincount(press[rows], minlength=int(press.max()) + 1)
    total = np.zeros((len(count), *values.shape[1:]))
    np.add.at(total, press[rows], values[rows])
    return total / count.reshape(-1, *[1] * (values.ndim - 1))
