"""Finite element models of the body, evaluated for a map and a changed body.

The finite element model gives C (j,) for a modulus field and dC_j/dE at its samples; a body effect
changes the field, the law, the support or the body's place (`BodyState`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fem import Contacts, PalpationModel, RefinedModel
from fem.reduced import ReducedBases
from identify.body.coarse_solutions import CoarseSolutions, keep, plain_state, solved_state
from identify.body.discretization_error import (
    ASSUMED,
    CarriedFine,
    FineModel,
    SupportError,
    TipPressure,
    fine_solution,
    mesh_error_growth,
    tip_pressure,
)
from identify.body.linear_ratio import LinearRatio
from identify.body.ratio_trend import RatioTrend
from identify.body.response import BESIDE_GROWTH, BodyResponse
from identify.body.shifted_block import Shift, ShiftedBlock, lagrange_weights
from identify.body.state import BodyState, ChangedMap
from identify.map.gaussian_map import GaussianMap
from identify.optimize.result import InadmissibleError

_KEPT_RATIOS = 32  # compliances of other models, of the last maps
_KEPT_LINEAR = 16  # linear ratios of other models, of 7 MB each: four models at work, four maps
_KEPT_FINE = 6  # solutions of the finer model that are carried, of 15 MB each, the last used
_KEPT_SIDES = 6  # bases of such models, and of blocks elsewhere
_SIDE_BYTES = 32e6  # of the energies of one
_KEPT_OTHERS = 4  # models of another Poisson's ratio, the last ones used: two are at work at a time


@dataclass(frozen=True)
class BodyMechanics(CoarseSolutions):
    """The finite element models behind a measurement model.

    Attributes
    ----------
    coarse, settings : see `CoarseSolutions`
    fine : finer model for the defect correction, or None
    at_poisson_ratio : builds the coarse model with another Poisson's ratio
    ratio : (j,) carries the coarse model's compliance to the finer one's (`corrected`)
    trend : how that follows the map, None where it is held
    support : what the coarse model makes too much or little of a support that gives way, at this
        estimate; None where it is firm
    model_error : (j,) the finer model's own relative error, as estimated
    tip : what the pressure under the tip depends on, at this estimate
    narrower : the same presses with narrower contacts, where the growth of a ball's contact is to
        follow the map; else it is that of `tip`
    carried : the correction to the finer model is carried from that of a map nearby
    """

    fine: FineModel | None
    at_poisson_ratio: Callable[[float], PalpationModel]
    ratio: np.ndarray | float = 1.0
    trend: RatioTrend | None = None
    support: SupportError | None = None
    model_error: np.ndarray | float = 0.0
    tip: TipPressure = ASSUMED
    carried: bool = False
    narrower: BodyMechanics | None = None
    _others: dict[float, PalpationModel] = field(default_factory=dict)
    _shifted: list[ShiftedBlock] = field(default_factory=list)  # one, once it is needed
    _ratios: dict[tuple, np.ndarray] = field(default_factory=dict)  # of the last maps
    _linear: dict[tuple, LinearRatio] = field(default_factory=dict)
    _fine: dict[tuple, CarriedFine] = field(default_factory=dict)
    _supports: list[SupportError] = field(default_factory=list)  # the last ones
    _elsewhere: list[tuple] = field(default_factory=list)  # corrections of the body elsewhere
    _sides: dict[Any, ReducedBases] = field(default_factory=dict)  # of other models, by name

    @classmethod
    def of(
        cls, coarse: PalpationModel, fine: FineModel | None = None, ratio: np.ndarray | float = 1.0
    ) -> BodyMechanics:
        """Return the mechanics with models of any other Poisson's ratio on the same mesh."""

        def at(nu: float) -> PalpationModel:
            return PalpationModel(coarse.mesh, nu, coarse.contacts, support=coarse.support)

        return cls(coarse, None if fine is coarse else fine, at, ratio)

    def under(self, contacts: Contacts) -> BodyMechanics:
        """Return the mechanics of other presses, without a finer model.

        Near fields of cells that lie alike under both are taken from these models.
        """
        coarse = self.coarse

        def at(nu: float) -> PalpationModel:
            like = self._others.get(nu)
            return PalpationModel(coarse.mesh, nu, contacts, support=coarse.support, like=like)

        other = BodyMechanics(coarse.on(coarse.mesh, contacts), None, at, settings=self.settings)
        other._shifted.append(ShiftedBlock(other.coarse, None, self.settings, self.shifted))
        return other

    def following_growth(self) -> BodyMechanics:
        """Return the mechanics in which the growth of a ball's contact follows the map.

        It costs a second model. With a growth that was held at that of another map, the fit of an
        organ went 2 cm astray: chi-square at a map 4 mm beside the truth was off by 34.
        """
        contacts = self.coarse.contacts
        if contacts.profile != "hertz":
            return self
        narrow = replace(contacts, radius_m=self.settings.narrower * contacts.radius_m)
        return replace(self, narrower=self.under(narrow))

    def sharing(self, other: BodyMechanics) -> BodyMechanics:
        """Return the mechanics with the solutions and bases of another one of this coarse model."""
        if other.coarse is not self.coarse:
            return self
        own = {"_solutions": other._solutions, "_bases": other._bases}
        return replace(self, narrower=other.narrower or self.narrower, **own)

    @cached_property
    def local_points(self) -> np.ndarray:
        """Points of the local modulus under each tip, (j, 3) m."""
        contacts = self.coarse.contacts
        # The growth of a ball's contact begins at the surface
        share = 0.0 if contacts.profile == "hertz" else self.settings.local_depth
        return contacts.points_m + share * contacts.radius_m[:, None] * contacts.directions

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio of the models."""
        return self.coarse.stiffness.poisson_ratio

    def state(self) -> BodyState:
        """Return the state without effects."""
        low, high = self.coarse.mesh.box_m.tolist()
        return BodyState((tuple(low), tuple(high)), self.poisson_ratio)

    def evaluate(
        self, stiffness: GaussianMap, state: BodyState, slack: float = 0.0
    ) -> BodyResponse:
        """Solve for a map and a state.

        Parameters
        ----------
        slack : factor on `reduced_error` and `ratio_error`, within which reduced bases and ratios
            carried from other maps will do; 0 for the full model, with carried ratios alone

        Raises
        ------
        InadmissibleError
            The modulus is not positive everywhere.
        """
        if slack:
            response = self._found(stiffness, state, slack)
        else:
            response = self._solved(stiffness, state)
        factor = self.ratio * (1 + state.mesh_error_share * self.model_error)
        factor = factor * (1 - state.rigid_tip_share * self.tip.gain)
        factor = factor * np.ones(len(self.coarse.contacts))
        if self.trend is not None and self.trend.follows(stiffness):
            factor *= np.exp(self.trend.log_change(stiffness))
        if self.support is not None and any(_base(state)):
            firm = state.changed(base_normal_m_per_pa=0.0, base_tangential_m_per_pa=0.0)
            alone = self._found(stiffness, firm, slack) if slack else self._solved(stiffness, firm)
            effect = np.log(response.compliance / alone.compliance)
            factor *= np.exp(self.support.of(effect))
        if state.poisson_ratio != self.poisson_ratio:
            nu = state.poisson_ratio
            factor = factor * self.poisson_factor(stiffness, state, nu, response.compliance, slack)
        if any(state.shift_m):
            base = response.compliance
            straight = slack >= self.settings.straight_slack
            moved = self.log_shift_factor(stiffness, state, state.shift_m, base, straight, slack)
            factor *= np.exp(moved)
        changed = ChangedMap(stiffness, state)
        return BodyResponse(
            compliance=factor * response.compliance,
            local_modulus=changed.modulus(self.local_points),
            local_by_map=changed.gradient(self.local_points),
            _mechanics=self,
            _map=stiffness,
            _state=state,
            _response=response,
            _scale=factor,
            _slack=slack,
            _narrower=self._under_narrower(stiffness, state, slack),
        )

    def _under_narrower(
        self, stiffness: GaussianMap, state: BodyState, slack: float
    ) -> BodyResponse | None:
        if self.narrower is None:
            return None
        plain = self.state()
        like = state.changed(**{name: getattr(plain, name) for name in BESIDE_GROWTH})
        return self.narrower.evaluate(stiffness, like, slack)

    def corrected(
        self, stiffness: GaussianMap, state: BodyState, slack: float = 0.0
    ) -> BodyMechanics:
        """Return the mechanics with the coarse model carried to the finer one at this estimate.

        Fibres and skin are left out: their effect differs little between the meshes.

        Parameters
        ----------
        slack : factor on `ratio_error`, within which the correction of a map nearby will do; 0 for
            a correction at this one
        """
        plain = BodyState(state.box_m, self.poisson_ratio, *state.modulus_changes)
        if self.fine is None:
            coarse = self._solved(stiffness, plain)
            return replace(self, tip=tip_pressure(coarse, ChangedMap(stiffness, plain)))
        shift = self.shifted.near(state.shift_m)
        own = self._corrected_firm(shift, stiffness, plain, slack)
        if any(shift) or not any(_base(state)):
            return own
        return replace(own, support=own._support_error(_base(state), stiffness, plain, slack))

    def counts_support(self, state: BodyState) -> bool:
        """Return whether the correction counts a base that gives way as in the state."""
        return self.fine is None or self.support is not None or not any(_base(state))

    def _support_error(
        self, base: tuple[float, float], stiffness: GaussianMap, plain: BodyState, slack: float
    ) -> SupportError:
        """Return the error of a support that gives way, beside the corrected firm one.

        On cells of 12 mm the effect of a base that lets a block of 32 mm slide is 27 % too large.
        """
        for known in reversed(self._supports if slack else []):
            if known.serves(np.array(base), self.settings.near_support):
                return known
        giving = plain.changed(base_normal_m_per_pa=base[0], base_tangential_m_per_pa=base[1])
        firm, soft = (
            (self._found(stiffness, s, slack) if slack else self._solved(stiffness, s)).compliance
            for s in (plain, giving)
        )
        assert self.fine is not None
        changed = ChangedMap(stiffness, giving)
        fine = fine_solution(self.fine, changed, self.coarse, soft, self.settings, base)
        log_ratio = np.log(fine.compliance / soft / self.ratio)
        own = SupportError(np.array(base), np.log(soft / firm), log_ratio)
        self._supports.append(own)
        del self._supports[:-_KEPT_FINE]
        return own

    def _corrected_firm(
        self, shift: Shift, stiffness: GaussianMap, plain: BodyState, slack: float
    ) -> BodyMechanics:
        """`corrected` on the model's own support."""
        assert self.fine is not None
        changed = ChangedMap(stiffness, plain)
        if any(shift):
            return self._corrected_elsewhere(shift, stiffness, plain, slack)
        self.shifted.forget_fine()
        if slack and self._fine:
            compliance = self._found(stiffness, plain, slack).compliance
            for key, known in reversed(self._fine.items()):
                at = known.at(self.fine, changed, self.coarse, compliance, slack, self.settings)
                if at is not None:
                    keep(self._fine, key, known, _KEPT_FINE)
                    same = known.trend.follows(stiffness)
                    trend = known.trend.around(stiffness) if same else None
                    return self._with_ratio(at[0] / compliance, at[1], known.tip, trend, True)
        coarse = self._solved(stiffness, plain)
        fine = fine_solution(self.fine, changed, self.coarse, coarse.compliance, self.settings)
        tip = tip_pressure(fine.response, changed)
        trend = None
        if isinstance(stiffness, GaussianMap):
            ratio = LinearRatio.of(coarse, fine.response, changed)
            added = self.fine.added_share if isinstance(self.fine, RefinedModel) else 0.0
            trend = RatioTrend.of(coarse, fine.response, fine.compliance, added, changed)
            carries = CarriedFine(ratio, fine.response.unevenness, tip, trend)
            keep(self._fine, (stiffness, plain), carries, _KEPT_FINE)
        return self._with_ratio(fine.compliance / coarse.compliance, fine.error, tip, trend)

    def _corrected_elsewhere(
        self, shift: Shift, stiffness: GaussianMap, plain: BodyState, slack: float
    ) -> BodyMechanics:
        """`corrected` of a body elsewhere, whose finer model is made for that place.

        Making it costs as much as thirty solutions, so that a search takes the correction of a
        place and a map nearby.
        """
        found = self._found(stiffness, plain, slack) if slack else self._solved(stiffness, plain)
        coarse = found.compliance
        wide = min(max(slack, 1.0), self.settings.carried_slack)
        reach, grown = wide * self.settings.carried_shift_m, wide * self.settings.carried_change
        for place, known, corrected in reversed(self._elsewhere if slack else []):
            apart = np.abs(np.subtract(place, shift)).max()
            if apart <= reach and np.abs(np.log(coarse / known)).max() <= grown:
                return self._with_ratio(*corrected, carried=True)
        there, finer = self.shifted.fine_at(shift)
        changed = ChangedMap(stiffness, plain)
        known = self._solve(there, stiffness, plain).compliance
        fine = fine_solution(finer, changed, there, known, self.settings)
        factor = np.exp(self.log_shift_factor(stiffness, plain, shift, coarse, slack=slack))
        corrected = (
            fine.compliance / (coarse * factor),
            fine.error,
            tip_pressure(fine.response, changed),
        )
        self._elsewhere.append((shift, coarse, corrected))
        del self._elsewhere[:-_KEPT_FINE]
        return self._with_ratio(*corrected)

    def _with_ratio(
        self,
        ratio: np.ndarray,
        error: np.ndarray,
        tip: TipPressure,
        trend: RatioTrend | None = None,
        carried: bool = False,
    ) -> BodyMechanics:
        """Return the mechanics with another correction (j,), its own error (j,) and tip."""
        kept = np.clip(ratio, *self.settings.believed_ratio)
        return replace(
            self,
            ratio=kept,
            trend=trend,
            support=None,
            model_error=error + (kept - ratio) / kept,
            tip=tip,
            carried=carried,
        )

    def poisson_factor(
        self,
        stiffness: GaussianMap,
        state: BodyState,
        nu: float,
        base: np.ndarray,
        slack: float = 0.0,
    ) -> np.ndarray:
        """Compliance (j,) at another Poisson's ratio over that at the model's own.

        `base` (j,) is the coarse model's there; the factor holds for a compliance times `ratio`.
        """
        if nu == self.poisson_ratio:
            return np.ones(len(self.coarse.contacts))
        if not -1 < nu < 0.5:
            raise InadmissibleError(f"Poisson's ratio must lie between -1 and 0.5, not {nu:.4g}")
        nodes = np.array(self.settings.poisson_ratios)
        others = nodes[np.abs(nodes - self.poisson_ratio) > 1e-6]
        nearest = others[np.argsort(np.abs(others - nu))[:2]]
        weights = lagrange_weights(nu, np.array([self.poisson_ratio, *nearest]))[1:]
        log = np.zeros(len(base))
        for node, weight in zip(nearest.tolist(), weights.tolist(), strict=True):
            if abs(weight) > 1e-9:  # else the ratio is that of the other node
                log += weight * self._log_ratio(
                    node, lambda node=node: self._other(node), stiffness, state, base, slack
                )
        coarse = np.exp(log)
        growth = mesh_error_growth(nu, self.poisson_ratio, self.settings)
        return coarse * self.ratio ** (growth - 1)

    def forget_others(self) -> None:
        """Free the models of other Poisson's ratios and of other places."""
        self._others.clear()
        self._sides.clear()
        self._linear.clear()
        self._shifted.clear()

    def _other(self, nu: float) -> PalpationModel:
        model = self._others.get(nu) or self.at_poisson_ratio(nu)
        keep(self._others, nu, model, _KEPT_OTHERS)
        return model

    def log_shift_factor(
        self,
        stiffness: GaussianMap,
        state: BodyState,
        shift_m: Shift,
        base: np.ndarray,
        straight: bool = False,
        slack: float = 0.0,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of the body elsewhere over that at its stated place.

        `base` (j,) is the coarse model's there; `straight` see `ShiftedBlock.log_factor`.
        """
        shifted = self.shifted

        def log_ratio(place: Shift) -> np.ndarray:
            return self._log_ratio(
                place, lambda: shifted.coarse_at(place), stiffness, state, base, slack
            )

        return shifted.log_factor(shift_m, straight, log_ratio)

    @property
    def shifted(self) -> ShiftedBlock:
        """The models of the body elsewhere."""
        if not self._shifted:
            self._shifted.append(ShiftedBlock(self.coarse, self.fine, self.settings))
        return self._shifted[0]

    def _log_ratio(
        self,
        which: float | Shift,
        model: Callable[[], PalpationModel],
        stiffness: GaussianMap,
        state: BodyState,
        base: np.ndarray,
        slack: float = 0.0,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of another model over `base`.

        Kept by its name; near the map of its last solution linear in the modulus. With much slack,
        that of a body without fibres, skin and springs: they change the ratio little, and it need
        not be made anew for each of their values.
        """
        plain = plain_state(state)
        if slack >= self.settings.plain_slack and solved_state(state) != plain:
            base = self._found(stiffness, plain, slack).compliance
            return self._log_ratio(which, model, stiffness, plain, base, slack)
        key = (which, stiffness, solved_state(state), max(slack, 1.0))
        if key in self._ratios:
            return self._ratios[key]
        changed = ChangedMap(stiffness, state)
        kind = (which, solved_state(state).without_modulus_changes)
        tolerance = self.settings.ratio_error * max(slack, 1.0)
        for name, linear in reversed(self._linear.items()):
            if name[:2] == kind:
                near = linear.log_at(changed, base, tolerance)
                if near is not None:
                    keep(self._linear, name, linear, _KEPT_LINEAR)
                    return near
        if slack > 1 and self._is_reducible(stiffness, state):
            if which not in self._sides:
                keep(self._sides, which, ReducedBases(model(), 1, _SIDE_BYTES), _KEPT_SIDES)
            other = self._reduced(self._sides[which], stiffness, state, tolerance)
        else:
            other = self._solve(model(), stiffness, state)
            linear = LinearRatio.of(self._solved(stiffness, state), other, changed)
            keep(self._linear, (*kind, stiffness), linear, _KEPT_LINEAR)
        ratio = other.compliance / base
        if not (np.isfinite(ratio).all() and ratio.min() > 0):
            raise InadmissibleError("the map is finer than the mesh of the body resolves")
        keep(self._ratios, key, np.log(ratio), _KEPT_RATIOS)
        return np.log(ratio)


def _base(state: BodyState) -> tuple[float, float]:
    """Compliance of the base, m/Pa, across and along."""
    return state.base_normal_m_per_pa, state.base_tangential_m_per_pa
