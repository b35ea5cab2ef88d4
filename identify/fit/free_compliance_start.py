"""Contact law of a scan before any map, for a start of the map.

Sought first for a scan far from any model with a map. The readings without the effects found are
straight lines, to which the map is then fitted as to any others.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from fem.palpation import by_contact_radius
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect
from identify.effects.readings import Readings
from identify.fit.contact_law import ContactLaw, contact_law
from identify.fit.contact_law_sets import Set
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit, straightened
from identify.fit.result import FitResult
from identify.fit.settings import CONTACT_LAW, ContactLawSettings
from identify.map.initial_guess import REFERENCE_PA
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.experiment import BodyModel
from identify.measurement.noise import Noise
from identify.optimize.side_by_side import minimize_side_by_side
from models import Scan

Say = Callable[[str], None]
_NOISE = 0.01  # level of a press's chi-square beyond which it is off


def free_compliance(scan: Scan, body: BodyModel, noise: Noise) -> FreeCompliance:
    """Return the placed readings, each press with a compliance of its own."""
    used, contacts = scan.used(), body.coarse.contacts
    mechanics = BodyMechanics(body.coarse, None, lambda nu: body.coarse)
    even = body.coarse.evaluate(REFERENCE_PA)
    unit = REFERENCE_PA * even.compliance
    ball = contacts.profile == "hertz"
    return FreeCompliance(
        Readings.of(scan),
        used.displacement_m,
        noise,
        contacts,
        mechanics.poisson_ratio,
        unit,
        mechanics.state(),
        by_contact_radius(even) / even.compliance if ball else None,
    )


def law_of(
    presses: FreeCompliance,
    stated: Sequence[EffectInModel],
    catalogue: Sequence[Effect],
    say: Say = lambda text: None,
    settings: ContactLawSettings = CONTACT_LAW,
    tried: Sequence[Set] = (),
) -> ContactLaw | None:
    """Return the contact law of the presses, or None where that of the map suffices.

    Parameters
    ----------
    stated : effects of the study, without those of the body
    catalogue : effects that may be found
    tried : sets of these, see `contact_law`
    """
    plain = presses.fit(())
    curved = presses.contacts.profile != "flat" or bool(stated)
    if plain.chi2_per_dof < settings.bent and not curved:
        return None
    fit = presses.fit(stated) if stated else plain
    # Curves that are bent anyway are no straight lines to start from: the law is sought sooner
    if fit.chi2_per_dof < (settings.bent_ball if curved else settings.bent):
        return ContactLaw(fit, on_any_body(presses, fit), {}, settings) if curved else None
    law = contact_law(presses, catalogue, stated, say, settings, tried)
    return replace(law, found=on_any_body(presses, law.found))


def on_any_body(presses: FreeCompliance, found: FreeComplianceFit) -> FreeComplianceFit:
    """Return a fit with the least chi-square of each press on a body of any kind.

    A flat tip feels one number of the body, the compliance. A ball feels how that goes with its
    growing contact, too: over a thin soft layer on a hard lump a contact stiffens up to four times
    as fast as on an even body. Three numbers describe it in `identify.effects.sphere`: compliance,
    modulus under the tip, and growth. Presses of noise alone keep what they have.
    """
    (squares, count), s = found.by_press, presses.settings
    off = squares > chdtri(np.maximum(count - 1, 1), _NOISE)
    if presses.growth is None or not (off & presses.felt).any():
        return replace(found, on_any_body=squares)
    even = presses.unit_compliance / found.compliance
    start = np.log(found.compliance), np.log(even)
    lower = np.array([start[0] - s.own_compliance, start[1] - s.own_modulus, presses.growth])
    upper = np.array([start[0] + s.own_compliance, start[1] + s.own_modulus, presses.growth])
    lower[2], upper[2] = s.own_growth
    least = squares
    for growth in (presses.growth, np.full_like(presses.growth, s.stiffening)):
        _, own = minimize_side_by_side(
            lambda x: presses.residual(found, *x),
            presses.readings.press,
            np.array([*start, growth]),
            (lower, upper),
            np.full(3, s.own_step),
        )
        least = np.minimum(least, own)
    return replace(found, on_any_body=np.where(off, least, squares))


def straight(scan: Scan, found: FreeComplianceFit) -> Scan:
    """Return the used rows of a placed scan without the effects found."""
    used = scan.used()
    return used.replace(displacement_m=straightened(found, Readings.of(scan)))


def typical_error_m(fit: FitResult, scan: Scan) -> float:
    """Return the typical error of a map in a press's displacement, m; robust against outliers."""
    worst = np.zeros(len(scan.press_ids))
    np.maximum.at(worst, scan.used().press_index, np.abs(fit.residual_m))
    return float(1.48 * np.median(worst))


def typical_error(fit: FitResult, found: FreeComplianceFit) -> float:
    """Return the typical relative error of a map in a press's free compliance."""
    off = np.log(fit.compliance_m_per_n / found.compliance)
    return float(1.48 * np.median(np.abs(off)))


def curved_again(fit: FitResult, scan: Scan) -> FitResult:
    """Return a fit to straightened readings as one to the measured readings."""
    measured = scan.used().displacement_m
    residual = measured - fit.predicted_m
    rms = float(np.sqrt(np.mean(residual**2)))
    return replace(fit, displacement_m=measured, residual_m=residual, rms_m=rms)
