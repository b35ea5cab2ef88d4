"""The record of a free map beside its most probable field: prior, precision, sight, finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from identify.fit.free_map.areas import Area, find_areas
from identify.fit.free_map.ball_search import BallSearch, share_inside
from identify.fit.free_map.field_evidence import Hyper
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.outline import beyond_presses
from identify.fit.free_map.settings import SPOTS
from identify.fit.free_map.spots import Spot, find_spots
from identify.map import LabelledGrid
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel

LEVEL = "mean_pa"  # the parameter of a free map that tables show


@dataclass(frozen=True)
class RegionEstimate:
    """Modulus of a labelled region, its geometric mean, Pa, with its 95 % band.

    `seen` is the share of the prior's variance of that mean that the readings take away.
    """

    label: int
    modulus_pa: float
    lower95_pa: float
    upper95_pa: float
    seen: float


class Finds(NamedTuple):
    """Finds of a search for balls and areas in a field.

    Attributes
    ----------
    spots, slips, sight_m, areas : see `Field`, whose `ball_sight_m` is the third
    """

    spots: tuple[Spot, ...] = ()
    slips: np.ndarray = np.zeros(0)
    sight_m: float = 0.0
    areas: tuple[Area, ...] = ()


@dataclass(frozen=True, eq=False)
class Field:
    """A free map's prior and posterior.

    Attributes
    ----------
    hyper : length and spread of the prior, relative error of the map in each press's compliance
        that the readings ask for; 0 where their noise suffices
    log_evidence : of the readings around the estimate, over that of noise alone
    effective : effective number of the field's parameters
    log_mean, log_mean_sd : mean of ln E (E in Pa) over the seen part of the grid, its standard
        deviation
    log_sd : (g,) standard deviation of ln E
    share : (g,) share of the prior's variance about its level that the readings take away
    sight_m : depth under the tips down to which that share is at least `SpotSettings.seen`, the
        middle one of all presses
    by_press_m : (m,) change of each predicted displacement by s, ln C of its press, m
    followed : (j, k) directions of s that the field can follow
    press_error : (j,) error of each press's compliance by the map, relative: what its readings,
        beside the effects, ask the map to change by
    left_out : (j,) the same of a map that has not seen the press, nor the others of its fifth
    errs : (j,) bool, presses with errors of their own, weighted down
    lengths_m : least and largest length that was tried
    regions : of a map with labelled regions
    sought : finds balls and areas when they are first asked for: it takes as long as a step of the
        fit
    posterior : for draws and resolution; both only of a fit that was made here
    """

    hyper: Hyper
    log_evidence: float
    effective: float
    log_mean: float
    log_mean_sd: float
    log_sd: np.ndarray
    share: np.ndarray
    sight_m: float
    by_press_m: np.ndarray
    followed: np.ndarray
    press_error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left_out: np.ndarray = field(default_factory=lambda: np.zeros(0))
    errs: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    lengths_m: tuple[float, float] = (0.0, 0.0)
    regions: tuple[RegionEstimate, ...] = ()
    sought: Callable[[], Finds] = Finds
    posterior: FieldPosterior | None = None

    @classmethod
    def of(
        cls,
        posterior: FieldPosterior,
        estimate: np.ndarray,
        hyper: Hyper,
        log_prior_mean: float,
        model: MeasurementModel,
        at: Linearised,
        least: float,
        converged: bool,
        press_error: np.ndarray,
        errs: np.ndarray,
        lengths_m: tuple[float, float],
    ) -> Field:
        """Gather the record from a posterior.

        Parameters
        ----------
        estimate : (g,) field where the search ended. Where the readings hardly tell a depth, the
            posterior's mean lies far from it for the last hundredth of a percent, to which the
            readings are not linear: of an even body it was off by a factor of 2.5, this by 3 %
        log_prior_mean : ln of the modulus in Pa that the field is counted from
        model, at : the model at the estimate
        least : variance over the noise's from which on a direction counts as absorbed
        converged : spots of another field are none
        """
        inside = in_sight(posterior.share)
        sd, _ = _mean_told(posterior, inside)
        directions, gain = posterior.modes
        even = model.unit_compliance
        log_felt = None if even is None else np.log(even / at.body.compliance)
        return cls(
            hyper=hyper,
            log_evidence=posterior.log_evidence,
            effective=posterior.effective,
            log_mean=log_prior_mean + float(estimate[inside].mean()),
            log_mean_sd=sd,
            log_sd=posterior.sd,
            share=posterior.share,
            sight_m=_sight_m(posterior, model),
            press_error=press_error,
            left_out=posterior.left_out(fifths(len(press_error))),
            errs=errs,
            lengths_m=lengths_m,
            regions=tuple(_regions(posterior, log_prior_mean + estimate)),
            by_press_m=model.by_log_compliance(at),
            followed=directions[:, gain > least],
            sought=partial(_finds, posterior, log_felt, hyper, lengths_m[1], model, converged),
            posterior=posterior,
        )

    @cached_property
    def _finds(self) -> Finds:
        return self.sought()

    @property
    def spots(self) -> tuple[Spot, ...]:
        """Places harder or softer than their surroundings."""
        return self._finds.spots

    @property
    def areas(self) -> tuple[Area, ...]:
        """Areas whose presses feel a harder or softer body than the others."""
        return self._finds.areas

    @property
    def slips(self) -> np.ndarray:
        """Probability (j,) that a press slipped, against a ball under it and none."""
        return self._finds.slips

    @property
    def ball_sight_m(self) -> float:
        """Depth under the middle press down to which the readings would show a ball, 0 if at none.

        A ball of `SpotSettings.ball_m`, by `SpotSettings.sure` standard deviations.
        """
        return self._finds.sight_m

    @property
    def slipped(self) -> np.ndarray:
        """Presses that are offered as slipped, (j,) bool."""
        return self.slips >= SPOTS.probable

    @property
    def ordinary_error(self) -> float:
        """Relative error of the map in an ordinary press: the median of all presses."""
        return float(np.median(np.abs(self.press_error)))

    @property
    def left_out_error(self) -> float:
        """The same of presses left out: the median of all."""
        return float(np.median(np.abs(self.left_out)))

    def draws(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random changes (count, g) of ln E from the map, as probable as its readings say.

        `fit.map.log_pa + fit.field.draws(np.random.default_rng(0), 100)` are a hundred maps.

        Raises
        ------
        ValueError
            The map was read from a file, which holds no posterior.
        """
        if self.posterior is None:
            raise ValueError("this map was read from a file: draws need a fit that was made here")
        return self.posterior.draws(rng, count) - self.posterior.mean

    def absorbed_m(self, press: np.ndarray) -> np.ndarray:
        """Return the changes (m, k) m of predicted displacements that the field can follow.

        With an error of the map, which every press has for itself, these are all compliances.
        `press` (m,) is the press of each reading.
        """
        if self.hyper.error > 0:
            return self.by_press_m[:, None] * (press[:, None] == np.arange(press.max() + 1))
        return self.by_press_m[:, None] * self.followed[press]


