"""Confirmation of an explanation on other readings: new fit, new test of each effect."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.measurement.model import MeasurementModel
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.select.accepted_effect import AcceptedEffect, at_bound
from identify.select.explanation import Explanation
from identify.select.reconsider import reconsider, without_unneeded
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import whitened_fit
from models import Scan


def confirmed(
    explained: Explanation,
    model: MeasurementModel,
    scan: Scan,
    same: np.ndarray,
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, Comparison] | None:
    """Test an explanation on some of its readings; None unless all of it holds.

    The residual must be noise again, or structured again, and every effect must earn its place
    beside the others. If it is noise, each that has a name must have the same group of equivalents
    as before; candidates that were far behind on these readings are not tried again.

    Parameters
    ----------
    explained : with one accepted effect or more
    model : without effects, of the other readings
    scan : placed, with these readings
    same : (m,) bool, the explanation's readings among them

    Returns
    -------
    the last model fitted to these readings, and the analysis of its residual
    """
    final, accepted = explained.final, explained.accepted
    say("fitting the answer")
    effects = final.fit.model.started(final.fit.u).effects
    fit = fit_jointly(replace(model, effects=effects), final.fit.map)
    comparison = compare_residual(whitened_fit(fit, scan), settings.residual)
    named = [effect for effect in accepted if not effect.is_unknown]  # courses have no groups
    alike = comparison.is_noise == final.comparison.is_noise
    if not alike or any(at_bound(fit, effect.name) for effect in named):
        return None
    _, lost = without_unneeded(fit, [effect.name for effect in accepted], say, settings)
    if lost:
        return None
    if not comparison.is_noise:
        return fit, comparison
    near = [_without_beaten(effect, same, settings) for effect in named]
    _, again, _ = reconsider(fit, near, say, last_too=True, settings=settings)
    same_groups = [(a.name, set(a.group)) for a in again] == [(a.name, set(a.group)) for a in named]
    return (fit, comparison) if same_groups else None


def _without_beaten(
    accepted: AcceptedEffect, same: np.ndarray, settings: SelectionSettings
) -> AcceptedEffect:
    """Leave out the candidates that are far behind on the same readings, (m,) bool.

    Those of an effect that was found without presses that stand apart were fitted to fewer
    readings, and are compared on all of their own.
    """

    def chi2(fit: FitResult) -> float:
        residual = fit.at.residual
        return float(np.sum(residual[same] ** 2 if len(residual) == len(same) else residual**2))

    best = min(chi2(c.fit) for c in accepted.candidates if c.name == accepted.name)
    most = best + settings.behind_chi2
    return replace(
        accepted, candidates=tuple(c for c in accepted.candidates if chi2(c.fit) <= most)
    )
