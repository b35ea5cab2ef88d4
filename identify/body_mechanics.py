"""Compliance of every press on a body as the effects have changed it, with its derivatives.

The finite element model gives C (j,) for a modulus field and dC_j/dE at its samples; a body effect
changes the field, the law or the support (`BodyState`). Small changes of a state are carried over
to first order by the same sensitivities (`BodyResponse.change`), which is all that a score test
needs; a fit evaluates the changed state itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fem import PalpationModel
from fem.elasticity import fibre_weights
from fem.errors import SolverError
from fem.punch_shape import shape_gain
from fem.response import Response
from identify.body_state import BodyState, ChangedMap
from identify.discretization import FineModel, fine_solution, mesh_error_growth
from identify.forward import positive_modulus
from identify.gaussian_map import GaussianMap
from identify.interpolation import lagrange_weights
from identify.optimize_result import InadmissibleError
from identify.shifted_block import Shift, ShiftedBlock

# Poisson ratios at which models are built; C is interpolated between the nearest three.
_NODES = np.array([0.05, 0.15, 0.25, 0.32, 0.38, 0.42, 0.45, 0.47, 0.48, 0.49, 0.497])
_LOCAL_DEPTH = 0.5  # of the contact radius: where the modulus under the tip is taken
_NU_STEP = 0.01
_KEPT_RATIOS = 12  # of the compliances of other models: those of two maps and their neighbours
_KEPT_SOLUTIONS = 3  # of the coarse model: fits begin where others have ended
_BELIEVED = (0.6, 1.6)  # compliance of the finer model over the coarse one's


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
    _response: Response
    _scale: np.ndarray  # (j,) what the finite elements' own compliance is multiplied by

    @cached_property
    def by_map(self) -> np.ndarray:
        """Derivative of the compliance by the map's parameters, in their units, (j, k)."""
        points = self._mechanics.coarse.points_m
        gradient = ChangedMap(self._map, self._state).gradient(points)
        own = _gradient(self._response, gradient, self._state)
        return self._scale[:, None] * own

    def change(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """First-order change of compliance (j,) and local modulus (j,) to a state nearby."""
        own, points = self._mechanics, self._mechanics.coarse.points_m
        change = np.zeros_like(self.compliance)
        local = np.zeros_like(change)
        if state.modulus_changes != self._state.modulus_changes:
            new, old = (ChangedMap(self._map, s) for s in (state, self._state))
            moved = new.modulus(points) - old.modulus(points)
            change += self._scale * (self._response.sensitivity @ moved)
            local = new.modulus(own.local_points) - self.local_modulus
        if state.poisson_ratio != self._state.poisson_ratio:
            step = state.poisson_ratio - self._state.poisson_ratio
            change += step * self._by_poisson_ratio()
        if state.shift_m != self._state.shift_m:
            change += self.compliance * self._log_by_shift(state.shift_m)
        if state.mesh_error_share != self._state.mesh_error_share:
            step = state.mesh_error_share - self._state.mesh_error_share
            change += step * own.model_error * self.compliance
        if state.rigid_tip_share != self._state.rigid_tip_share:
            step = state.rigid_tip_share - self._state.rigid_tip_share
            before = 1 - self._state.rigid_tip_share * own.tip_gain
            change -= step * own.tip_gain / before * self.compliance
        old = self._state
        by_base = np.array(
            [
                state.base_normal_m_per_pa - old.base_normal_m_per_pa,
                state.base_tangential_m_per_pa - old.base_tangential_m_per_pa,
            ]
        )
        if by_base.any():
            change += self._scale * (self._response.support_sensitivity @ by_base)
        fibres = _fibres(state) - _fibres(old)
        if fibres.any():
            change -= self._scale * (self._fibre_moments @ fibres)
        if _skin(state) != _skin(old):
            change += self._scale * self._by_skin(old, state)
        return change, local

    def exact_change(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """Change of compliance (j,) and local modulus (j,) to any state, by another solution."""
        # A copy: what the fits have solved is used, and stays kept for them
        aside = replace(self._mechanics, _solutions=dict(self._mechanics._solutions))
        other = aside.evaluate(self._map, state)
        return other.compliance - self.compliance, other.local_modulus - self.local_modulus

    def compliance_on(self, model: PalpationModel) -> np.ndarray:
        """Compliance (j,) if the presses, or the body, were those of another coarse model."""
        other = self._mechanics._solve(model, self._map, self._state)
        return self.compliance * (other.compliance / self._response.compliance)

    def changes(self, moduli: np.ndarray) -> np.ndarray:
        """First-order change of compliance (j, g) for changes (p, g) of the modulus samples."""
        return self._scale[:, None] * (self._response.sensitivity @ moduli)

    def _by_skin(self, old: BodyState, new: BodyState) -> np.ndarray:
        """First-order change of the finite elements' compliance (j,) by another skin."""
        thickness = old.skin_thickness_m
        if old.skin_factor != 1 and thickness > 0:
            by_thickness, by_factor = self._response.skin_sensitivity.T
            change = by_thickness * (new.skin_thickness_m - thickness)
            return change + by_factor * (new.skin_factor - old.skin_factor)
        # A body without a skin is one with a skin like itself, of any thickness
        by_factor = self._response.skin_sensitivity_at_null(new.skin_thickness_m)
        return by_factor * (new.skin_factor - 1)

    @cached_property
    def _fibre_moments(self) -> np.ndarray:
        modulus = ChangedMap(self._map, self._state).modulus(self._mechanics.coarse.points_m)
        return self._response.fibre_moments(modulus)

    def _log_by_shift(self, shift_m: Shift) -> np.ndarray:
        """Change of the logarithm of the compliance (j,) by another place of the body."""
        own, plain = self._state, self._response.compliance
        # From its stated place on, which is all that a score asks for, one model a side will do
        there, here = (
            self._mechanics.log_shift_factor(self._map, own, s, plain, not any(own.shift_m))
            for s in (shift_m, own.shift_m)
        )
        return there - here

    def _by_poisson_ratio(self) -> np.ndarray:
        """Difference quotient towards the compressible side, (j,)."""
        nu, plain = self._state.poisson_ratio, self._response.compliance
        factor = self._mechanics.poisson_factor
        other = factor(self._map, self._state, nu - _NU_STEP, plain)
        own = factor(self._map, self._state, nu, plain)
        return self.compliance * (1 - other / own) / _NU_STEP


@dataclass(frozen=True)
class BodyMechanics:
    """The finite element models behind a measurement model.

    Attributes
    ----------
    coarse : is evaluated and differentiated
    fine : more exact; None does without
    at_poisson_ratio : builds the coarse model with another Poisson's ratio
    ratio : (j,) carries the coarse model's compliance to the finer one's (`corrected`)
    model_error : (j,) the finer model's own relative error, as estimated
    tip_gain : (j,) relative part of the compliance that the pressure of a rigid, upright flat tip
        takes off at this estimate (`fem.punch_shape`); 0 of other contacts
    """

    coarse: PalpationModel
    fine: FineModel | None
    at_poisson_ratio: Callable[[float], PalpationModel]
    ratio: np.ndarray | float = 1.0
    model_error: np.ndarray | float = 0.0
    tip_gain: np.ndarray | float = 0.0
    _others: dict[float, PalpationModel] = field(default_factory=dict)
    _shifted: ShiftedBlock | None = None
    _ratios: dict[tuple, np.ndarray] = field(default_factory=dict)  # of the last maps
    _solutions: dict[tuple, Response] = field(default_factory=dict)  # the last ones, newest last

    @cached_property
    def local_points(self) -> np.ndarray:
        """Where the modulus under each tip is taken, (j, 3) m."""
        contacts = self.coarse.contacts
        depth = _LOCAL_DEPTH * contacts.radius_m[:, None]
        return contacts.points_m + depth * contacts.directions

    @property
    def poisson_ratio(self) -> float:
        """The ratio with which the models were built."""
        return self.coarse.stiffness.poisson_ratio

    def state(self) -> BodyState:
        """Return the state without effects."""
        nodes = self.coarse.mesh.nodes
        low, high = nodes.min(axis=0).tolist(), nodes.max(axis=0).tolist()
        return BodyState((tuple(low), tuple(high)), self.poisson_ratio)

    def evaluate(self, stiffness: GaussianMap, state: BodyState) -> BodyResponse:
        """Solve for a map and a state.

        Raises
        ------
        InadmissibleError
            The modulus is not positive everywhere.
        """
        response = self._solved(stiffness, state)
        factor = self.ratio * (1 + state.mesh_error_share * self.model_error)
        factor = factor * (1 - state.rigid_tip_share * self.tip_gain)
        factor = factor * np.ones(len(self.coarse.contacts))
        if state.poisson_ratio != self.poisson_ratio:
            nu, own = state.poisson_ratio, response.compliance
            factor = factor * self.poisson_factor(stiffness, state, nu, own)
        if any(state.shift_m):
            own = response.compliance
            factor *= np.exp(self.log_shift_factor(stiffness, state, state.shift_m, own))
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
        )

    def corrected(self, stiffness: GaussianMap, state: BodyState) -> BodyMechanics:
        """Return the mechanics with the coarse model carried to the finer one at this estimate.

        Fibres, support and skin are left out: what the meshes make of them differs little.
        """
        plain = BodyState(state.box_m, self.poisson_ratio, *state.modulus_changes)
        coarse = self._solved(stiffness, plain)
        changed = ChangedMap(stiffness, plain)
        if self.fine is None:
            return replace(self, tip_gain=_tip_gain(coarse, changed))
        shift = self.shifted.near(state.shift_m)
        if any(shift):
            there, finer = self.shifted.fine_at(shift)
            known = self._solve(there, stiffness, plain).compliance
            fine = fine_solution(finer, changed, there, known)
            log_factor = self.log_shift_factor(stiffness, plain, shift, coarse.compliance)
            ratio = fine.compliance / (coarse.compliance * np.exp(log_factor))
        else:
            fine = fine_solution(self.fine, changed, self.coarse, coarse.compliance)
            ratio = fine.compliance / coarse.compliance
        # Where the meshes differ by more, neither resolves the map, and nothing is extrapolated
        kept = np.clip(ratio, *_BELIEVED)
        return replace(
            self,
            ratio=kept,
            model_error=fine.error + (kept - ratio) / kept,
            tip_gain=_tip_gain(fine.response, changed),
        )

    def poisson_factor(
        self, stiffness: GaussianMap, state: BodyState, nu: float, base: np.ndarray
    ) -> np.ndarray:
        """Compliance (j,) at another Poisson's ratio over that at the model's own.

        `base` (j,) is the coarse model's there; the factor holds for what is carried by `ratio`.
        """
        if nu == self.poisson_ratio:
            return np.ones(len(self.coarse.contacts))
        if not -1 < nu < 0.5:
            raise InadmissibleError(f"Poisson's ratio must lie between -1 and 0.5, not {nu:.4g}")
        others = _NODES[np.abs(_NODES - self.poisson_ratio) > 1e-6]
        nearest = others[np.argsort(np.abs(others - nu))[:2]]
        weights = lagrange_weights(nu, np.array([self.poisson_ratio, *nearest]))[1:]
        logs = [
            self._log_ratio(node, lambda node=node: self._other(node), stiffness, state, base)
            for node in nearest.tolist()
        ]
        coarse = np.exp(weights @ logs)
        return coarse * self.ratio ** (mesh_error_growth(nu, self.poisson_ratio) - 1)

    def _other(self, nu: float) -> PalpationModel:
        if nu not in self._others:
            self._others[nu] = self.at_poisson_ratio(nu)
        return self._others[nu]

    def log_shift_factor(
        self,
        stiffness: GaussianMap,
        state: BodyState,
        shift_m: Shift,
        base: np.ndarray,
        straight: bool = False,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of the body elsewhere over that at its stated place.

        `base` (j,) is the coarse model's there; `straight` see `ShiftedBlock.log_factor`.
        """
        shifted = self.shifted

        def log_ratio(place: Shift) -> np.ndarray:
            return self._log_ratio(place, lambda: shifted.coarse_at(place), stiffness, state, base)

        return shifted.log_factor(shift_m, straight, log_ratio)

    @property
    def shifted(self) -> ShiftedBlock:
        """The models of the body elsewhere."""
        if self._shifted is None:
            object.__setattr__(self, "_shifted", ShiftedBlock(self.coarse, self.fine))
        assert self._shifted is not None
        return self._shifted

    def _log_ratio(
        self,
        which: float | Shift,
        model: Callable[[], PalpationModel],
        stiffness: GaussianMap,
        state: BodyState,
        base: np.ndarray,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of another model over `base`, kept by its name."""
        key = (which, stiffness, _solved_state(state))
        if key not in self._ratios:
            ratio = self._solve(model(), stiffness, state).compliance / base
            if not (np.isfinite(ratio).all() and ratio.min() > 0):
                raise InadmissibleError("the map is finer than the mesh of the body resolves")
            while len(self._ratios) >= _KEPT_RATIOS:
                self._ratios.pop(next(iter(self._ratios)))
            self._ratios[key] = np.log(ratio)
        return self._ratios[key]

    def _solved(self, stiffness: GaussianMap, state: BodyState) -> Response:
        """Solve on the coarse model, or return what was solved there not long ago."""
        key = (stiffness, _solved_state(state))
        response = self._solutions.pop(key, None) or self._solve(self.coarse, stiffness, state)
        self._solutions[key] = response
        while len(self._solutions) > _KEPT_SOLUTIONS:
            self._solutions.pop(next(iter(self._solutions)))
        return response

    def _solve(self, model: PalpationModel, stiffness: GaussianMap, state: BodyState) -> Response:
        modulus = positive_modulus(ChangedMap(stiffness, state), model.points_m)
        base = (state.base_normal_m_per_pa, state.base_tangential_m_per_pa)
        angle, share = state.fibre_angle_rad, state.fibre_share
        direction = np.array([np.cos(angle), np.sin(angle), 0.0])
        skin = (state.skin_thickness_m, state.skin_factor)
        if not skin[1] > 0:
            raise InadmissibleError("a skin needs a positive modulus")
        try:
            return model.evaluate(
                modulus,
                support_compliance=base if any(base) else None,
                fibres=(direction, share * modulus) if share else None,
                skin=skin if skin[0] > 0 else None,
            )
        except SolverError as error:
            raise InadmissibleError(str(error)) from error


def _solved_state(state: BodyState) -> BodyState:
    """Return the part of a state that a finite element model is solved for."""
    return state.changed(
        poisson_ratio=0.0,
        mesh_error_share=0.0,
        rigid_tip_share=0.0,
        shift_m=(0.0, 0.0),
        background_pa=None,
    )


def _tip_gain(response: Response, changed: ChangedMap) -> np.ndarray | float:
    """Relative part (j,) of the compliance that a rigid tip's own pressure takes off."""
    contacts = response.model.contacts
    if contacts.profile != "flat":
        return 0.0
    return shape_gain(response, changed.modulus(contacts.points_m)) / response.compliance


def _gradient(response: Response, by_parameter: np.ndarray, state: BodyState) -> np.ndarray:
    """Return dC/dp (j, k) of parameters p that change the modulus, and the fibres with it."""
    gradient = response.gradient(by_parameter)
    if state.fibre_share:
        angle = state.fibre_angle_rad
        by_fibres = response.fibre_sensitivity(np.array([np.cos(angle), np.sin(angle), 0.0]))
        gradient += state.fibre_share * (by_fibres @ by_parameter)
    return gradient


def _fibres(state: BodyState) -> np.ndarray:
    """Share of the fibres times the weights (6,) of their strain products."""
    return state.fibre_share * fibre_weights(state.fibre_angle_rad)


def _skin(state: BodyState) -> tuple[float, float]:
    return (state.skin_thickness_m, state.skin_factor)