def _finds(
    posterior: FieldPosterior,
    log_felt: np.ndarray | None,
    hyper: Hyper,
    longest_m: float,
    model: MeasurementModel,
    converged: bool,
) -> Finds:
    search, readings = BallSearch(posterior, hyper, longest_m), model.readings
    spots, slips, areas = (), np.zeros(readings.presses), ()
    pressed_m, across = model.mechanics.contacts.points_m, readings.scales.across
    if converged:
        spots, slips = find_spots(search, posterior)
        centres = np.array([(s.x_m, s.y_m, s.z_m) for s in spots]).reshape(-1, 3)
        beyond = beyond_presses(centres, pressed_m, across).tolist()
        spots = tuple(
            replace(s, at_rim=d + s.diameter_m / 2 > 0) for s, d in zip(spots, beyond, strict=True)
        )
        if log_felt is not None:
            tip_m = readings.radius_m[readings.first]
            areas = find_areas(posterior, log_felt, pressed_m, tip_m, across)
    return Finds(spots, slips, _ball_sight_m(search, model), areas)


def in_sight(share: np.ndarray) -> np.ndarray:
    """Part of the grid in sight (g,) bool by the share seen (g,), or all of it where nothing is."""
    seen = share >= SPOTS.seen
    return seen if seen.any() else np.ones_like(seen)


def _mean_told(posterior: FieldPosterior, inside: np.ndarray) -> tuple[float, float]:
    """Return the standard deviation of a field's mean over points (g,) bool; the share seen."""
    even = (inside / inside.sum())[None]
    prior = float((posterior.prior.product(even) @ even.T).item())
    seen = float(np.sum((posterior.seen @ even[0]) ** 2))
    untold = float(np.sum((posterior.untold @ even[0]) ** 2))
    return float(np.sqrt(max(prior - seen, 0.0) + untold)), seen / prior


def _regions(posterior: FieldPosterior, log_pa: np.ndarray) -> Iterator[RegionEstimate]:
    grid = posterior.prior.grid
    if not isinstance(grid, LabelledGrid):
        return
    for label in np.unique(grid.labels).tolist():
        inside = grid.labels == label
        sd, seen = _mean_told(posterior, inside)
        mean = float(log_pa[inside].mean())
        low, middle, high = np.exp(mean + 1.96 * sd * np.array([-1, 0, 1]))
        yield RegionEstimate(label, float(middle), float(low), float(high), seen)


def fifths(presses: int) -> np.ndarray:
    """Return the fifth (j,) of each press, at random but always the same."""
    return np.random.default_rng(31).permutation(presses) % 5


def _ball_sight_m(search: BallSearch, model: MeasurementModel) -> float:
    """Depth, m, of the deepest ball that the readings would show."""
    contacts, grid = model.mechanics.coarse.contacts, search.grid
    low, high = model.mechanics.coarse.mesh.box_m
    away = np.linalg.norm(contacts.points_m - contacts.points_m.mean(axis=0), axis=1)
    middle, step, found = int(np.argmin(away)), min(grid.spacing_m) / 2, 0.0
    radius = SPOTS.ball_m / 2
    for depth in np.arange(radius, float(np.linalg.norm(high - low)), step).tolist():
        centre = contacts.points_m[middle] + depth * contacts.directions[middle]
        if np.any(centre < low) or np.any(centre > high):
            break
        ball = share_inside(grid, centre[None], np.array([radius])).toarray()[:, 0]
        if search.shown_by(np.log(SPOTS.ball_contrast) * ball) < SPOTS.sure:
            break
        found = depth
    return found


def _sight_m(posterior: FieldPosterior, model: MeasurementModel) -> float:
    """Depth of sight of the middle press, m."""
    contacts, grid = model.mechanics.coarse.contacts, posterior.prior.grid
    low, high = model.mechanics.coarse.mesh.box_m
    step = min(grid.spacing_m) / 2
    depths = step * np.arange(1, round(float(np.linalg.norm(high - low)) / step) + 1)
    seen = np.ones(len(contacts), dtype=bool)
    found = np.zeros(len(contacts))
    for depth in depths.tolist():
        points = contacts.points_m + depth * contacts.directions
        seen &= ((points >= low - 1e-9) & (points <= high + 1e-9)).all(axis=1)
        seen &= grid.weights(points) @ posterior.share >= SPOTS.seen
        if not seen.any():
            break
        found[seen] = depth
    return float(np.median(found))
