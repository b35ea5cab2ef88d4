"""Laws of contact that are as credible as a fit's, and how else they go on at greater depths.

The travel at a depth that no press of a fit has reached rests on the form of the law. Laws with one
effect of the contact more, fewer or another, that explain the fit's presses nearly as well
(`identify.fit.settings.ContactLawSettings.unsure`), are fitted to these alone, and carried to the
predicted depths.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from identify.effects.base import Effect
from identify.fit.contact_law_sets import fit_set, well_spread_presses
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.free_compliance_start import free_compliance
from identify.fit.settings import CONTACT_LAW
from identify.measurement.chain import OperatingPoint
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel


def law_forms(
    experiment: PlacedExperiment,
    seen: MeasurementModel,
    catalogue: Sequence[Effect],
    model: MeasurementModel,
    at: Linearised,
) -> np.ndarray:
    """Change (m, f) m of predicted travels by other laws of the contact, one standard deviation.

    Of the credible laws the one with the longest and the one with the shortest travel (f = 2, or
    none where there are no others); each counts by half of its square.

    Parameters
    ----------
    experiment, seen : of the fit
    catalogue : the effects
    model, at : of the predicted scan
    """
    presses = free_compliance(experiment.scan, experiment.body, seen.noise)
    presses = well_spread_presses(presses, CONTACT_LAW.searched)
    own = [part for part in seen.effects if presses.shows(part.effect)]
    found = presses.fit(own)
    others = [e for e in catalogue if _of_contact(e) and presses.shows(e)]
    laws = list(_laws(presses, found, others))
    plain = found if not own else presses.fit(())
    most = found.misfit + CONTACT_LAW.unsure * max(plain.misfit - plain.dof, 0.0)
    changes = [
        change
        for law in laws
        if law.misfit <= most
        and np.isfinite(change := _changed(presses, found, law, model, at)).all()
    ]
    if not changes:
        return np.zeros((len(at.predicted_m), 0))
    mean = [float(np.mean(change)) for change in changes]
    ends = [changes[int(pick(mean))] for pick in (np.argmin, np.argmax)]
    return np.array(ends).T / np.sqrt(2.0)


def _of_contact(effect: Effect) -> bool:
    return "contact" in effect.hooks


def _laws(
    presses: FreeCompliance, found: FreeComplianceFit, others: Sequence[Effect]
) -> Iterator[FreeComplianceFit]:
    """Yield fits with one effect of the contact fewer, another in its place, or one more."""
    have = set(found.names)

    def beside(parts: Sequence[EffectInModel]) -> Iterator[FreeComplianceFit]:
        base = presses.fit(parts)
        for effect in others:
            if effect.name not in have and (
                fit := fit_set(presses, base, [presses.begun(effect, {})])
            ):
                yield fit

    for part in found.parts:
        if _of_contact(part.effect):
            rest = [other for other in found.parts if other is not part]
            yield presses.fit(rest)
            yield from beside(rest)
    yield from beside(found.parts)


def _changed(
    presses: FreeCompliance,
    found: FreeComplianceFit,
    law: FreeComplianceFit,
    model: MeasurementModel,
    at: Linearised,
) -> np.ndarray:
    """Change (m,) m of the predicted travels by another law, the compliances fitted anew with it.

    The ratio of both compliances is a straight line over the logarithm of what is felt, compliance
    by radius, as far as the presses go.
    """
    felt = np.log(found.compliance * presses.contacts.radius_m)[presses.felt]
    ratio = np.log(law.compliance / found.compliance)[presses.felt]
    here = np.log(at.point.compliance * model.mechanics.coarse.contacts.radius_m)
    here = np.clip(here, felt.min(), felt.max())
    own = felt - felt.mean()
    slope = own @ ratio / max(own @ own, 1e-12)
    log_ratio = ratio.mean() + slope * (here - felt.mean())
    force, modulus = at.point.force_n, at.point.modulus
    predicted = []
    for fit, share in ((found, 0.0), (law, 1.0)):
        c = at.point.compliance * np.exp(share * log_ratio)
        unseen = [e for e in model.chain.effects if e.name not in found.names]
        chain = replace(model.chain, effects=[*unseen, *(part.effect for part in fit.parts)])
        values = {**at.point.values, **fit.values}
        e = modulus * at.point.compliance / c
        predicted.append(chain.predict(OperatingPoint(c, e, force, values)))
    return predicted[1] - predicted[0]
