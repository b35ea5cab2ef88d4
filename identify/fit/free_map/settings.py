"""Tuning numbers of a free map."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FreeMapSettings:
    """Settings of the free map (`identify.fit.free_map_fit`).

    Attributes
    ----------
    grid_points : of the field, about
    level_spread : standard deviation of the logarithm of the map's level, before any reading
    layer_spread, layer_length : standard deviation of the logarithm of layers, and their thickness
        in the body's height; not found by evidence. Without them an even scan of a body with a soft
        layer gave a map that claimed to see it all, and held nowhere; more of them explain a steep
        wall too well
    untold_layer_spread : standard deviation of further layers, which the bands count: without them
        they held in 50, 75 and 77 % of the seen points of three in sixteen bodies with a layer
    gradual_layer_spread : of the prior for gradual changes, all layers
    finest : least length of the prior, in spacings of the grid: a shorter one is no field there
    finest_cell : ... and in the size of the finite elements' cells, whose samples see the map
    longest : largest length, in the largest edge of the body
    smoothest : largest length that evidence may find, in that one. Under one tip readings around a
        single inclusion seem to speak for a field of nearly the body's length, in which layers far
        below explain it: two of five scans had 85 and 93 % of what they claimed to see in its bands
    first_length, first_spread, first_error : before any evidence; the length in the body's least
        edge
    least_spread, largest_spread : bounds of the logarithm's spread. An even surface does not make
        the depth even: the least is what is thought possible below the depth of sight
    least_error, largest_error : bounds of the map's own relative error; the least counts as none
    evidence_presses : presses from which the prior's numbers are found
    lengths, length_tol : trials of a length, and the difference of logarithms that ends them
    size_steps : steps towards spread and error of a trial
    evidence_rounds : iterations in which the prior's numbers are sought
    longest_change : of the logarithm of such a number in a round
    iterations : of Gauss-Newton
    rough_steps : after the evidence, of a fit without effects that are known to be missing
    usual_length, usual_spread, usual_error : middle of the wide priors of length (over the middle
        of its bounds), spread and error
    unsure : their standard deviations, of logarithms
    nearing : share of the presses' present misfit that counts as error of the map, so that a
        step follows no press further than a linear model holds
    tail, early_tail : standard deviations from which on a press has an error of its own, and draws
        no stronger, and the same while the prior's numbers are sought
    bent : chi-square per reading beyond the noise's at which a press counts half: the model bends
        its curve wrongly. As for the presses on their own
    longest_move : of ln C from where the readings are linear
    own_steps : Newton steps of each press's compliance beside the map
    slowed, slowest : factor of the steps after one that is hardly shorter than the last, and the
        least share of a step
    falls_short, as_promised : shares of what a step promises to shorten the next one by, below and
        above which the steps become shorter and longer
    longest_step : largest change of the map's logarithm in one
    least_damping, most_damping, damped, more_damped : least and most damping of a step, counted in
        the prior's precision, the factor by which it grows where a step does not lower the misfit,
        and what that factor itself grows by with each further trial (Nielsen, IMM-REP-1999-05)
    shorter, shortest : factor of a step after one that did not lower the misfit under most damping,
        and the share of a step that ends the search
    worse : tolerated relative rise of the misfit in a step
    settled : change of the presses' compliances, in their standard deviations (the 95th percentile
        over that of a normal one), that ends the search; the last presses may be on a lump so hard
        that its modulus is open
    unfelt : the same change, below which a search has ended, too, where no step lowers the misfit:
        the presses do not feel it. One that asked for 1.1, and for 2.1 standard deviations of the
        map, was called converged
    near : largest change of the logarithm from which on the finer model corrects each step
    absorbed : variance over the noise's from which on the field counts as following a direction
        of the readings
    """

    grid_points: int = 6000
    level_spread: float = 2.0
    layer_spread: float = 0.5
    untold_layer_spread: float = 0.5
    gradual_layer_spread: float = 1.0
    layer_length: float = 0.2
    finest: float = 1.5
    finest_cell: float = 0.5
    longest: float = 1.0
    smoothest: float = 0.3
    first_length: float = 0.4
    first_spread: float = 0.5
    first_error: float = 0.01
    least_spread: float = 0.5
    largest_spread: float = 1.5
    least_error: float = 1e-4
    largest_error: float = 1.0
    usual_length: float = 0.7
    usual_spread: float = 0.7
    usual_error: float = 0.01
    unsure: tuple[float, float, float] = (0.7, 0.5, 1.5)
    nearing: float = 0.3
    tail: float = 3.0
    early_tail: float = 10.0
    bent: float = 4.0
    longest_move: float = 0.5
    own_steps: int = 2
    slowed: float = 0.6
    slowest: float = 0.2
    falls_short: float = 0.2
    as_promised: float = 0.8
    evidence_presses: int = 150
    lengths: int = 6
    length_tol: float = 0.1
    size_steps: int = 30
    evidence_rounds: int = 4
    longest_change: float = 0.7
    iterations: int = 20
    rough_steps: int = 3
    longest_step: float = 1.5
    least_damping: float = 0.01
    most_damping: float = 30.0
    damped: float = 4.0
    more_damped: float = 2.0
    shorter: float = 0.4
    shortest: float = 0.01
    worse: float = 1e-3
    settled: float = 0.15
    unfelt: float = 1.0
    near: float = 1.0
    absorbed: float = 0.05


FREE_MAP = FreeMapSettings()


@dataclass(frozen=True)
class SpotSettings:
    """Settings of the spots and areas of a free map (`identify.fit.free_map.spots`).

    Attributes
    ----------
    seen : share of the prior's variance that the readings take away where a place counts as seen
    growth : ratio of a ball's radius to that of the next smaller one; the least is the grid's
        spacing
    largest_radius : ... and the largest in the body's width
    at_largest : exponent of that ratio, counted from the largest ball, from which on an interval
        of the radius ends with the balls that were tried; the largest that is made finer has 0.5
    apart : distance of balls of a radius, in it
    expected : balls that are expected in a body before any reading, among those that may show
    kinds : standard deviation of the change of ln E, and share, of two kinds of balls: of other
        tissue, and as good as rigid or as holes. A rough field explains the second kind as well as
        a ball does, if it is thought improbable
    slip, slips : change of ln C by a press's own error, where a ball changes ln E by 1, and presses
        of a scan that are expected to have one
    shows : standard deviations of the readings' noise from which on a ball may show
    scales : of the prior's spread and of the map's error, those that were fitted being 1
    longer : exponents of the way from the prior's length to the longest
    most, presses : balls that are added, and share of the presses that may have slipped
    neighbours : presses that are tried together in place of a ball; more can be as a ball is
    patience : the most in turn that do not raise the log evidence
    alike : cosine of the patterns of two balls from which on they are one spot
    felt : cosine of the patterns of a ball and of a press that errs from which on one may do for
        the other
    splits, most_splits, enough, kept : least and most times that the lattice is made finer for a
        spot, the effective number of parts that ends it, and most balls that are split
    unlikely : how far below the largest the log evidence of a prior may be that is kept for that
    draws : of a ball, its radius and contrast
    ball_m, ball_contrast, sure : diameter and contrast of the ball whose depth of sight is told,
        and standard deviations of the readings from which on it is seen
    possible, probable : probability from which on a spot is listed, and offered
    area_draws, area_confidence : draws of the field by which areas are judged
        (`identify.fit.free_map.areas`), and the share of them in which no press may lie beyond
    area_presses, area_place, area_reach : presses of an area, at least; distance of two places, in
        tip radii, at least; and of neighbours, in the distance of places
    area_edge : difference at the edge of an area, in that of its middle
    area_least : change of ln E that an area is felt by, at least: beside the sides of a block a
        layer is felt by 2 % otherwise than in the middle
    explained : chi-square per degree of freedom up to which these probabilities are trusted
    """

    seen: float = 0.5
    growth: float = 1.5
    largest_radius: float = 0.2
    at_largest: float = 0.4
    apart: float = 0.7
    expected: float = 1.0
    kinds: tuple[tuple[float, float], ...] = ((1.2, 0.8), (2.0, 0.2))
    slip: float = 0.15
    slips: float = 0.2
    shows: float = 3.0
    scales: tuple[float, ...] = (2.0, 1.0, 0.5, 0.2, 0.0)
    longer: tuple[float, ...] = (0.5, 1.0)
    most: int = 8
    presses: float = 0.2
    neighbours: int = 2
    patience: int = 2
    alike: float = 0.6
    felt: float = 0.3
    splits: int = 2
    most_splits: int = 5
    enough: float = 30.0
    kept: int = 300
    unlikely: float = 10.0
    draws: int = 2000
    ball_m: float = 0.01
    ball_contrast: float = 3.0
    sure: float = 7.0
    possible: float = 0.5
    probable: float = 0.95
    area_draws: int = 400
    area_confidence: float = 0.95
    area_presses: int = 3
    area_place: float = 0.2
    area_reach: float = 1.6
    area_edge: float = 0.5
    area_least: float = 0.03
    explained: float = 2.0


SPOTS = SpotSettings()
