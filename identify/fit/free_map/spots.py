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
    at_rim : the presses do not reach around it. On a measured phantom, whose sides nobody has
        stated, three of seven sure spots stood there
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
    at_rim: bool = False

    @property
    def found(self) -> bool:
        """Whether the spot is offered as one, with depth and size."""
        return self.probability >= SPOTS.probable and not self.wide


def find_spots(
    search: BallSearch, posterior: FieldPosterior
) -> tuple[tuple[Spot, ...], np.ndarray]:
    """Return the spots in the readings of a posterior, the most probable first, and slips.

    Returns
    -------
    spots, and the probability (j,) that a press slipped, against a ball under it and none
    """
    added = _added(search)
    balls = [ball for ball in added if ball.real[0]]
    slips = np.zeros(int(np.sum(~search.balls.real)))
    presses, balls = _without_errors(search, [b for b in added if not b.real[0]], balls, slips)
    groups = _groups(search, balls)
    while True:
        found = []
        for group in groups:
            others = [balls[number] for other in groups if other is not group for number in other]
            beside = _beside(search, presses, others, balls[group[0]])
            erring = _erring(search, beside, balls[group[0]])
            found.append((_spot(search, beside, balls[group[0]], posterior, erring), erring))
        if all(spot.probability >= search.settings.possible for spot, _ in found):
            break
        # The others were judged beside one that is hardly there
        least = int(np.argmin([spot.probability for spot, _ in found]))
        found[least][1].note(slips)
        del groups[least]
    there = [balls[number] for group in groups for number in group]
    for one in presses:
        others = [press for press in presses if press is not one]
        odds = search.log_odds(_beside(search, others, there))
        rival = search.balls.some(np.array([np.argmax(np.where(search.balls.real, odds, -np.inf))]))
        erring = _erring(search, _beside(search, others, there, rival), rival)
        slips[one.number] = 0.0
        if one.number in [press.number for press in erring.presses]:
            erring.note(slips)
    return tuple(sorted((spot for spot, _ in found), key=lambda spot: -spot.probability)), slips


def _without_errors(
    search: BallSearch, presses: list[Balls], balls: list[Balls], slips: np.ndarray
) -> tuple[list[Balls], list[Balls]]:
    """Return presses that err, and balls, less those in whose place a few presses do better.

    Neighbours that both slipped look like a ball: one ball is likelier than an error of either.
    Their probability, against that ball, is written to `slips` (j,).
    """
    groups = _groups(search, balls)
    for group in groups:
        others = [balls[number] for other in groups if other is not group for number in other]
        beside = _beside(search, presses, others, balls[group[0]])
        erring = _erring(search, beside, balls[group[0]])
        if erring.log_odds > erring.ball:
            erring.note(slips)
            known = [press.number for press in presses]
            more = [press for press in erring.presses if press.number not in known]
            return _without_errors(search, [*presses, *more], others, slips)
    return presses, balls


@dataclass(frozen=True)
class _Erring:
    """The few presses that explain most by errors of their own, in place of a ball.

    `log_odds` are theirs together, `ball` those of the ball.
    """

    presses: list[Balls]
    log_odds: float
    ball: float

    def note(self, slips: np.ndarray) -> None:
        """Write their probability, against the ball and none, to slips (j,)."""
        number = [press.number for press in self.presses]
        slips[number] = np.exp(self.log_odds - _log_sum(np.array([self.log_odds, self.ball, 0.0])))


def _erring(search: BallSearch, beside: Beside, ball: Balls) -> _Erring:
    """Return the presses that may err in place of a ball, beside everything else."""
    every = search.balls
    own = np.flatnonzero(~every.real)
    odds = search.log_odds(beside)
    of_ball = _log_sum(odds[every.overlap(ball)])
    presses: list[Balls] = []
    total = [0.0]
    for _ in range(search.settings.neighbours):
        presses.append(every.some(own[[np.argmax(odds[own])]]))
        total.append(total[-1] + float(odds[own].max()))
        beside = search.added(beside, presses[-1])
        odds = search.log_odds(beside)
    best = int(np.argmax(total))
    return _Erring(presses[:best], total[best], of_ball)


def _beside(
    search: BallSearch, presses: list[Balls], balls: list[Balls], judged: Balls | None = None
) -> Beside:
    """Return everything beside presses that err and balls.

    A press that feels a judged ball is not known to err: one may do for the other.
    """
    if judged is not None and presses:
        together = search.instead(search.alone, Balls.joined([judged, *presses]))
        felt = np.abs(search.alike(together, 0))[1:] > search.settings.felt
        presses = [press for press, one in zip(presses, felt, strict=True) if not one]
    beside = search.alone
    for known in (*presses, *balls):
        beside = search.added(beside, known)
    return beside


def _added(search: BallSearch) -> list[Balls]:
    """Return balls and presses in the order in which they explain most; as many as are probable."""
    s, every = search.settings, search.balls
    own = np.flatnonzero(~every.real)
    beside, added, total = search.alone, [], [0.0]
    while len(added) < s.most + int(s.presses * len(own)):
        odds = search.log_odds(beside)
        total.append(total[-1] + _log_sum(odds))
        if int(np.argmax(total)) <= len(added) - s.patience:
            break
        best = every.some(np.array([np.argmax(np.where(every.real, odds, -np.inf))]))
        there = np.flatnonzero(every.overlap(best))
        if odds[own].max() > max(_log_sum(odds[there]), 0.0):
            best = every.some(own[[np.argmax(odds[own])]])
        elif not len(there):  # no ball would show
            break
        else:
            finer, _ = search.finer(beside, there)
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


def _spot(
    search: BallSearch, beside: Beside, ball: Balls, posterior: FieldPosterior, erring: _Erring
) -> Spot:
    """Judge a ball beside others; `erring` presses may do in its place."""
    s, balls, odds = search.settings, search.balls, search.log_odds(beside)
    best = int(np.argmax(np.where(balls.overlap(ball), odds, -np.inf)))
    alike = balls.real & (search.alike(beside, best) > s.alike)
    own = np.flatnonzero(alike | balls.overlap(balls.some(np.array([best]))))
    every = np.concatenate([odds[balls.real], [0.0], [erring.log_odds] * bool(erring.presses)])
    there = float(np.exp(_log_sum(odds[own]) - _log_sum(every)))
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
