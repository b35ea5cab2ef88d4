"""Whether an answer holds on other readings: fitted anew, and its effects put to the test again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.measurement.model import MeasurementModel
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.select.accepted_effect import AcceptedEffect, at_bound
from identify.select.candidates import BEATEN_BY
from identify.select.forward_selection import Explanation, without_unneeded
from identify.select.reconsider import reconsider
from identify.select.step import whitened_fit
from models.scan import Scan


def confirmed(
    explained: Explanation,
    model: MeasurementModel,
    scan: Scan,
    same: np.ndarray,
    say: Callable[[str], None],
) -> tuple[FitResult, Comparison] | None:
    """Put an answer to the test on some of its readings; None unless all of it holds.

    The residual must be noise again, or structured again, and every effect must earn its place
    beside the others. If it is noise, each must have the same group of equivalents as before;
    candidates that were far behind on these readings are not tried again.

    Parameters
    ----------
    explained : by an addition or more
    model : without effects, of the other readings
    scan : placed, with these readings
    same : (m,) bool, which of the answer's readings they are

    Returns
    -------
    the last model fitted to these readings, and how its residual is judged
    """
    final, additions = explained.final, explained.accepted
    say("fitting the answer")
    effects = final.fit.model.started(final.fit.u).effects
    fit = fit_jointly(replace(model, effects=effects), final.fit.map)
    comparison = compare_residual(whitened_fit(fit, scan))
    names = [addition.name for addition in additions]
    alike = comparison.is_noise == final.comparison.is_noise
    if not alike or any(at_bound(fit, name) for name in names):
        return None
    _, lost = without_unneeded(fit, names, say)
    if lost:
        return None
    if not comparison.is_noise:
        return fit, comparison
    near = [_without_those_far_behind(addition, same) for addition in additions]
    _, again, _ = reconsider(fit, near, say, last_too=True)
    told_apart = [(a.name, set(a.group)) for a in again] == [
        (a.name, set(a.group)) for a in additions
    ]
    return (fit, comparison) if told_apart else None


def _without_those_far_behind(addition: AcceptedEffect, same: np.ndarray) -> AcceptedEffect:
    """Leave out the candidates that were no match on the same readings, (m,) bool."""

    def chi2(fit: FitResult) -> float:
        return float(np.sum(fit.at.residual[same] ** 2))

    best = min(chi2(r.fit) for r in addition.candidates if r.name == addition.name)
    near = tuple(
        candidate for candidate in addition.candidates if chi2(candidate.fit) <= best + BEATEN_BY
    )
    return replace(addition, candidates=near)
