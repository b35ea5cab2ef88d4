"""An accepted effect with its equivalents."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.fit.result import FitResult
from identify.select.candidates import Candidate
from identify.select.settings import SELECTION, SelectionSettings


@dataclass(frozen=True)
class AcceptedEffect:
    """An effect of the model, with the candidates of its step.

    Attributes
    ----------
    name : of the effect
    candidates : compared with it, itself included, best first
    shown_by_presses : the contact law of the presses calls for it, whatever the map
    confounded : for each candidate, the effects it cannot be separated from because of model error
    chi2_before : chi-square of the step before
    first_candidates : those of its own step, if they were compared again since
    settings : of the selection
    """

    name: str
    candidates: tuple[Candidate, ...]
    shown_by_presses: bool = False
    confounded: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    chi2_before: float = np.inf
    first_candidates: tuple[Candidate, ...] = ()
    settings: SelectionSettings = SELECTION

    @property
    def equivalents(self) -> tuple[str, ...]:
        """The effect and all candidates that explain the scan as well, to within the margin.

        A candidate loses by its price alone only with a clearly higher chi-square. A more general
        effect, which contains this one, can always do nearly as well: it is no equivalent.
        """
        best, margin, close = self.candidates[0], self.settings.margin, self.settings.close
        near = [
            c
            for c in self.candidates
            if c.criterion < best.criterion + margin or c.chi2 < best.chi2 + close
        ]
        return tuple(c.name for c in near if self.name not in c.contains)

    @property
    def group(self) -> tuple[str, ...]:
        """Effects between which the scan does not decide: `equivalents` and `confounded`."""
        if len(self.equivalents) > 1 and self.name != MODEL_ERROR:
            return self.equivalents
        others = self.confounded.get(self.name, ())
        return (*self.equivalents, *(name for name in others if name not in self.equivalents))

    @property
    def decided(self) -> bool:
        """Whether the group has one cause: a single effect, or forms of one family."""
        family = {candidate.name: candidate.family for candidate in self.candidates}
        return len({family.get(name, name) for name in self.group}) == 1


def at_bound(fit: FitResult, name: str) -> bool:
    """Whether an amplitude of an effect ends at a bound of the search other than its null.

    The scan asks for more of the effect than was thought possible: the cause may be another one.
    A natural end (no friction, no change of volume) is no such bound.
    """
    (part,) = (part for part in fit.model.effects if part.effect.name == name)
    nulls = {amplitude.name: amplitude.null for amplitude in part.effect.amplitudes}
    held = (unknown.rpartition(".") for unknown in fit.at_bound)
    return any(
        effect == name and parameter in nulls and fit.at.values[name][parameter] != nulls[parameter]
        for effect, _, parameter in held
    )
