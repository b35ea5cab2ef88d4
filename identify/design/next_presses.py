"""Next presses: planned scans that separate the equivalent effects of the present scan.

Every candidate has been fitted to the present scan. Each predicts a planned scan, made after it.
The discrimination D of a pair is the difference of its two predictions, once map and parameters of
the second candidate have been refitted to present and planned readings together:

    D = |P (r_A - r_B)|^2,   P projecting out candidate B's derivatives on both scans,

in units of chi-square, less the part of the present scan. Beside a free map the unknowns are ln C
of each planned press and the effects, with their covariance by the present scan. Laws of contact
are told by the presses alone: C of a planned press is unknown then, whatever the map. Of the two
orders of a pair the smaller D counts. A refit follows the bent valley of the map's weight and
depth, with a smaller residual than this straight step: D may be promised up to twice too large.

A design with a larger D than needed is reduced to the presses with the largest parts of
|P (r_A - r_B)|^2, as few as still reach the aim (`PlanSettings.aim`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.linalg import block_diag, cholesky, lstsq, solve_triangular

from identify.body.mechanics import BodyMechanics
from identify.design.predicted_limits import planned
from identify.design.scan_variants import Design, Presses, presses_of
from identify.design.settings import PLAN, PlanSettings
from identify.fit.result import FitResult
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.residual.own_errors import Places, shared_places

Pair = tuple[str, str]

_UNKNOWN = 1.0  # standard deviation of ln C of a press that may be anything


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
    alone: bool = False,
) -> tuple[Proposal, ...]:
    """Rank planned scans: by the number of separated pairs, then by duration.

    Parameters
    ----------
    candidates : effects by name with their joint fits to the present scan
    designs : planned scans
    alone : the presses tell the candidates apart, each with a compliance of its own
    """
    found = []
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        try:
            found.append(_proposal(candidates, design, settings, alone))
        except InadmissibleError:
            continue
    return tuple(sorted(found, key=_rank))


def _rank(proposal: Proposal) -> tuple[int, float]:
    separated = len(proposal.separated)
    last = proposal.design.presses.duration_s if separated else -proposal.discrimination
    return -separated, last


def _proposal(
    candidates: Sequence[tuple[str, FitResult]],
    design: Design,
    settings: PlanSettings,
    alone: bool,
) -> Proposal:
    planned_scan = _Planned(candidates, design, alone)
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
    again = _separation(fewer, _Planned(candidates, fewer, alone).worth(np.arange(many)), settings)
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
    """

    pair: Pair
    known: np.ndarray
    target: np.ndarray
    derivatives: np.ndarray
    apart: np.ndarray

    def remaining(self, rows: np.ndarray) -> np.ndarray:
        """Return the whitened difference that the unknowns leave, of the present and some rows."""
        return _left(
            np.vstack([self.known, self.derivatives[rows]]),
            np.concatenate([self.target, self.apart[rows]]),
        )


class _Planned:
    """Planned readings, predicted by every candidate after the present ones."""

    def __init__(
        self, candidates: Sequence[tuple[str, FitResult]], design: Design, alone: bool = False
    ) -> None:
        fits = dict(candidates)
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
            if fit.field is None and not alone:
                known = _known_of_map(fit, fits[truth])
                derivatives = there.jacobian
            else:
                of_map = len(fit.model.space.free)  # none of a free map
                known = (
                    _known_of_presses(fit, len(design.presses), of_map)
                    if alone
                    else _known_of_free_map(fit, design.presses, there)
                )
                by_press = np.zeros((len(self.press), len(design.presses)))
                by_press[np.arange(len(self.press)), self.press] = model.by_log_compliance(there)
                own = there.whitened(by_press, self.press)
                derivatives = np.hstack([own, there.jacobian[:, of_map:]])
            white = there.whitened(apart, self.press)
            self.ordered.append(_Ordered((truth, name), *known, derivatives, white))

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
        return {o.pair: float(np.sum(o.remaining(rows) ** 2)) for o in self.ordered}

    def most_telling_first(self, pair: Pair) -> np.ndarray:
        """Return the planned presses (j,), by their part of a pair's discrimination."""
        parts, rows = np.zeros(self.press[-1] + 1), np.ones(len(self.press), bool)
        for ordered in self.ordered:
            if set(ordered.pair) == set(pair):
                planned_rows = ordered.remaining(rows)[len(ordered.target) :]
                parts += np.bincount(self.press, planned_rows**2)
        return np.argsort(-parts, kind="stable")


def _known_of_map(fit: FitResult, truth: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """Return the present scan's rows on the unknowns of a fit, were another one's readings true."""
    apart = truth.at.predicted_m - fit.at.predicted_m
    white = fit.at.whitened(apart, fit.model.readings.press)
    q, root = np.linalg.qr(fit.at.jacobian)
    return root, q.T @ white


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
    return _rows(covariance)


def _known_of_presses(fit: FitResult, presses: int, of_map: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the same where each planned press has a compliance that nothing tells beforehand."""
    effects = fit.covariance_scaled[of_map:, of_map:]
    return _rows(block_diag(_UNKNOWN**2 * np.eye(presses), effects))


def _rows(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whitened rows that say as much of some unknowns, about zero."""
    root = cholesky(covariance, lower=True)
    return solve_triangular(root, np.eye(len(root)), lower=True), np.zeros(len(root))


def _left(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return the part of r (m,) beyond the columns of g (m, k)."""
    scale = np.linalg.norm(g, axis=0)
    g = g / np.where(scale > 0, scale, 1.0)
    fitted = lstsq(g, r, cond=1e-10, lapack_driver="gelsy")
    assert fitted is not None
    return r - g @ fitted[0]
