"""Next presses: planned scans that separate the equivalent effects of the present scan.

Every candidate has been fitted to the present scan. Each predicts a planned scan, made after it.
The discrimination D of a pair is the difference of its two predictions, once map and parameters of
the second candidate have been refitted to present and planned readings together:

    D = |P (r_A - r_B)|^2,   P projecting out candidate B's derivatives on both scans,

in units of chi-square, less the part of the present scan. Beside a free map the unknowns are ln C
of each planned press and the effects, with their covariance by the present scan. Laws of contact
are told by the presses alone: the unknowns are then ln C of each place, present and planned, and
the effects. Of the two orders of a pair the smaller D counts. Where the present scan has told the
two apart by less than one of them being right would have, D is taken in that proportion. A refit
follows the bent valley of the map's weight and depth, with a smaller residual than this straight
step: D may be promised up to twice too large.

A design with a larger D than needed is reduced to the presses with the largest parts of
|P (r_A - r_B)|^2, as few as still reach the aim (`PlanSettings.aim`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.linalg import cholesky, lstsq, solve_triangular

from identify.body.mechanics import BodyMechanics
from identify.design.predicted_limits import planned
from identify.design.scan_variants import Design, Presses, presses_of
from identify.design.settings import PLAN, PlanSettings
from identify.effects.readings import Readings
from identify.fit.result import FitResult
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.measurement.places import Places, numbered, places_of, shared_places
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
    alone: Mapping[str, float] | None = None,
) -> tuple[Proposal, ...]:
    """Rank planned scans: by the number of separated pairs, then by duration.

    Parameters
    ----------
    candidates : effects by name with their joint fits to the present scan
    designs : planned scans
    alone : chi-square of the presses under each candidate, each place with a compliance of its own,
        where these tell the candidates apart; None: beside the map
    """
    found, present = [], _Present.of(candidates, alone)
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        try:
            found.append(_proposal(present, design, settings))
        except InadmissibleError:
            continue
    return tuple(sorted(found, key=_rank))


def _rank(proposal: Proposal) -> tuple[int, float]:
    separated = len(proposal.separated)
    last = proposal.design.presses.duration_s if separated else -proposal.discrimination
    return -separated, last


def _proposal(present: "_Present", design: Design, settings: PlanSettings) -> Proposal:
    planned_scan = _Planned(present, design)
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
    again = _separation(fewer, _Planned(present, fewer).worth(np.arange(many)), settings)
    return again if set(again.separated) >= set(wanted) else whole


def _separation(design: Design, worth: Mapping[Pair, float], settings: PlanSettings) -> Proposal:
    separated = tuple(pair for pair, d in worth.items() if d >= settings.needed)
    alike = tuple(pair for pair in worth if pair not in separated)
    pair = min(separated or alike, key=lambda pair: worth[pair])
    return Proposal(design, worth[pair], pair, separated, alike)


@dataclass(frozen=True)
class _Ordered:
    """Planned readings by the first of a pair, about those of the second.

    Attributes
    ----------
    pair : the effects' names
    known, target : (k, k) and (k,) what the present scan says of the second one's k unknowns,
        as whitened rows
    derivatives, apart : (m, k) and (m,) whitened rows of the planned readings
    borne_out : share of such a difference that the present scan has shown, at most 1
    """

    pair: Pair
    known: np.ndarray
    target: np.ndarray
    derivatives: np.ndarray
    apart: np.ndarray
    borne_out: float

    def remaining(self, rows: np.ndarray) -> np.ndarray:
        """Return the whitened difference that the unknowns leave, of the present and some rows."""
        return _left(
            np.vstack([self.known, self.derivatives[rows]]),
            np.concatenate([self.target, self.apart[rows]]),
        )


@dataclass(frozen=True)
class _Present:
    """Candidates with their fits to the present scan, and its rows on each pair.

    Attributes
    ----------
    fits, chi2 : by name
    alone : the presses tell the candidates apart, see `next_presses`
    rows : by (truth, name), derivatives (m, k) of the present readings of the second one, and what
        the first one predicts otherwise (m,), whitened. Unknown are map and effects; ln C of each
        place and the effects, if `alone`; beside a free map the effects, a compliance of its own
        for each press taken off
    """

    fits: Mapping[str, FitResult]
    chi2: Mapping[str, float]
    alone: bool
    rows: Mapping[Pair, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(
        cls, candidates: Sequence[tuple[str, FitResult]], alone: Mapping[str, float] | None = None
    ) -> "_Present":
        """Compare the candidates' fits pair by pair."""
        fits = dict(candidates)
        views = {name: fit.at if alone is None else _alone(fit) for name, fit in fits.items()}
        rows: dict[Pair, tuple[np.ndarray, np.ndarray]] = {}
        for name, fit in fits.items():
            at, press = views[name], fit.model.readings.press
            others = [truth for truth in fits if truth != name]
            apart = np.column_stack([views[o].predicted_m - at.predicted_m for o in others])
            white, derivatives = at.whitened(apart, press), at.jacobian
            effects = derivatives[:, len(fit.model.space.free) :]
            if alone is not None:
                place = numbered(places_of(fit.model.readings))
                own = _by_place(fit.model, at, place, place.max() + 1)
                derivatives = np.hstack([own, effects])
            elif fit.field is not None:
                each = np.arange(fit.model.readings.presses)
                own = _by_place(fit.model, at, each, len(each))
                both = _left(own, np.hstack([effects, white]))
                derivatives, white = both[:, : effects.shape[1]], both[:, effects.shape[1] :]
            rows |= {
                (other, name): (derivatives, one)
                for other, one in zip(others, white.T, strict=True)
            }
        chi2 = {name: fit.chi2 for name, fit in fits.items()} if alone is None else alone
        return cls(fits, chi2, alone is not None, rows)

    def borne_out(self, pair: Pair) -> float:
        """Return the share of their difference by which the scan has told two fits apart.

        Were the first one right, chi-square of the other would be larger by the squared difference
        d^2 of their predictions that its unknowns leave, with a standard deviation of 2 d. Where it
        is less by more than two of these, the readings lie between the two, and will again.
        """
        square = float(np.sum(_left(*self.rows[pair]) ** 2))
        differs = abs(self.chi2[pair[0]] - self.chi2[pair[1]])
        shown = differs + 4 * float(np.sqrt(square))
        return 1.0 if shown >= square else shown / square

    def known(self, pair: Pair) -> tuple[np.ndarray, np.ndarray]:
        """Return the scan's rows on the unknowns of the second, if the first one is right."""
        derivatives, apart = self.rows[pair]
        q, root = np.linalg.qr(derivatives)
        return root, q.T @ apart


