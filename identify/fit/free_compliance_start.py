"""The presses of a scan by themselves, before any map: the contact law that their curves show.

Asked first where a scan is far from what the model with a map can say. The readings without the
effects that were found are straight lines, on which the map is then fitted as on any others.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.experiment import BodyModel
from identify.fit.contact_law import GROSS, ContactLaw, contact_law
from identify.fit.free_compliance import FreeCompliance, FreeComplianceFit, straightened
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.map.initial_guess import REFERENCE_PA
from identify.measurement.model import EffectInModel
from identify.measurement.noise import Noise
from models.scan import Scan

Say = Callable[[str], None]

_ODD = 2.0  # chi-square per degree of freedom of presses under a ball


def free_compliance(scan: Scan, body: BodyModel, noise: Noise) -> FreeCompliance:
    """Return the placed readings, each press with a compliance of its own."""
    used, contacts = scan.used(), body.coarse.contacts
    mechanics = BodyMechanics(body.coarse, None, lambda nu: body.coarse)
    unit = REFERENCE_PA * compliance(body.coarse, GaussianMap(REFERENCE_PA))
    return FreeCompliance(
        Readings.of(scan),
        used.displacement_m,
        noise,
        contacts.radius_m,
        contacts.profile,
        mechanics.poisson_ratio,
        unit,
        mechanics.state(),
    )


def law_of(
    presses: FreeCompliance,
    had: Sequence[EffectInModel],
    catalogue: Sequence[Effect],
    say: Say = lambda text: None,
) -> ContactLaw | None:
    """Return the contact law that the presses show, or None where the map's own will do.

    Parameters
    ----------
    had : effects in the model already, those of the body left out
    catalogue : effects that may be found
    """
    plain = presses.fit(())
    curved = presses.profile != "flat" or bool(had)
    if plain.chi2_per_dof < GROSS and not curved:
        return None
    own = presses.fit(had) if had else plain
    # No straight line stands between a ball and its effects: the presses are asked sooner
    if own.chi2_per_dof < (_ODD if curved else GROSS):
        return ContactLaw(own, own, {}) if curved else None
    return contact_law(presses, catalogue, had, say)


def straight(scan: Scan, found: FreeComplianceFit) -> Scan:
    """Return the used rows of a placed scan as they would be without the effects found."""
    used = scan.used()
    return used.replace(displacement_m=straightened(found, Readings.of(scan)))


def typical_error_m(fit: FitResult, scan: Scan) -> float:
    """Return by how much a map usually misses a press's displacement, m; a few may be far off."""
    worst = np.zeros(len(scan.press_ids))
    np.maximum.at(worst, scan.used().press_index, np.abs(fit.residual_m))
    return float(1.48 * np.median(worst))


def typical_error(fit: FitResult, found: FreeComplianceFit) -> float:
    """Return by how much, relative, a map usually misses the compliance that a press has alone."""
    off = np.log(fit.compliance_m_per_n / found.compliance)
    return float(1.48 * np.median(np.abs(off)))


def curved_again(fit: FitResult, scan: Scan) -> FitResult:
    """Return a fit to straightened readings as one to the scan's own."""
    measured = scan.used().displacement_m
    residual = measured - fit.predicted_m
    rms = float(np.sqrt(np.mean(residual**2)))
    return replace(fit, displacement_m=measured, residual_m=residual, rms_m=rms)
