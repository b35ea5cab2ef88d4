"""An accepted effect with its equivalents."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from identify.body.discretization_error import MODEL_ERROR
from identify.effects.unknown_course import UNKNOWN
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.result import FitResult
from identify.select.candidates import Candidate, gains
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
    partial : the presses' curves call for it and leave structure in many: no law of them all
    range_of : by parameter, how far other laws of contact move it, down and up
    law : fit of the presses with the law, each with a compliance of its own; None without a law
    settings : of the selection
    """

    name: str
    candidates: tuple[Candidate, ...]
    shown_by_presses: bool = False
    confounded: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    chi2_before: float = np.inf
    first_candidates: tuple[Candidate, ...] = ()
    partial: bool = False
    range_of: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    law: FreeComplianceFit | None = None
    settings: SelectionSettings = SELECTION

    @property
    def equivalents(self) -> tuple[str, ...]:
        """The effect and all candidates that explain the scan as well, to within the margin.

        A candidate loses by its price alone only with a clearly higher chi-square, or a price that
        no chance makes up for: fifteen terms of a surface follow many a course. One that gains more
        than chance does not lose: the shape of a surface looked like a force bias. A more general
        effect, which contains this one, can always do nearly as well, and so can the course of an
        unknown cause: it is no equivalent. The accepted one may itself be behind the best, which
        leaves structure: both are then equivalents.
        """
        best = min(self.candidates, key=lambda c: (c.name != self.name, c.criterion))
        margin, close, dear = self.settings.margin, self.settings.close, self.settings.dear
        chance = self.settings.sure / len(self.candidates)
        near = [
            c
            for c in self.candidates
            if c.criterion < best.criterion + margin
            or (c.chi2 < best.chi2 + close and c.criterion < best.criterion + dear)
            or gains(best, c, chance)
        ]
        return tuple(
            c.name for c in near
            if self.name not in c.contains and (c.family != UNKNOWN or self.is_unknown)
        )  # fmt: skip

    @property
    def group(self) -> tuple[str, ...]:
        """Effects between which the scan does not decide: `equivalents` and `confounded`."""
        if len(self.equivalents) > 1 and self.name != MODEL_ERROR:
            return self.equivalents
        others = self.confounded.get(self.name, ())
        return (*self.equivalents, *(name for name in others if name not in self.equivalents))

    @property
    def meets_presses(self) -> bool:
        """True if its contact law leaves noise in the presses, each on a body of its own."""
        if self.law is None or not self.shown_by_presses:
            return False
        return self.law.middle_misfit <= self.settings.meets_presses

    @property
    def is_unknown(self) -> bool:
        """Whether it is a course that stands in for a cause outside the catalogue."""
        return any(c.name == self.name and c.family == UNKNOWN for c in self.candidates)

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


def undetermined(
    fit: FitResult, names: Sequence[str], settings: SelectionSettings = SELECTION
) -> tuple[str, ...]:
    """Return those of the named effects whose size the scan does not determine.

    That is an effect with amplitudes whose 95 % intervals all cover their bounds; and each of two
    effects of which the scan determines a sum only: their amplitudes go together, and 0 lies within
    the interval of either.
    """
    low, high = fit.model.bounds
    std = np.sqrt(np.diag(fit.covariance_scaled))
    lower, upper = np.maximum(fit.u - 1.96 * std, low), np.minimum(fit.u + 1.96 * std, high)
    whole = upper - lower >= settings.whole_bound * (high - low)
    # At a natural end (a base without friction) the law levels off: the end itself is the finding
    whole &= ~fit.model.unknowns.at_natural_end(fit.u)
    together = np.abs(fit.covariance_scaled) > settings.together * np.outer(std, std)
    rows: dict[str, list[int]] = {}
    null = np.zeros(len(std), dtype=bool)
    for part in fit.model.effects:
        if part.effect.name not in names:
            continue
        rows[part.effect.name] = []
        for amplitude, absent in part.effect.null.items():
            name = f"{part.effect.name}.{amplitude}"
            if name not in fit.model.names:
                continue
            row = fit.model.names.index(name)
            at_null = fit.model.unknowns.unknowns[row].to_scaled(absent)
            null[row] = lower[row] <= at_null <= upper[row]
            rows[part.effect.name].append(row)

    def one_of_a_sum(name: str) -> bool:
        others = [row for other, found in rows.items() if other != name for row in found]
        return any(
            null[row] and null[other] and together[row, other]
            for row in rows[name]
            for other in others
        )

    return tuple(
        name
        for name, found in rows.items()
        if found and (all(whole[row] for row in found) or one_of_a_sum(name))
    )
