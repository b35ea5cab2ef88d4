"""Spots of a free map: balls that make its readings more probable, with the odds of each.

Balls are added one after another to the model of the readings
(`identify.fit.free_map.ball_search`). Each spot is then judged beside all the others: its
probability is the sum over all balls that look like it, against one elsewhere and none; place, size
and contrast are those of the same balls, each with its own weight. Balls that overlap are one spot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identify.fit.free_map.ball_search import Balls, BallSearch, Beside
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.settings import SPOTS

_STRAIN = 0.4  # fall of the strain in a ball by its contrast
# Change of ln E as which a ball acts that is as good as a hole, as good as rigid
_ACTS = (-1.6, 2.4)


@dataclass(frozen=True)
class Spot:
    """A place that is harder or softer than the smooth map around it.

    Attributes
    ----------
    x_m, y_m, z_m : centre, body frame
    place_sd_m : standard deviation of the centre, root mean square over the axes; of a wide spot,
        over x and y
    diameter_m : of a ball, the median
    width_m : over which the map is smeared there
    contrast : modulus inside over that of the smooth map there
    lower95, upper95 : interval of the contrast
    probability : of a ball there that is as the contrast says, harder or softer, against one of
        the other kind, one elsewhere and none
    depth_seen : share of the prior's variance at the centre that the readings take away
    diameter_lower95_m, diameter_upper95_m : interval of the diameter; a lower end of 0 is open.
        None in files that were written before there was one
    wide : it may be wider than any ball that was tried; only x and y are told. A lump without an
        edge was offered 14 mm too deep, as the largest ball
    """

    x_m: float
    y_m: float
    z_m: float
    place_sd_m: float
    diameter_m: float
    width_m: float
    contrast: float
    lower95: float
    upper95: float
    probability: float
    depth_seen: float
    diameter_lower95_m: float | None = None
    diameter_upper95_m: float | None = None
    wide: bool = False

    @property
    def found(self) -> bool:
        """Whether the spot is offered as one, with depth and size."""
        return self.probability >= SPOTS.probable and not self.wide


def find_spots(
    search: BallSearch, posterior: FieldPosterior
) -> tuple[tuple[Spot, ...], np.ndarray]:
    """Return the spots in the readings of a posterior, the most probable first, and odd presses.

    Returns
    -------
    spots, and the probability (j,) that a press has an error of its own
    """
    added = _added(search)
    balls = [ball for ball in added if ball.real[0]]
    presses = [ball for ball in added if not ball.real[0]]
    presses, balls = _without_errors(search, presses, balls)
    groups = _groups(search, balls)
    while True:
        beside = [_beside(search, presses, balls, [g for g in groups if g is not group])
                  for group in groups]  # fmt: skip
        found = [
            _spot(search, others, balls[group[0]], posterior)
            for others, group in zip(beside, groups, strict=True)
        ]
        if all(spot.probability >= search.settings.possible for spot in found):
            break
        # The others were judged beside one that is hardly there
        del groups[int(np.argmin([spot.probability for spot in found]))]
    spots = tuple(sorted(found, key=lambda spot: -spot.probability))
    return spots, _errs(search, presses, balls, groups)


def _without_errors(
    search: BallSearch, presses: list[Balls], balls: list[Balls]
) -> tuple[list[Balls], list[Balls]]:
    """Return presses that err, and balls, less those in whose place a few presses do better.

    Neighbours that both slipped look like a ball: one ball is likelier than an error of either.
    """
    groups = _groups(search, balls)
    for group in groups:
        others = [other for other in groups if other is not group]
        beside = _beside(search, presses, balls, others)
        instead, gain = _erring(search, beside)
        there = search.balls.overlap(balls[group[0]])
        if gain > _log_sum(search.log_odds(beside)[there]):
            rest = [balls[number] for other in others for number in other]
            return _without_errors(search, [*presses, *instead], rest)
    return presses, balls


def _erring(search: BallSearch, beside: Beside) -> tuple[list[Balls], float]:
    """Return the few presses that explain most by errors of their own, and their log odds."""
    own = np.flatnonzero(~search.balls.real)
    presses: list[Balls] = []
    total = [0.0]
    for _ in range(search.settings.neighbours):
        odds = search.log_odds(beside)[own]
        presses.append(search.balls.some(own[[np.argmax(odds)]]))
        total.append(total[-1] + float(odds.max()))
        beside = search.added(beside, presses[-1])
    best = int(np.argmax(total))
    return presses[:best], total[best]


def _beside(
    search: BallSearch, presses: list[Balls], balls: list[Balls], groups: list[list[int]]
) -> Beside:
    """Return everything beside errors of presses, and the balls of some groups."""
    beside = search.alone
    for known in (*presses, *(balls[number] for group in groups for number in group)):
        beside = search.added(beside, known)
    return beside


def _errs(
    search: BallSearch, presses: list[Balls], balls: list[Balls], groups: list[list[int]]
) -> np.ndarray:
    """Return the probability (j,) of an error of each press alone, against a ball and none."""
    own = np.flatnonzero(~search.balls.real)
    found = np.zeros(len(own))
    for one in presses:
        others = [press for press in presses if press is not one]
        odds = search.log_odds(_beside(search, others, balls, groups))
        number = int(one.centre_m[0, 0])
        found[number] = np.exp(odds[own[number]] - _log_sum(np.append(odds, 0.0)))
    return found


def _added(search: BallSearch) -> list[Balls]:
    """Return balls and presses in the order in which they explain most; as many as are probable."""
    s, every = search.settings, search.balls
    beside, added, total = search.alone, [], [0.0]
    most = s.most + int(s.presses * np.sum(~every.real))
    while len(added) < most:
        odds = search.log_odds(beside)
        total.append(total[-1] + _log_sum(odds))
        if int(np.argmax(total)) <= len(added) - s.patience:
            break
        best = every.some(np.array([np.argmax(odds)]))
        if best.real[0]:
            finer, _ = search.finer(beside, np.flatnonzero(every.overlap(best)))
            best = finer.balls.some(np.array([np.argmax(search.log_odds(finer))]))
        added.append(best)
        beside = search.added(beside, best)
    return added[: int(np.argmax(total[: len(added) + 1]))]


def _groups(search: BallSearch, balls: list[Balls]) -> list[list[int]]:
    """Group balls with those before them that they overlap with, or that act alike: form or rim."""
    if not balls:
        return []
    together = search.instead(search.alone, Balls.joined(balls))
    groups: list[list[int]] = []
    for number, ball in enumerate(balls):
        alike = np.abs(search.alike(together, number)) > search.settings.alike
        one = np.flatnonzero(alike | together.balls.overlap(ball))
        for group in groups:
            if np.isin(group, one).any():
                group.append(number)
                break
        else:
            groups.append([number])
    return groups


def _spot(search: BallSearch, beside: Beside, ball: Balls, posterior: FieldPosterior) -> Spot:
    """Judge a ball beside others."""
    s, balls, odds = search.settings, search.balls, search.log_odds(beside)
    best = int(np.argmax(np.where(balls.overlap(ball), odds, -np.inf)))
    alike = balls.real & (search.alike(beside, best) > s.alike)
    own = np.flatnonzero(alike | balls.overlap(balls.some(np.array([best]))))
    there = float(np.exp(_log_sum(odds[own]) - _log_sum(np.append(odds, 0.0))))
    # The lattice tells the odds; places and radii between its own tell the likely ones apart
    beside, part = search.finer(beside, own)
    finer = beside.balls
    # Draws of prior and ball, and of the change of ln E, which is normal for each of them
    rng = np.random.default_rng(0)
    joint = beside.evidence[:, None] + search.gains(beside) + finer.log_prior
    joint = np.exp(joint - joint.max())
    chosen = rng.choice(joint.size, s.draws, p=joint.ravel() / joint.sum())
    kind, prior, drawn = np.unravel_index(chosen, joint.shape)
    precision = beside.power[prior, drawn] + np.array([a**-2 for a, _ in s.kinds])[kind]
    change = beside.match[prior, drawn] / precision
    change = change + rng.standard_normal(s.draws) / np.sqrt(precision)
    kind = _likelier_kind(change)
    there, drawn, change = there * float(np.mean(kind)), drawn[kind], change[kind]
    # ... and of the radius beside each, with the same change times volume
    wider = s.growth ** (part * rng.uniform(-0.5, 0.5, len(change)))
    radius = finer.radius_m[drawn] * wider
    least, most = np.percentile(radius, [2.5, 97.5]).tolist()
    ratio = _contrast(change / wider**3, rng)
    low, middle, high = np.percentile(ratio, [2.5, 50, 97.5]).tolist()
    place = finer.centre_m[drawn]
    centre = place.mean(axis=0)
    points = posterior.prior.grid.points_m
    at = int(np.argmin(np.linalg.norm(points - centre, axis=1)))
    x, y, z = centre.tolist()
    wide = bool(most >= s.growth**s.at_largest * balls.radius_m.max())
    told = slice(2) if wide else slice(3)
    return Spot(
        x, y, z,
        place_sd_m=float(np.sqrt(np.mean((place - centre)[:, told] ** 2))),
        diameter_m=float(2 * np.median(radius)),
        diameter_lower95_m=2 * least if least > balls.radius_m[balls.real].min() else 0.0,
        diameter_upper95_m=2 * most,
        width_m=float(posterior.smearing_m(np.array([at]))[0]),
        contrast=middle,
        lower95=low,
        upper95=high,
        probability=there,
        depth_seen=float(posterior.share[at]),
        wide=wide,
    )  # fmt: skip


def _likelier_kind(change: np.ndarray) -> np.ndarray:
    """Draws (n,) of the likelier kind, harder or softer, by their changes (n,) of ln E.

    A place that may be either is less sure to be the one that its interval is of.

    >>> _likelier_kind(np.array([0.2, -0.1, 0.3]))
    array([ True, False,  True])
    """
    harder = change > 0
    return harder == (np.mean(harder) >= 0.5)


def _contrast(change: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Contrasts (n,) of balls by the changes of ln E that act as they do, linear around a field.

    Around a field that holds the ball already, the change itself; around one that does not, the
    strain in it falls with its contrast k, so that it acts by (k - 1) / (1 + 0.4 (k - 1)) (Eshelby,
    Proc. R. Soc. A 241, 1957, of a ball that keeps its volume). A fitted field lies in between:
    half of the draws each.
    """
    falls = np.clip(change, *_ACTS)
    falls = np.log1p(falls / (1 - _STRAIN * falls))
    held = rng.random(len(change)) < 0.5
    return np.exp(np.where(held | (change > _ACTS[1]), change, falls))


def _log_sum(values: np.ndarray) -> float:
    """Logarithm of the sum of exponentials."""
    return float(np.logaddexp.reduce(values))