class _Planned:
    """Planned readings, predicted by every candidate after the present ones."""

    def __init__(self, present: _Present, design: Design) -> None:
        fits, alone, presses = present.fits, present.alone, design.presses
        views: dict[str, tuple[MeasurementModel, Linearised]] = {}
        like: BodyMechanics | None = None
        for name, fit in fits.items():
            views[name] = planned(fit, design, further=True, like=like)
            like = views[name][0].mechanics
        self.press = next(iter(views.values()))[0].readings.press
        self.ordered: list[_Ordered] = []
        for truth, name in permutations(fits, 2):
            fit, (model, there) = fits[name], views[name]
            apart = views[truth][1].predicted_m - there.predicted_m
            white, derivatives = there.whitened(apart, self.press), there.jacobian
            known, target = present.known((truth, name))
            effects = derivatives[:, len(fit.model.space.free) :]
            if alone:
                made = fit.model.readings.presses
                place = numbered(_together(fit.model.readings, model.readings))
                places, before = place.max() + 1, place[:made].max() + 1
                known = np.insert(known, [before] * (places - before), 0.0, axis=1)
                own = _by_place(model, there, place[made:], places)
                derivatives = np.hstack([own, effects])
            elif fit.field is not None:
                each = np.arange(len(presses))
                derivatives = np.hstack([_by_place(model, there, each, len(each)), effects])
                known, target = _known_of_free_map(fit, presses, there)
            shown = present.borne_out((truth, name))
            self.ordered.append(_Ordered((truth, name), known, target, derivatives, white, shown))

    def worth(self, presses: np.ndarray) -> dict[Pair, float]:
        """Return D of every pair, the lesser of its two orders, if only these presses are made."""
        found: dict[Pair, float] = {}
        for (truth, model), added in self.worth_in_order(presses).items():
            pair = (truth, model) if (model, truth) not in found else (model, truth)
            found[pair] = min(added, found.get(pair, np.inf))
        return found

    def worth_in_order(self, presses: np.ndarray) -> dict[Pair, float]:
        """Return D of every (truth, model) if only these presses are made."""
        rows = np.isin(self.press, presses)
        return {o.pair: o.borne_out * float(np.sum(o.remaining(rows) ** 2)) for o in self.ordered}

    def most_telling_first(self, pair: Pair) -> np.ndarray:
        """Return the planned presses (j,), by their part of a pair's discrimination."""
        parts, rows = np.zeros(self.press[-1] + 1), np.ones(len(self.press), bool)
        for ordered in self.ordered:
            if set(ordered.pair) == set(pair):
                planned_rows = ordered.remaining(rows)[len(ordered.target) :]
                parts += np.bincount(self.press, planned_rows**2)
        return np.argsort(-parts, kind="stable")


def _alone(fit: FitResult) -> Linearised:
    """Linearise the present readings at a fit's compliances, without the uncertainty of its map."""
    at, model = fit.at, replace(fit.model, map_uncertainty=None)
    return model.around(at.body, fit.u, at.compliance / at.body.compliance)


def _by_place(
    model: MeasurementModel, at: Linearised, place: np.ndarray, places: int
) -> np.ndarray:
    """Return the whitened derivatives (m, p) by ln C of each place, by the presses' places (j,)."""
    press = model.readings.press
    columns = np.zeros((len(press), places))
    columns[np.arange(len(press)), place[press]] = model.by_log_compliance(at)
    return at.whitened(columns, press)


def _together(present: Readings, planned: Readings) -> Places:
    """Return the places of both scans, the present ones first."""
    both = places_of(present), places_of(planned)
    return Places(*(np.concatenate(pair) for pair in zip(*both, strict=True)))


def _known_of_free_map(
    fit: FitResult, presses: Presses, there: Linearised
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same for ln C of the planned presses and the effects, beside a free map.

    Both candidates' maps follow the present readings, which say nothing against either.
    """
    assert fit.field is not None
    assert fit.field.posterior is not None
    error, made = fit.field.hyper.error, presses_of(fit.model.readings)
    shared = shared_places(*(Places(p.point_m, p.direction, p.radius_m) for p in (made, presses)))
    covariance = fit.field.posterior.predicted_covariance(there.body.by_field(), shared)
    own = np.where(shared.any(axis=1), 0.0, error**2)
    each = np.arange(len(own))
    covariance[each, each] += own + 1e-9 * covariance[each, each]
    root = cholesky(covariance, lower=True)
    return solve_triangular(root, np.eye(len(root)), lower=True), np.zeros(len(root))


def _left(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return the part of r (m,) beyond the columns of g (m, k)."""
    scale = np.linalg.norm(g, axis=0)
    g = g / np.where(scale > 0, scale, 1.0)
    fitted = lstsq(g, r, cond=1e-10, lapack_driver="gelsy")
    assert fitted is not None
    return r - g @ fitted[0]
