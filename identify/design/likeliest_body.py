"""Which of several bodies a scan speaks for: as wide or narrow as no study states."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fem import SolverError
from identify.effects.base import Effect
from identify.fit import CONTACT_LAW, fit_map
from identify.measurement.experiment import PlacedExperiment
from identify.optimize import InadmissibleError
from identify.select import contact_law_of
from models import Catalogue

CLEAR = 3.0  # rise of the log evidence, odds of twenty: that of two measured scans was 0 to 1, of
# four saddles with sides near the presses 4 to 69; of eight bodies that slope to their base it fell


def likeliest_body(
    experiments: Iterable[PlacedExperiment], catalogue: Catalogue[Effect]
) -> tuple[int, list[float]]:
    """Return the number of the body that a free map has evidence for; the log evidences.

    The map is fitted beside the contact law of the presses alone. Without it the misfit of that law
    decided: in a measured scan of a large phantom for sides at the very presses, by 111.

    Parameters
    ----------
    experiments : the same scan on one body after the other; taken as long as the evidence rises
    catalogue : candidates of the contact law, the experiment's effects among them
    """
    evidence: list[float] = []
    beside: tuple = ()
    for experiment in experiments:
        if not evidence:
            beside = _with_law(experiment, catalogue)
        try:
            field = fit_map(replace(experiment, effects=beside), rough=True).field
        except (InadmissibleError, SolverError):  # that body has no evidence
            break
        assert field is not None
        evidence.append(field.log_evidence)
        if evidence[-1] < max(evidence):
            break
    return _clearly_best(evidence), evidence


def _clearly_best(evidence: Sequence[float]) -> int:
    """Return the number of the largest log evidence, 0 where the first is hardly smaller.

    >>> _clearly_best([0.0, 1.0, 2.5, 2.0]), _clearly_best([0.0, 2.0, 4.0, 3.0]), _clearly_best([])
    (0, 2, 0)
    """
    best = int(np.argmax(evidence)) if len(evidence) else 0
    return best if best and evidence[best] > evidence[0] + CLEAR else 0


def _with_law(experiment: PlacedExperiment, catalogue: Catalogue[Effect]) -> tuple:
    """Return the experiment's effects and those of its presses' contact law, with their values."""
    # The textbook laws that take most of the misfit will do
    textbook = Catalogue(effect for effect in catalogue if effect.family == effect.name)
    law = contact_law_of(experiment, textbook, replace(CONTACT_LAW, most_effects=2))
    if law is None:
        return experiment.effects
    best = law.partial or law.found
    stated = {effect.name for effect, _ in experiment.effects}
    names = [name for name in best.names if name not in stated]
    return *experiment.effects, *((catalogue[name], best.values[name]) for name in names)
