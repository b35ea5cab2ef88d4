"""Finite element models of the body, evaluated for a map and a changed body.

The finite element model gives C (j,) for a modulus field and dC_j/dE at its samples; a body effect
changes the field, the law, the support or the body's place (`BodyState`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fem import Contacts, PalpationModel
from identify.body.correction import Correction, Corrections
from identify.body.discretization_error import FineModel, mesh_error_growth, tip_pressure
from identify.body.other_models import OtherModels
from identify.body.response import BESIDE_GROWTH, BodyResponse
from identify.body.shifted_block import ShiftedBlock
from identify.body.state import BodyState, ChangedMap
from identify.map.gaussian_map import GaussianMap


@dataclass(frozen=True)
class BodyMechanics(OtherModels):
    """The finite element models behind a measurement model.

    Attributes
    ----------
    coarse, fine, at_poisson_ratio, settings : see `OtherModels`
    correction : of its compliances to those of the finer one
    narrower : the same presses with narrower contacts, where the growth of a ball's contact is to
        follow the map; else it is that of `tip`
    """

    correction: Correction = field(default_factory=Correction)
    narrower: BodyMechanics | None = None
    _corrections: Corrections = field(default_factory=Corrections, kw_only=True)

    @classmethod
    def of(
        cls, coarse: PalpationModel, fine: FineModel | None = None, ratio: np.ndarray | float = 1.0
    ) -> BodyMechanics:
        """Return the mechanics with models of any other Poisson's ratio on the same mesh."""

        def at(nu: float) -> PalpationModel:
            return PalpationModel(coarse.mesh, nu, coarse.contacts, support=coarse.support)

        return cls(coarse, None if fine is coarse else fine, at, Correction(ratio))

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

    def forget(self) -> None:
        """Free everything that is kept of other maps and other models, hundreds of MB."""
        self.forget_others()
        for kept in (self._solutions, self._bases, self._ratios, self._corrections._fine):
            kept.clear()
        if self.narrower is not None:
            self.narrower.forget()

    @property
    def contacts(self) -> Contacts:
        """The presses' contacts (j,)."""
        return self.coarse.contacts

    @cached_property
    def local_points(self) -> np.ndarray:
        """Points of the local modulus under each tip, (j, 3) m."""
        contacts = self.coarse.contacts
        # The growth of a ball's contact begins at the surface
        share = 0.0 if contacts.profile == "hertz" else self.settings.local_depth
        return contacts.points_m + share * contacts.radius_m[:, None] * contacts.directions

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
        response = self.solution(stiffness, state, slack)
        factor = self.correction.factor(stiffness, state) * np.ones(len(self.coarse.contacts))
        support = self.correction.support
        if support is not None and any(state.base_m_per_pa):
            firm = state.changed(base_normal_m_per_pa=0.0, base_tangential_m_per_pa=0.0)
            alone = self.solution(stiffness, firm, slack)
            factor *= np.exp(support.of(np.log(response.compliance / alone.compliance)))
        if state.poisson_ratio != self.poisson_ratio:
            nu = state.poisson_ratio
            factor = factor * self.poisson_factor(stiffness, state, nu, slack)
        if any(state.shift_m):
            straight = slack >= self.settings.straight_slack
            moved = self.log_shift_factor(stiffness, state, state.shift_m, straight, slack)
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
        if self.fine is None:
            changed = ChangedMap(stiffness, self.plain(state))
            tip = tip_pressure(self.solved(stiffness, changed.state), changed)
            return replace(self, correction=replace(self.correction, tip=tip))
        correction = self._corrections.at(self, self.fine, stiffness, state, slack)
        return replace(self, correction=correction)

    def correction_off(
        self, stiffness: GaussianMap, state: BodyState, coarse: np.ndarray
    ) -> np.ndarray | None:
        """How far the correction may be off at a map, as ln C (j,); None where nothing tells.

        The difference between two courses of the correction that are both right to first order:
        the one at hand, and the one carried from the nearest solution of the finer model. `coarse`
        (j,) are the coarse model's compliances there.
        """
        if self.fine is None or any(state.shift_m):
            return None
        plain = self.plain(state)
        carried = self._corrections.estimated(self.fine, ChangedMap(stiffness, plain), coarse)
        if carried is None:
            return None
        return np.log(carried / coarse) - np.log(self.correction.factor(stiffness, plain))

    def counts_support(self, state: BodyState) -> bool:
        """Return whether the correction counts a base that gives way as in the state."""
        counted = self.fine is None or self.correction.support is not None
        return counted or not any(state.base_m_per_pa)

    def poisson_factor(
        self, stiffness: GaussianMap, state: BodyState, nu: float, slack: float = 0.0
    ) -> np.ndarray:
        """Factor (j,) of another Poisson's ratio on a corrected compliance at the model's own."""
        if nu == self.poisson_ratio:
            return np.ones(len(self.coarse.contacts))
        coarse = np.exp(self.log_poisson_factor(stiffness, state, nu, slack))
        growth = mesh_error_growth(nu, self.poisson_ratio, self.settings)
        return coarse * self.correction.ratio ** (growth - 1)
