"""Error of the laws of a fit at depths that its scan has not reached."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from identify.effects.readings import Readings
from identify.fit.free_compliance_start import free_compliance
from identify.measurement.chain import judge
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel

LEAST_REACH, DEEP = 0.35, 0.8  # shares of a press's depth
UNEVEN = 0.5  # part of a common error of the laws that may differ from press to press


class LawError(NamedTuple):
    """Error of the laws as shares of the travel: common to all presses, and of each alone."""

    common: float
    own: float


def law_error(
    experiment: PlacedExperiment, model: MeasurementModel, at: Linearised, reach: float
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
