"""An effect that was added, and what it cannot be told from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.fit.result import FitResult
from identify.select.candidates import MARGIN, Candidate

CLOSE = 5.0  # in chi-square: what a parameter more does not pay for, the data have not decided


@dataclass(frozen=True)
class AcceptedEffect:
    """An effect that was added, the candidates that it was compared with (best first).

    `before` : chi-square without it, when it was added.
    `tried` : the candidates when it was added, if they were compared again since.
    `shown_by_presses` : the contact law of the presses calls for it, whatever the map.
    `beside` : for each candidate, the effects it cannot be separated from because of model error.
    """

    name: str
    candidates: tuple[Candidate, ...]
    shown_by_presses: bool = False
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    before: float = np.inf
    tried: tuple[Candidate, ...] = ()

    @property
    def equivalents(self) -> tuple[str, ...]:
        """The effect and all candidates that explain the scan as well, to within `MARGIN`.

        Nor is one beaten by its price alone, if its chi-square comes within `CLOSE`. A candidate of
        which the effect is a special case can always do nearly as well: it is none.
        """
        best = self.candidates[0]
        near = [
            candidate
            for candidate in self.candidates
            if candidate.criterion < best.criterion + MARGIN or candidate.chi2 < best.chi2 + CLOSE
        ]
        return tuple(candidate.name for candidate in near if self.name not in candidate.contains)

    @property
    def group(self) -> tuple[str, ...]:
        """What the scan cannot tell apart: the `equals`, and what an error of the model is like."""
        if len(self.equivalents) > 1 and self.name != MODEL_ERROR:
            return self.equivalents
        beside = self.beside.get(self.name, ())
        return (*self.equivalents, *(name for name in beside if name not in self.equivalents))


def at_bound(fit: FitResult, name: str) -> bool:
    """Whether an amplitude of an effect ends at a bound of what is possible, other than no effect.

    So much of it as the scan asks for cannot be there: something else is.
    """
    (part,) = (part for part in fit.model.effects if part.effect.name == name)
    nulls = {amplitude.name: amplitude.null for amplitude in part.effect.amplitudes}
    held = (unknown.rpartition(".") for unknown in fit.at_bound)
    return any(
        effect == name and own in nulls and fit.at.values[name][own] != nulls[own]
        for effect, _, own in held
    )
