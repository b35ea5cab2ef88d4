"""Next presses: planned scans that separate the equivalent effects of the present scan.

Every candidate has been fitted to the present scan. Each predicts a planned scan, made after it.
The discrimination D of a pair is the difference of its two predictions, once map and parameters of
the second candidate have been refitted to present and planned readings together:

    D = |P (r_A - r_B)|^2,   P projecting out candidate B's derivatives on both scans,

in units of chi-square, less the part of the present scan. Of the two orders of a pair the smaller D
counts. A refit follows the bent valley of the map's weight and depth, with a smaller residual than
this straight step: D may be promised up to twice too large.

A design with a larger D than needed is reduced to the presses with the largest parts of
|P (r_A - r_B)|^2, as few as still reach the aim (`PlanSettings.aim`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from identify.design.predicted_limits import planned
from identify.design.scan_variants import Design
from identify.design.settings import PLAN, PlanSettings
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError

Pair = tuple[str, str]


@dataclass(frozen=True)
class Proposal:
    """A planned scan with the pairs of candidates that it separates.

    Attributes
    ----------
    design : its presses
    discrimination : least difference of chi-square between two candidates that it separates;
        between any two if it separates none
    pair : these two
    separated : pairs that it separates
    alike : other pairs
    """

    design: Design
    discrimination: float
    pair: Pair
    separated: tuple[Pair, ...]
    alike: tuple[Pair, ...]

    @property
    def enough(self) -> bool:
        """Whether one such scan separates all pairs."""
        return not self.alike


def next_presses(
    candidates: Sequence[tuple[str, FitResult]],
    designs: Sequence[Design],
    progress: Callable[[str], None] | None = None,
    settings: PlanSettings = PLAN,
) -> tuple[Proposal, ...]:
    """Rank planned scans: by the number of separated pairs, then by duration.

    Parameters
    ----------
    candidates : effects by name with their joint fits to the present scan
    designs : planned scans
    """
    found = []
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        try:
            found.append(_proposal(candidates, design, settings))
        except InadmissibleError:
            continue
    return tuple(sorted(found, key=_rank))


def _rank(proposal: Proposal) -> tuple[int, float]:
    separated = len(proposal.separated)
    last = proposal.design.presses.duration_s if separated else -proposal.discrimination
    return -separated, last


def _proposal(
    candidates: Sequence[tuple[str, FitResult]], design: Design, settings: PlanSettings
) -> Proposal:
    planned_scan = _Planned(candidates, design)
    worth = planned_scan.worth(np.arange(len(design.presses)))
    wanted = [pair for pair, d in worth.items() if d >= settings.aim]
    whole = _separation(design, worth, settings)
    if not wanted:
        return whole

    def enough(presses: np.ndarray) -> bool:
        worth = planned_scan.worth(presses)
        return all(worth[pair] >= settings.aim for pair in wanted)

    order = planned_scan.most_telling_first(min(wanted, key=lambda pair: worth[pair]))
    few, many = (
        min(settings.fewest, len(order)) - 1,
        len(order),
    )  # `many` presses are enough, `few` not
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (few, middle) if enough(order[:middle]) else (middle, many)
    if many == len(order):
        return whole
    fewer = replace(design, presses=design.presses.taken(np.sort(order[:many])))
    # Made on their own these presses come earlier and at other places in the order
    again = _separation(fewer, _Planned(candidates, fewer).worth(np.arange(many)), settings)
    return again if set(again.separated) >= set(wanted) else whole


def _separation(design: Design, worth: Mapping[Pair, float], settings: PlanSettings) -> Proposal:
    separated = tuple(pair for pair, d in worth.items() if d >= settings.needed)
    alike = tuple(pair for pair in worth if pair not in separated)
    pair = min(separated or alike, key=lambda pair: worth[pair])
    return Proposal(design, worth[pair], pair, separated, alike)


class _Planned:
    """Present and planned readings, predicted by every candidate."""

    def __init__(self, candidates: Sequence[tuple[str, FitResult]], design: Design) -> None:
        views = {name: planned(fit, design, further=True) for name, fit in candidates}
        now = {name: fit.at for name, fit in candidates}
        self.press = next(iter(views.values()))[0].readings.press
        made = candidates[0][1].model.readings.press
        self.present = len(made)
        self.ordered: list[tuple[Pair, np.ndarray, np.ndarray]] = []
        for truth, model in permutations(now, 2):
            here, there = now[model], views[model][1]
            apart = np.concatenate(
                [
                    here.whitened(now[truth].predicted_m - here.predicted_m, made),
                    there.whitened(views[truth][1].predicted_m - there.predicted_m, self.press),
                ]
            )
            derivatives = np.vstack([here.jacobian, there.jacobian])
            self.ordered.append(((truth, model), derivatives, apart))

    def worth(self, presses: np.ndarray) -> dict[Pair, float]:
        """Return D of every pair, the lesser of its two orders, if only these presses are made."""
        found: dict[Pair, float] = {}
        for (truth, model), added in self.worth_in_order(presses).items():
            pair = (truth, model) if (model, truth) not in found else (model, truth)
            found[pair] = min(added, found.get(pair, np.inf))
        return found

    def worth_in_order(self, presses: np.ndarray) -> dict[Pair, float]:
        """Return D of every (truth, model) if only these presses are made."""
        rows = np.concatenate([np.ones(self.present, bool), np.isin(self.press, presses)])
        found: dict[Pair, float] = {}
        for pair, g, apart in self.ordered:
            before = _left(g[: self.present], apart[: self.present])
            both = _left(g[rows], apart[rows])
            found[pair] = max(float(both @ both - before @ before), 0.0)
        return found

    def most_telling_first(self, pair: Pair) -> np.ndarray:
        """Return the planned presses (j,), by their part of a pair's discrimination."""
        parts = np.zeros(self.press[-1] + 1)
        for ordered, g, apart in self.ordered:
            if set(ordered) == set(pair):
                parts += np.bincount(self.press, _left(g, apart)[self.present :] ** 2)
        return np.argsort(-parts, kind="stable")


def _left(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return the part of r (m,) beyond the columns of g (m, k)."""
    scale = np.linalg.norm(g, axis=0)
    g = g / np.where(scale > 0, scale, 1.0)
    return r - g @ np.linalg.lstsq(g, r, rcond=1e-10)[0]
