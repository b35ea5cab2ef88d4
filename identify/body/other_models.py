"""Compliances of a body with another Poisson's ratio or at another place, over its own.

They are ratios to models beside the coarse one, that are made when they are first asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fem import PalpationModel
from fem.reduced import ReducedRatio
from identify.body.coarse_solutions import CoarseSolutions, keep, plain_state, solved_state
from identify.body.discretization_error import FineModel
from identify.body.shifted_block import Shift, ShiftedBlock, lagrange_weights
from identify.body.state import BodyState, has_skin
from identify.map.gaussian_map import GaussianMap
from identify.optimize.result import InadmissibleError

_KEPT_RATIOS = 32  # compliances of other models, of the last maps
_KEPT_LAWS = 2  # bases of such models: without fibres, springs and skin, and with some of them
_KEPT_OTHERS = 4  # models of another Poisson's ratio, the last ones used: two are at work at a time


@dataclass(frozen=True)
class OtherModels(CoarseSolutions):
    """The coarse model with models of other Poisson's ratios and places beside it.

    Attributes
    ----------
    coarse, settings : see `CoarseSolutions`
    fine : finer model for the defect correction, or None
    at_poisson_ratio : builds the coarse model with another Poisson's ratio
    """

    fine: FineModel | None
    at_poisson_ratio: Callable[[float], PalpationModel]
    _others: dict[float, PalpationModel] = field(default_factory=dict, kw_only=True)
    _shifted: list[ShiftedBlock] = field(default_factory=list, kw_only=True)  # one, once needed
    _ratios: dict[tuple, np.ndarray] = field(default_factory=dict, kw_only=True)  # of the last maps
    _reduced_ratios: dict[tuple, ReducedRatio] = field(default_factory=dict, kw_only=True)  # by law

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio of the models."""
        return self.coarse.stiffness.poisson_ratio

    def plain(self, state: BodyState) -> BodyState:
        """Return the part of a state that changes the modulus, of the models' Poisson's ratio."""
        return BodyState(state.box_m, self.poisson_ratio, *state.modulus_changes)

    def log_poisson_factor(
        self,
        stiffness: GaussianMap,
        state: BodyState,
        nu: float,
        slack: float = 0.0,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance at another Poisson's ratio over that at the own.

        It is a parabola through the own ratio and the two with a model on both sides of `nu`.
        """
        if not -1 < nu < 0.5:
            raise InadmissibleError(f"Poisson's ratio must lie between -1 and 0.5, not {nu:.4g}")
        nodes = np.array(self.settings.poisson_ratios)
        others = nodes[np.abs(nodes - self.poisson_ratio) > 1e-6]
        # With the two nearest it would have a kink at the own ratio, where effects are tested
        above = int(np.clip(np.searchsorted(others, nu), 1, len(others) - 1))
        beside = others[above - 1 : above + 1]
        weights = lagrange_weights(nu, np.array([self.poisson_ratio, *beside]))[1:]
        log = np.zeros(len(self.coarse.contacts))
        for node, weight in zip(beside.tolist(), weights.tolist(), strict=True):
            if abs(weight) > 1e-9:  # else the ratio is that of the other node
                log += weight * self._log_ratio(
                    node, lambda node=node: self._other(node), stiffness, state, slack
                )
        return log

    def log_shift_factor(
        self,
        stiffness: GaussianMap,
        state: BodyState,
        shift_m: Shift,
        straight: bool = False,
        slack: float = 0.0,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of the body elsewhere over that at its stated place.

        `straight` see `ShiftedBlock.log_factor`.
        """
        shifted = self.shifted

        def log_ratio(place: Shift) -> np.ndarray:
            return self._log_ratio(place, lambda: shifted.coarse_at(place), stiffness, state, slack)

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
        slack: float = 0.0,
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance of another model over the coarse model's.

        Kept by its name; near bodies that both have solved by their reduced bases. With much slack,
        that of a body without fibres, skin and springs: they change the ratio little, and it need
        not be made anew for each of their values.
        """
        solved, plain = solved_state(state), plain_state(state)
        if slack >= self.settings.plain_slack and solved != plain:
            return self._log_ratio(which, model, stiffness, plain, slack)
        body = stiffness, solved
        key = (which, body, max(slack, 1.0))
        if key in self._ratios:
            return self._ratios[key]
        law = _has(state)
        if law not in self._reduced_ratios:
            bases = ReducedRatio(self.coarse, fibres=bool(state.fibre_share))
            keep(self._reduced_ratios, law, bases, _KEPT_LAWS)
        bases = self._reduced_ratios[law]
        tolerance = self.settings.ratio_error * max(slack, 1.0)
        log = bases.log_at(which, body, lambda one: self.body(one, stiffness, state), tolerance)
        if log is None:
            there = bases.model(which) or model()
            own, other = self.solved(stiffness, state), self.solve(there, stiffness, state)
            ratio = other.compliance / own.compliance
            if not (np.isfinite(ratio).all() and ratio.min() > 0):
                raise InadmissibleError("the map is finer than the mesh of the body resolves")
            log = np.log(ratio)
            bases.add(which, body, own, other)
        keep(self._ratios, key, log, _KEPT_RATIOS)
        return log

    def forget_others(self) -> None:
        """Free the models of other Poisson's ratios and of other places."""
        self._others.clear()
        self._reduced_ratios.clear()
        self._shifted.clear()

    def _other(self, nu: float) -> PalpationModel:
        model = self._others.get(nu) or self.at_poisson_ratio(nu)
        keep(self._others, nu, model, _KEPT_OTHERS)
        return model


def _has(state: BodyState) -> tuple[bool, bool, bool]:
    """Whether a body has fibres, springs under it, and a skin."""
    return bool(state.fibre_share), any(state.base_m_per_pa), has_skin(state)
