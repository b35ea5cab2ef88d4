"""A matched filter for balls beside a free map: how much more probable one makes the readings.

A press that slipped, or met its place elsewhere than stated, competes with them: what its
neighbours feel of a ball decides.

A ball changes ln E by a inside it, and the readings t in data space
(`identify.fit.free_map.field_data`) by a x, with x = V' K (share of the ball in each grid point).
With S the covariance of t by noise, map error and field, effects eliminated, and a ~ N(0, v),

    p(t | ball) / p(t) = (1 + v F)^-1/2 exp(v y^2 / (2 + 2 v F)),    F = x' S^-1 x,  y = x' S^-1 t

The prior of the most probable field was found without balls, which it takes for roughness: the
evidence is summed over a ladder of priors, most of them calmer. Balls are added one by one; each is
a further part v x x' of S. Places and radii are equally probable before any reading, so that the
mean of the ratios over all of them counts how many were tried. Sources: Turin, "An introduction to
matched filters", IRE Trans. Inf. Theory 6, 1960; Kass and Raftery, "Bayes factors", J. Am. Stat.
Assoc. 90, 1995.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.spatial import KDTree

from identify.fit.free_map.field_evidence import Hyper
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.settings import SPOTS, SpotSettings
from identify.map import Grid

_DEAF = 1e6  # variance of a press that is known to err, over that of a slip


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls that a scan may show, or errors of single presses.

    Attributes
    ----------
    centre_m : (c, 3); of a press nothing but its number
    radius_m : (c,); 0 of a press
    pattern : (j, c) change of the target by each, for a change of ln E by 1
    log_prior : (c,) logarithm of the number of such balls that is expected before any reading
    """

    centre_m: np.ndarray
    radius_m: np.ndarray
    pattern: np.ndarray
    log_prior: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Balls]) -> Balls:
        """Return all balls of some parts."""
        return cls(
            np.concatenate([part.centre_m for part in parts]),
            np.concatenate([part.radius_m for part in parts]),
            np.hstack([part.pattern for part in parts]),
            np.concatenate([part.log_prior for part in parts]),
        )

    def some(self, balls: np.ndarray) -> Balls:
        """Return some of them."""
        return Balls(
            self.centre_m[balls], self.radius_m[balls], self.pattern[:, balls],
            self.log_prior[balls],
        )  # fmt: skip

    @property
    def real(self) -> np.ndarray:
        """Balls among them, (c,) bool; the others are presses."""
        return self.radius_m > 0

    @property
    def number(self) -> int:
        """Number of the one press."""
        return int(self.centre_m[0, 0])

    def overlap(self, other: Balls) -> np.ndarray:
        """Whether each (c,) is a ball and overlaps with any of some others."""
        apart = np.linalg.norm(self.centre_m[:, None] - other.centre_m, axis=2)
        return self.real & (apart < self.radius_m[:, None] + other.radius_m).any(axis=1)


def share_inside(grid: Grid, centre_m: np.ndarray, radius_m: np.ndarray) -> sparse.csc_matrix:
    """Share (g, c) of balls about centres (c, 3) in the cells of a grid; their volumes are kept."""
    step = max(grid.spacing_m)
    near = KDTree(grid.points_m).query_ball_point(centre_m, radius_m + step / 2)
    ball = np.repeat(np.arange(len(centre_m)), [len(points) for points in near])
    point = np.concatenate([np.array(points, dtype=int) for points in near])
    apart = np.linalg.norm(grid.points_m[point] - centre_m[ball], axis=1)
    # A ramp as wide as a cell makes the volume of a ball larger by this
    larger = 1 + (step / radius_m[ball]) ** 2 / 4
    share = np.clip((radius_m[ball] - apart) / step + 0.5, 0.0, 1.0) / larger
    return sparse.csc_matrix((share, (point, ball)), shape=(len(grid), len(centre_m)))


@dataclass(frozen=True, eq=False)
class Beside:
    """Balls beside the fields of h priors, and beside balls that are known to be there.

    Attributes
    ----------
    balls : c of them
    priors : (h,) of the ladder
    evidence : (h,) log evidence of each prior
    power : (h, c) F of each ball
    match : (h, c) y of each ball
    weights : of each known ball, S^-1 x (h, j) beside those before it, and its v / (1 + v F) (h,)
    """

    balls: Balls
    priors: np.ndarray
    evidence: np.ndarray
    power: np.ndarray
    match: np.ndarray
    weights: tuple[tuple[np.ndarray, np.ndarray], ...] = ()


