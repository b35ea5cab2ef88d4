"""Whether an answer holds on other readings: fitted anew, and its effects put to the test again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identify.addition import Addition, at_bound
from identify.compare import compare_residual
from identify.comparison import Comparison
from identify.explain import Explanation, without_unneeded
from identify.joint_fit import JointFit, fit_jointly
from identify.measurement_model import MeasurementModel
from identify.rung import whitened_fit
from identify.second_look import look_again
from models.scan import Scan

_FAR_BEHIND = 200.0  # in chi-square: `_BEATEN_BY` of `identify.rivals`, whatever the best one did


@dataclass(frozen=True)
class Confirmed:
    """The fit to the other readings, how its residual is judged, and the additions beside it."""

    fit: JointFit
    comparison: Comparison
    additions: tuple[Addition, ...]


def confirmed(
    explained: Explanation,
    model: MeasurementModel,
    scan: Scan,
    same: np.ndarray,
    say: Callable[[str], None],
) -> Confirmed | None:
    """Put an answer to the test on some of its readings; None unless all of it holds.

    The residual must be noise again, every effect must earn its place beside the others, and none
    of its rivals may take it. Those that were far behind on these readings are not tried again.

    Parameters
    ----------
    explained : by an addition or more, so that its residual is noise
    model : without effects, of the other readings
    scan : placed, with these readings
    same : (m,) bool, which of the answer's readings they are
    """
    final = explained.final.fit
    say("fitting the answer")
    fit = fit_jointly(replace(model, effects=final.model.started(final.u).effects), final.map)
    comparison = compare_residual(whitened_fit(fit, scan))
    names = [addition.name for addition in explained.additions]
    if not comparison.is_noise or any(at_bound(fit, name) for name in names):
        return None
    _, lost = without_unneeded(fit, names, say)
    if lost:
        return None
    near = [_without_those_far_behind(addition, same) for addition in explained.additions]
    _, additions, exchanged = look_again(fit, near, say, the_last_too=True)
    return None if exchanged else Confirmed(fit, comparison, tuple(additions))


def _without_those_far_behind(addition: Addition, same: np.ndarray) -> Addition:
    """Leave out the rivals that were no match on the same readings, (m,) bool."""

    def chi2(fit: JointFit) -> float:
        return float(np.sum(fit.at.residual[same] ** 2))

    best = min(chi2(r.fit) for r in addition.rivals if r.name == addition.name)
    near = [rival for rival in addition.rivals if chi2(rival.fit) <= best + _FAR_BEHIND]
    return replace(addition, rivals=tuple(near))
