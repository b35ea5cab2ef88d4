"""Response of a body to all presses: compliances, derivatives, and changes of first order.

The sensitivities of one solution give small changes of a state to first order, enough for a score
test; a fit evaluates the changed state itself (`BodyMechanics`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fem import Mesh, PalpationModel
from fem.palpation import Response
from fem.reduced import ReducedResponse
from identify.body.shifted_block import Shift
from identify.body.state import BodyState, ChangedMap, fibres_of
from identify.map import FreeMap, GaussianMap

if TYPE_CHECKING:
    from identify.body.mechanics import BodyMechanics


BESIDE_GROWTH = ("poisson_ratio", "shift_m", "mesh_error_share", "rigid_tip_share")
"""Parts of a state that leave the growth of a ball's contact nearly as it is."""


@dataclass(frozen=True)
class BodyResponse:
    """Compliances of the j presses for a map of k parameters and a state.

    Attributes
    ----------
    compliance : (j,) m/N
    local_modulus : (j,) Young's modulus under each tip, Pa
    local_by_map : (j, k)
    """

    compliance: np.ndarray
    local_modulus: np.ndarray
    local_by_map: np.ndarray
    _mechanics: BodyMechanics
    _map: GaussianMap
    _state: BodyState
    _response: Response | ReducedResponse
    _scale: np.ndarray  # (j,) factor on the finite elements' own compliance
    _slack: float  # of the search that asked, see `BodyMechanics.evaluate`
    _narrower: BodyResponse | None = None  # under narrower contacts, of balls
    _exact: dict[BodyState, tuple[float, np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def mechanics(self) -> BodyMechanics:
        """The mechanics that solved."""
        return self._mechanics

    def serves(self, stiffness: GaussianMap, state: BodyState, slack: float) -> bool:
        """Return True for the map and state that were solved, as exactly as asked."""
        same = stiffness is self._map or stiffness == self._map
        return same and state == self._state and self._slack <= slack

    @cached_property
    def by_map(self) -> np.ndarray:
        """Derivative of the compliance by the map's parameters, in their units, (j, k)."""
        by_map, trend = self._log_by_map, self._mechanics.correction.trend
        if trend is not None and trend.follows(self._map):
            by_map = by_map + trend.by_map(self._map)
        return self.compliance[:, None] * by_map

    @cached_property
    def _log_by_map(self) -> np.ndarray:
        """Derivative (j, k) of the logarithm of the finite elements' own compliance."""
        points = self._mechanics.coarse.points_m
        gradient = ChangedMap(self._map, self._state).gradient(points)
        own = _gradient(self._near, gradient, self._state)
        return (self._scale / self.compliance)[:, None] * own

    @cached_property
    def growth(self) -> np.ndarray | None:
        """(a/C) dC/da (j,) of a ball's contact, None where the mechanics does not follow it.

        The law of `identify.effects.sphere` through the compliances of two contacts.
        """
        if self._narrower is None:
            return None
        own, nu = self._mechanics, self._mechanics.poisson_ratio
        unit = 0.6 * (1 - nu**2) / (self.local_modulus * own.coarse.contacts.radius_m)
        here = np.log(unit / self._response.compliance)
        beside = np.log(unit / own.settings.narrower / self._narrower.compliance)
        return -1 + self._by_levels(here, beside)

    def _by_levels(self, here: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """Growth beyond -1 by the levels ln(0.6/(E* a C)) of both contacts; it is linear."""
        narrower = self._mechanics.settings.narrower
        return -here - (beside / narrower - here) / (narrower - 1)

    @cached_property
    def growth_by_map(self) -> np.ndarray:
        """Derivative of `growth` by the map's parameters, (j, k)."""
        assert self._narrower is not None
        log_e = self.local_by_map / self.local_modulus[:, None]
        # Without the correction: the levels are of the finite elements' own compliances, and their
        # small difference is taken tenfold
        return self._by_levels(-log_e - self._log_by_map, -log_e - self._narrower._log_by_map)

    def growth_change(self, state: BodyState) -> np.ndarray:
        """First-order change (j,) of `growth` to a state nearby."""
        assert self._narrower is not None
        narrow = self._narrower
        here, there = (
            state.changed(**{name: getattr(s, name) for name in BESIDE_GROWTH})
            for s in (self._state, narrow._state)
        )
        by_own, e = self.change(here)
        log_e, log_c = e / self.local_modulus, by_own / self.compliance - self._by_support(here)[1]
        log_narrow = narrow.change(there)[0] / narrow.compliance
        return self._by_levels(-log_e - log_c, -log_e - log_narrow)

    @cached_property
    def _full(self) -> Response:
        """The full solution, also where the compliances are those of a reduced basis."""
        if isinstance(self._response, Response):
            return self._response
        return self._mechanics.solved(self._map, self._state)

    @property
    def _near(self) -> Response | ReducedResponse:
        """The solution that answers for all changes but that from no fibres to some."""
        stale = isinstance(self._response, ReducedResponse) and self._response.is_stale
        return self._full if stale else self._response

    @property
    def correction_off(self) -> np.ndarray | None:
        """How far the correction may be off here, see `BodyMechanics.correction_off`."""
        return self._mechanics.correction_off(self._map, self._state, self._response.compliance)

    def by_field(self) -> np.ndarray:
        """Return the derivative (j, g) of ln C by a free map, by its logarithm at its g points."""
        assert isinstance(self._map, FreeMap)
        points = self._mechanics.coarse.points_m
        by_log = self._map.grid.weights(points).multiply(self._of_map(points)[:, None]).tocsr()
        gradient = _gradient(self._response, by_log, self._state)
        return (self._scale / self.compliance)[:, None] * gradient

    def _of_map(self, points: np.ndarray) -> np.ndarray:
        """Part (p,) of the modulus at points (p, 3) that grows with the map."""
        return self._map.modulus(points) * self._state.factor(points)

    def change(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """First-order change of compliance (j,) and local modulus (j,) to a state nearby."""
        own, points = self._mechanics, self._mechanics.coarse.points_m
        correction = own.correction
        change = np.zeros_like(self.compliance)
        local = np.zeros_like(change)
        if state.modulus_changes != self._state.modulus_changes:
            new, old = (ChangedMap(self._map, s) for s in (state, self._state))
            moved = new.modulus(points) - old.modulus(points)
            change += self._scale * self._near.gradient(moved)
            local = new.modulus(own.local_points) - self.local_modulus
        if state.poisson_ratio != self._state.poisson_ratio:
            step = state.poisson_ratio - self._state.poisson_ratio
            change += step * self._by_poisson_ratio()
        if state.shift_m != self._state.shift_m:
            change += self.compliance * self._log_by_shift(state.shift_m)
        if state.mesh_error_share != self._state.mesh_error_share:
            step = state.mesh_error_share - self._state.mesh_error_share
            change += step * correction.model_error * self.compliance
        if state.rigid_tip_share != self._state.rigid_tip_share:
            step = state.rigid_tip_share - self._state.rigid_tip_share
            before = 1 - self._state.rigid_tip_share * correction.tip.gain
            change -= step * correction.tip.gain / before * self.compliance
        old = self._state
        change += self.compliance * sum(self._by_support(state))
        fibres = fibres_of(state) - fibres_of(old)
        if fibres.any():
            change -= self._scale * (self._fibre_moments @ fibres)
        if _skin(state) != _skin(old):
            change += self._scale * self._by_skin(old, state)
        return change, local

    def _by_support(self, state: BodyState) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Return changes (j,) of ln C by another support: the elements' own, and its correction."""
        by_base = np.subtract(state.base_m_per_pa, self._state.base_m_per_pa)
        if not by_base.any():
            return 0.0, 0.0
        own = self._scale / self.compliance * (self._near.support_sensitivity @ by_base)
        support = self._mechanics.correction.support
        return own, 0.0 if support is None else support.of(own)

    def exact_change(self, state: BodyState, slack: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Change of compliance (j,) and local modulus (j,) to any state, by another solution.

        `slack` see `BodyMechanics.evaluate`.
        """
        if state not in self._exact or self._exact[state][0] > slack:
            # A copy: solutions of the fits are used, and stay in memory for them
            aside = replace(self._mechanics, _solutions=dict(self._mechanics._solutions))
            other = aside.evaluate(self._map, state, slack)
            self._exact[state] = slack, other.compliance, other.local_modulus
        _, compliance, local = self._exact[state]
        return compliance - self.compliance, local - self.local_modulus

    def forget_other_models(self) -> None:
        """Free the models of other Poisson's ratios and places, of hundreds of MB each."""
        self._mechanics.forget_others()

    def compliance_on(self, model: PalpationModel) -> np.ndarray:
        """Compliance (j,) of the presses, or the body, of another coarse model."""
        other = self._mechanics.solve(model, self._map, self._state)
        return self.compliance * (other.compliance / self._full.compliance)

    def compliance_moved(self, mesh: Mesh) -> np.ndarray:
        """Compliance (j,) of a body with nodes a little elsewhere, away from the tips."""
        modulus = ChangedMap(self._map, self._state).modulus
        other = self._full.compliance_moved(mesh, modulus)
        return self.compliance * (other / self._full.compliance)

    def changes(self, moduli: np.ndarray) -> np.ndarray:
        """First-order change of compliance (j, g) for changes (p, g) of the modulus samples."""
        return self._scale[:, None] * (self._full.sensitivity @ moduli)

    def _by_skin(self, old: BodyState, new: BodyState) -> np.ndarray:
        """First-order change of the finite elements' compliance (j,) by another skin."""
        thickness = old.skin_thickness_m
        if old.skin_factor != 1 and thickness > 0:
            by_thickness, by_factor = self._near.skin_sensitivity.T
            change = by_thickness * (new.skin_thickness_m - thickness)
            return change + by_factor * (new.skin_factor - old.skin_factor)
        # A body without a skin is one with a skin like itself, of any thickness
        by_factor = self._near.skin_sensitivity_at_null(new.skin_thickness_m)
        return by_factor * (new.skin_factor - 1)

    @cached_property
    def _fibre_moments(self) -> np.ndarray:
        modulus = ChangedMap(self._map, self._state).modulus(self._mechanics.coarse.points_m)
        # A basis without fibres does not have them
        response = self._near if self._state.fibre_share else self._full
        return response.fibre_moments(modulus)

    def _log_by_shift(self, shift_m: Shift) -> np.ndarray:
        """Change of the logarithm of the compliance (j,) by another place of the body."""
        state = self._state
        # From the stated place, enough for a score, one model a side suffices
        there, here = (
            self._mechanics.log_shift_factor(
                self._map, state, s, not any(state.shift_m), self._slack
            )
            for s in (shift_m, state.shift_m)
        )
        return there - here

    def _by_poisson_ratio(self) -> np.ndarray:
        """Difference quotient to both sides, (j,)."""
        nu, own = self._state.poisson_ratio, self._mechanics
        step = min(own.settings.poisson_step, (0.5 - nu) / 2)
        more, less, here = (
            own.poisson_factor(self._map, self._state, ratio, self._slack)
            for ratio in (nu + step, nu - step, nu)
        )
        return self.compliance * (more - less) / here / (2 * step)


def _gradient(
    response: Response | ReducedResponse, by_parameter: Any, state: BodyState
) -> np.ndarray:
    """Return dC/dp (j, k) of parameters p of the modulus, and of the fibres with it.

    `by_parameter` (p, k) is the modulus samples' derivative, an array or a sparse matrix.
    """
    gradient = response.gradient(by_parameter)
    if state.fibre_share and isinstance(response, Response):
        angle = state.fibre_angle_rad
        by_fibres = response.fibre_sensitivity(np.array([np.cos(angle), np.sin(angle), 0.0]))
        gradient += state.fibre_share * (by_fibres @ by_parameter)
    return gradient


def _skin(state: BodyState) -> tuple[float, float]:
    return (state.skin_thickness_m, state.skin_factor)
