"""Error of the laws of a fit at depths that its scan has not reached."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from identify.effects.readings import Readings
from identify.fit.free_compliance_start import free_compliance
from identify.measurement.chain import judge
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel

LEAST_REACH, DEEP = 0.35, 0.8  # shares of a press's depth
UNEVEN = 0.5  # part of a common error of the laws that may differ from press to press
NEIGHBOURS = 6  # among which a press's unevenness is told
TAIL = 4.0  # degrees of freedom of Student's t, by which single presses count less
SIZES = np.concatenate([[0.0], np.geomspace(2e-3, 1.0, 40)])  # of an error of the laws
TOLD = 0.3  # largest error of a compliance by the shallow readings that predicts deep ones


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


def law_error(
    experiment: PlacedExperiment,
    model: MeasurementModel,
    at: Linearised,
    reach: float,
    uneven: np.ndarray,
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
    shallow = travel <= max(reach, LEAST_REACH) * deepest[press]
    shallow |= _first_half(press, travel)  # of few readings, less would tell no compliance
    deep = ~shallow if reach < 1 else travel >= DEEP * deepest[press]
    square = np.bincount(press, shallow * own**2, presses)
    known = square > TOLD**-2
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
    own, growth = _sizes(share - common, noise, uneven[known])
    # What noise makes is none: two standard deviations of the median
    made = 2 * np.sqrt(np.pi / 2 * middle / len(share))
    common = abs(common) if abs(common) > made else 0.0
    own = float(np.hypot(own, UNEVEN * common))
    # The predicted presses are deeper than these by 1/reach. An error of the exponent is the same
    # at every depth, one of a law in powers of the depth grows as that: the middle of both
    return LawError(*(float(size / np.sqrt(reach)) for size in (common, own, growth)))


def unevenness(
    points_m: np.ndarray, log_c: np.ndarray, near_m: np.ndarray, near_log_c: np.ndarray
) -> np.ndarray:
    """Largest difference (j,) of the logarithm of a compliance to the nearest presses of a fit.

    Parameters
    ----------
    points_m, log_c : (j, 3) m and (j,)
    near_m, near_log_c : (k, 3) m and (k,) of the fit's presses
    """
    count = min(NEIGHBOURS + 1, len(near_m))  # a press of the fit is its own neighbour
    nearest = KDTree(near_m).query(points_m, count)[1].reshape(len(points_m), count)
    return np.abs(near_log_c[nearest] - log_c[:, None]).max(axis=1)


def _sizes(share: np.ndarray, noise: np.ndarray, uneven: np.ndarray) -> tuple[float, float]:
    """Error of each press, and its growth with the unevenness, for which shares (j,) ask.

    The most likely ones beside a `noise` (j,) of the squared share.
    """
    own, growth = (axis.ravel() for axis in np.meshgrid(SIZES, SIZES, indexing="ij"))
    variance = noise + own[:, None] ** 2 + (growth[:, None] * uneven) ** 2
    likely = -0.5 * np.log(variance) - (TAIL + 1) / 2 * np.log1p(share**2 / variance / TAIL)
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