class BallSearch:
    """The matched filter over all balls that a scan may show.

    Parameters
    ----------
    posterior : of the field without balls
    hyper : of its prior
    longest_m : largest length of the prior
    """

    def __init__(
        self,
        posterior: FieldPosterior,
        hyper: Hyper,
        longest_m: float,
        settings: SpotSettings = SPOTS,
    ) -> None:
        self.settings, self.data = settings, posterior.data
        self.grid = posterior.prior.grid
        self._factors = list(self._covariances(posterior, hyper, longest_m))
        noise = self._noise(np.full(len(posterior.data.target), hyper.error**2))
        noise[np.diag_indices_from(noise)] += 1
        self.balls = Balls.joined([self._balls(cholesky(noise, lower=True)), self._presses()])

    def _noise(self, variance: np.ndarray) -> np.ndarray:
        """Covariance (j, j) of the target by errors of the presses' ln C, of a variance (j,)."""
        root = self.data.root
        return (root.T * variance) @ root

    def _covariances(
        self, posterior: FieldPosterior, hyper: Hyper, longest_m: float
    ) -> Iterator[np.ndarray]:
        """Yield the lower triangular factors of S, of the fitted prior and of others."""
        root, by_field, scales = self.data.root, self.data.by_field, self.settings.scales
        prior = posterior.prior
        common = root.T @ (prior.common(by_field) @ by_field.T) @ root
        common[np.diag_indices_from(common)] += 1
        own = np.ones(len(root))
        errors = [
            self._noise((c * hyper.error) ** 2 * own) for c in (scales if hyper.error else (0.0,))
        ]
        lengths = {hyper.length_m ** (1 - c) * longest_m**c for c in (0.0, *self.settings.longer)}
        for number, length in enumerate(sorted(lengths)):
            unit = replace(prior, length_m=length, spread=1.0, level_spread=0.0, layer_spread=0.0)
            of_field = root.T @ (unit.product(by_field) @ by_field.T) @ root
            for spread in scales:
                if spread == 0 and number:
                    continue  # no field, of whatever length
                for error in errors:
                    whole = common + (spread * hyper.spread) ** 2 * of_field + error
                    yield cholesky(whole, lower=True)

    def _balls(self, noise: np.ndarray) -> Balls:
        """Return the balls that would show beside noise, of lower triangular factor (j, j)."""
        s, grid = self.settings, self.grid
        box = np.array([grid.points_m[0], grid.points_m[-1]])
        least, most = max(grid.spacing_m), s.largest_radius * np.ptp(box, axis=0)[:2].min()
        count = int(np.log(max(most / least, 1.0)) / np.log(s.growth)) + 1
        found = []
        for radius in (least * s.growth ** np.arange(count)).tolist():
            centre = Grid.over(box, s.apart * radius).points_m
            inside = share_inside(grid, centre, np.full(len(centre), radius))
            pattern = self._pattern(inside)
            shown = np.linalg.norm(solve_triangular(noise, pattern, lower=True), axis=0)
            shows = np.log(s.ball_contrast) * shown > s.shows
            prior = np.full(len(centre), -np.log(max(shows.sum(), 1)))
            balls = Balls(centre, np.full(len(centre), radius), pattern, prior)
            found.append(balls.some(np.flatnonzero(shows)))
        balls = Balls.joined(found)
        radii = len(np.unique(balls.radius_m))
        return replace(balls, log_prior=balls.log_prior + np.log(s.expected / max(radii, 1)))

    def _presses(self) -> Balls:
        """Return the presses as balls of no size: each may have an error of its own."""
        s, count = self.settings, len(self.data.target)
        place = np.arange(count)[:, None] * np.ones(3)
        prior = np.full(count, np.log(s.slips / count))
        return Balls(place, np.zeros(count), s.slip * self.data.root.T, prior)

    def split(self, balls: Balls, share: float) -> Balls:
        """Return 16 balls in place of each, which halve its part of the lattice on each axis.

        `share` is the edge of that part in the lattice's own step.
        """
        s = self.settings
        signs = share / 4 * np.array(list(product((-1, 1), repeat=4)))
        off = s.apart * balls.radius_m[:, None, None] * signs[:, :3]
        centre = (balls.centre_m[:, None] + off).reshape(-1, 3)
        radius = np.outer(balls.radius_m, s.growth ** signs[:, 3]).ravel()
        pattern = self._pattern(share_inside(self.grid, centre, radius))
        return Balls(centre, radius, pattern, np.repeat(balls.log_prior - np.log(16), 16))

    def _pattern(self, inside: sparse.csc_matrix) -> np.ndarray:
        """Change (j, c) of the target by balls of a share (g, c)."""
        return self.data.root.T @ np.asarray(inside.T @ self.data.by_field.T).T

    @cached_property
    def alone(self) -> Beside:
        """All balls beside the fields alone."""
        return self._beside(self.balls, np.arange(len(self._factors)))

    def _beside(self, balls: Balls, priors: np.ndarray) -> Beside:
        evidence, power, match = [], [], []
        for factor in (self._factors[prior] for prior in priors):
            own = solve_triangular(factor, self.data.target, lower=True)
            white = solve_triangular(factor, balls.pattern, lower=True)
            evidence.append(-0.5 * own @ own - np.log(np.diag(factor)).sum())
            power.append(np.sum(white**2, axis=0))
            match.append(own @ white)
        return Beside(balls, priors, np.array(evidence), np.array(power), np.array(match))

    def instead(self, beside: Beside, balls: Balls) -> Beside:
        """Return other balls beside those that are known to be there."""
        there = self._beside(balls, beside.priors)
        for weight, scale in beside.weights:
            across = weight @ balls.pattern
            match = there.match - (scale * (weight @ self.data.target))[:, None] * across
            there = replace(there, power=there.power - scale[:, None] * across**2, match=match)
        return replace(there, evidence=beside.evidence, weights=beside.weights)

    def gains(self, beside: Beside) -> np.ndarray:
        """Log evidence (k, h, c) of one ball more of each of k kinds, over that without it."""
        found = []
        for amplitude, share in self.settings.kinds:
            known = 1 + amplitude**2 * beside.power
            gain = 0.5 * (amplitude**2 * beside.match**2 / known - np.log(known))
            found.append(np.log(share) + gain)
        return np.array(found)

    def gain(self, beside: Beside) -> np.ndarray:
        """Log evidence (h, c) of one ball more, of whatever kind, over that without it."""
        return np.logaddexp.reduce(self.gains(beside), axis=0)

    def log_odds(self, beside: Beside) -> np.ndarray:
        """Log odds (c,) of one ball more of each kind against none, over all priors."""
        whole = np.logaddexp.reduce(beside.evidence[:, None] + self.gain(beside), axis=0)
        return whole - np.logaddexp.reduce(beside.evidence) + beside.balls.log_prior

    def weight(self, beside: Beside, ball: Balls) -> np.ndarray:
        """S^-1 x (h, j) of one ball."""
        x = ball.pattern[:, 0]
        found = np.array([cho_solve((self._factors[p], True), x) for p in beside.priors])
        for before, scale in beside.weights:
            found -= (scale * (before @ x))[:, None] * before
        return found

    def added(self, beside: Beside, ball: Balls) -> Beside:
        """Return all balls beside one more that is known to be there."""
        there = self.instead(beside, ball)
        likelier = self.gains(there)[:, :, 0].argmax(axis=0)
        v = np.array([amplitude**2 for amplitude, _ in self.settings.kinds])[likelier]
        if not ball.real[0]:  # a press that errs says nothing more
            v = v * _DEAF
        weight, scale = self.weight(beside, ball), v / (1 + v * there.power[:, 0])
        across = weight @ beside.balls.pattern
        return Beside(
            beside.balls,
            beside.priors,
            beside.evidence + self.gain(there)[:, 0],
            beside.power - scale[:, None] * across**2,
            beside.match - (scale * there.match[:, 0])[:, None] * across,
            (*beside.weights, (weight, scale)),
        )

    def finer(self, beside: Beside, balls: np.ndarray) -> tuple[Beside, float]:
        """Return the likely parts of some balls (n,) int of the lattice, and a part's edge.

        Only beside the priors that are likely with one of them. The edge, in the lattice's step, is
        halved until enough parts are about as likely.
        """
        s = self.settings
        best = beside.evidence + self.gain(beside)[:, balls].max(axis=1)
        some = best > best.max() - s.unlikely
        parts, odds = beside.balls.some(balls), self.log_odds(beside)[balls]
        beside = replace(
            beside, priors=beside.priors[some], evidence=beside.evidence[some],
            weights=tuple((weight[some], scale[some]) for weight, scale in beside.weights),
        )  # fmt: skip
        for number in range(s.most_splits):
            weight = np.exp(odds - np.logaddexp.reduce(odds))
            if number >= s.splits and np.sum(weight**2) < 1 / s.enough:
                return beside, 0.5**number
            kept = np.argsort(-odds)[: s.kept]
            beside = self.instead(beside, self.split(parts.some(kept), 0.5**number))
            parts, odds = beside.balls, self.log_odds(beside)
        return beside, 0.5**s.most_splits

    def alike(self, beside: Beside, ball: int) -> np.ndarray:
        """Cosines (c,) between the patterns of all balls and one, beside its likeliest field."""
        prior = int(np.argmax(beside.evidence + self.gain(beside)[:, ball]))
        power = np.maximum(beside.power[prior], 1e-300)
        weight = self.weight(beside, beside.balls.some(np.array([ball])))[prior]
        return weight @ beside.balls.pattern / np.sqrt(power * power[ball])

    def shown_by(self, change: np.ndarray) -> float:
        """Size of a change (g,) of the field in the readings, in standard deviations.

        Noise, the map's own error and the field count as deviations, over all priors.
        """
        x = self.data.root.T @ (self.data.by_field @ change)
        likely = np.exp(self.alone.evidence - np.logaddexp.reduce(self.alone.evidence))
        power = [np.sum(solve_triangular(f, x, lower=True) ** 2) for f in self._factors]
        return float(np.sqrt(likely @ np.array(power)))
