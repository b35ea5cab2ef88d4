"""Which of several bodies a scan speaks for: as wide or narrow as no study states."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from identify.effects.base import Effect
from identify.fit import CONTACT_LAW, fit_map
from identify.measurement.experiment import PlacedExperiment
from identify.select import contact_law_of
from models import Catalogue


def likeliest_body(
    experiments: Iterable[PlacedExperiment], effects: Sequence[Effect], clear: float = 3.0
) -> tuple[int, list[float]]:
    """Return the number of the body that a free map has evidence for; the log evidences.

    The map is fitted beside the contact law of the presses alone. Without it the misfit of that law
    decided: in a measured scan of a large phantom for sides at the very presses, by 111.

    Parameters
    ----------
    experiments : the same scan on one body after the other; taken as long as the evidence rises
    effects : candidates of the contact law, the experiment's among them
    clear : rise of the log evidence from which another body than the first is taken, odds of
        twenty; that of four measured scans rose by 0 to 1, of saddles with sides near the presses
        by 8 to 81
    """
    evidence: list[float] = []
    beside: tuple = ()
    for experiment in experiments:
        if not evidence:
            beside = _with_law(experiment, Catalogue(effects))
        field = fit_map(replace(experiment, effects=beside), rough=True).field
        assert field is not None
        evidence.append(field.log_evidence)
        if evidence[-1] < max(evidence):
            break
    best = int(np.argmax(evidence))
    return (best if evidence[best] > evidence[0] + clear else 0), evidence


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
