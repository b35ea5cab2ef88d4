"""Error of the laws of a fit in a prediction, above all at depths that its scan has not reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.fit.free_compliance_start import free_compliance
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.judge import judge
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.residual.law_forms import law_forms
from identify.residual.settings import LAW_ERROR, LawErrorSettings
from models import Scan


class LawError(NamedTuple):
    """Error of the laws as shares of the travel: common to all presses, and of each alone.

    That of one press grows by `by_unevenness` with the unevenness of its place: above and beside
    hard spots the contact grows in its own way.
    """

    common: float
    own: float
    by_unevenness: float

    def of_each(self, unevenness: np.ndarray) -> np.ndarray:
        """Error (j,) of presses alone, of an `unevenness` (j,)."""
        return np.hypot(self.own, self.by_unevenness * unevenness)


class LawsOff(NamedTuple):
    """Errors of the laws in m predicted readings, standard deviations.

    `shared_m` (m, s) by s causes that all presses share, `own_m` (m,) of each press alone.
    """

    shared_m: np.ndarray
    own_m: np.ndarray


def laws_off(
    experiment: PlacedExperiment,
    seen: MeasurementModel,
    there: Linearised,
    catalogue: Sequence[Effect],
    scan: Scan,
    model: MeasurementModel,
    at: Linearised,
    settings: LawErrorSettings = LAW_ERROR,
) -> LawsOff:
    """Return the errors of a fit's laws in a predicted scan.

    Down to the depth of the fit's presses that of the curves' shape. Beyond, the error at the
    greater depth comes in with its logarithm, and so do other laws (`identify.residual.law_forms`).

    Parameters
    ----------
    experiment, seen, there : of the fit
    catalogue : the effects
    scan, model, at : predicted
    """
    press, travel = model.readings.press, model.displacement_m
    (near_m, near_log_c), predicted = (_felt(*one) for one in ((seen, there), (model, at)))
    uneven = unevenness(near_m, near_log_c, near_m, near_log_c, settings)
    there_uneven = unevenness(*predicted, near_m, near_log_c, settings)
    shape = law_error(experiment, seen, there, 1.0, uneven, settings)
    common, own = np.full_like(travel, shape.common), shape.of_each(there_uneven)[press]
    depth_m = middle_depth_m(experiment.scan.used())
    reach = depth_m / middle_depth_m(scan)
    if reach >= 1:
        return LawsOff((common * travel)[:, None], own * travel)
    deeper = law_error(experiment, seen, there, reach, uneven, settings)
    grown = np.minimum(np.log(np.maximum(travel / depth_m, 1.0)) / -np.log(reach), 1.0)
    common = np.maximum(common, grown * deeper.common)
    own = np.maximum(own, grown * deeper.of_each(there_uneven)[press])
    forms = law_forms(experiment, seen, catalogue, model, at)
    return LawsOff(np.column_stack([common * travel, forms]), own * travel)


def middle_depth_m(scan: Scan) -> float:
    """Return the largest travel of the middle press, m."""
    deepest = np.zeros(len(scan.press_ids))
    np.maximum.at(deepest, scan.press_index, scan.displacement_m)
    return float(np.median(deepest))


def _felt(model: MeasurementModel, at: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """Places (j, 3) m of the presses, and logarithm (j,) of what is felt: compliance by radius."""
    contacts = model.mechanics.coarse.contacts
    return contacts.points_m, np.log(at.compliance * contacts.radius_m)


def law_error(
    experiment: PlacedExperiment,
    model: MeasurementModel,
    at: Linearised,
    reach: float,
    uneven: np.ndarray,
    settings: LawErrorSettings = LAW_ERROR,
) -> LawError:
    """Error that the laws of a fit make at depths that it has not seen.

    Measured on the fit's own scan: laws and each press's compliance follow the readings up to a
    share `reach` of the press's depth, without a map (`identify.fit.free_compliance`), and predict
    the deepest of them. With a reach of 1 it is the error of the curves' shape itself.

    Parameters
    ----------
    reach : depth of the fit's presses over that of the predicted ones, at most 1
    uneven : (j,) `unevenness` of the fit's presses
    """
    press, presses = model.readings.press, model.readings.presses
    travel, own = model.displacement_m, model.by_log_compliance(at) / at.sigma_m
    deepest = np.zeros(presses)
    np.maximum.at(deepest, press, travel)
    shallow = travel <= max(reach, settings.least_reach) * deepest[press]
    shallow |= _first_half(press, travel)  # of few readings, less would tell no compliance
    deep = ~shallow if reach < 1 else travel >= settings.deep * deepest[press]
    square = np.bincount(press, shallow * own**2, presses)
    known = square > settings.told**-2
    if not known.any():
        return LawError(0.0, 0.0, 0.0)
    weight = shallow * own / np.maximum(square, 1e-30)[press]
    change = np.bincount(press, weight * at.residual, presses)
    left = (at.residual - own * change[press]) * at.sigma_m
    if reach < 1:
        left = _beyond(experiment, model, shallow)
    count = np.maximum(np.bincount(press, deep, presses), 1)
    mean = np.bincount(press, deep * left, presses) / count
    pull = np.bincount(press, deep * own * at.sigma_m, presses) / count
    # Noise of the deep readings, and of the compliance that the shallow ones give
    noise = np.bincount(press, deep * at.sigma_m**2, presses) / count**2
    noise += pull**2 / np.maximum(square, 1e-30)
    share, noise = (mean / deepest)[known], (noise / deepest**2)[known]
    common, middle = float(np.median(share)), float(np.median(noise))
    own, growth = _sizes(share - common, noise, uneven[known], settings)
    # What noise makes is none: two standard deviations of the median
    made = 2 * np.sqrt(np.pi / 2 * middle / len(share))
    common = abs(common) if abs(common) > made else 0.0
    own = float(np.hypot(own, settings.uneven * common))
    # The predicted presses are deeper than these by 1/reach. An error of the exponent is the same
    # at every depth, one of a law in powers of the depth grows as that: the middle of both
    return LawError(*(float(size / np.sqrt(reach)) for size in (common, own, growth)))


def unevenness(
    points_m: np.ndarray,
    log_c: np.ndarray,
    near_m: np.ndarray,
    near_log_c: np.ndarray,
    settings: LawErrorSettings = LAW_ERROR,
) -> np.ndarray:
    """Largest difference (j,) of the logarithm of a compliance to the nearest presses of a fit.

    Parameters
    ----------
    points_m, log_c : (j, 3) m and (j,)
    near_m, near_log_c : (k, 3) m and (k,) of the fit's presses
    """
    count = min(settings.neighbours + 1, len(near_m))  # a press of the fit is its own neighbour
    nearest = KDTree(near_m).query(points_m, count)[1].reshape(len(points_m), count)
    return np.abs(near_log_c[nearest] - log_c[:, None]).max(axis=1)


def _sizes(
    share: np.ndarray,
    noise: np.ndarray,
    uneven: np.ndarray,
    settings: LawErrorSettings = LAW_ERROR,
) -> tuple[float, float]:
    """Error of each press, and its growth with the unevenness, for which shares (j,) ask.

    The most likely ones beside a `noise` (j,) of the squared share.
    """
    sizes = np.geomspace(settings.least_size, settings.largest_size, settings.sizes)
    sizes, tail = np.append(0.0, sizes), settings.tail
    own, growth = (axis.ravel() for axis in np.meshgrid(sizes, sizes, indexing="ij"))
    variance = noise + own[:, None] ** 2 + (growth[:, None] * uneven) ** 2
    likely = -0.5 * np.log(variance) - (tail + 1) / 2 * np.log1p(share**2 / variance / tail)
    best = int(np.argmax(likely.sum(axis=1)))
    return float(own[best]), float(growth[best])


def _first_half(press: np.ndarray, travel: np.ndarray) -> np.ndarray:
    """Return (m,) bool: readings of the shallower half of each press, the middle one with it."""
    order = np.lexsort((travel, press))
    count = np.bincount(press)
    place = np.empty(len(press))
    place[order] = np.arange(len(press)) - np.repeat(np.cumsum(count) - count, count)
    return 2 * place < count[press]


def _beyond(
    experiment: PlacedExperiment, model: MeasurementModel, shallow: np.ndarray
) -> np.ndarray:
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
