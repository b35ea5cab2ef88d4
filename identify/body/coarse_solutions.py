"""Solutions of a body's coarse model: the last ones kept, and those of reduced bases near them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fem import Fibres, PalpationModel, SolverError
from fem.palpation import Response
from fem.reduced import Body, ReducedBases, ReducedResponse
from identify.body.compliance import positive_modulus
from identify.body.settings import BODY, BodySettings
from identify.body.state import BodyState, ChangedMap
from identify.map.gaussian_map import GaussianMap
from identify.optimize.result import InadmissibleError

_KEPT_SOLUTIONS = 6  # fits begin at the end of others
_KEPT_BYTES = 1.5e8  # ... and of many presses fewer, see `fewer`
_FEWEST = 2  # where a search stands, and where it tries


@dataclass(frozen=True)
class CoarseSolutions:
    """The model for evaluation and derivatives, with its last solutions.

    Attributes
    ----------
    coarse : the model
    settings : of the models
    """

    coarse: PalpationModel
    settings: BodySettings = field(default=BODY, kw_only=True)
    _solutions: dict[tuple, Response] = field(default_factory=dict, kw_only=True)  # newest last
    _bases: list[ReducedBases] = field(default_factory=list, kw_only=True)  # one, once needed

    def solved(self, stiffness: GaussianMap, state: BodyState) -> Response:
        """Return the solution on the coarse model, a recent one from memory."""
        key = (stiffness, solved_state(state))
        response = self._solutions.get(key) or self.solve(self.coarse, stiffness, state)
        # Fields, and the derivatives at the modulus samples
        numbers = response._free.size + len(response.compliance) * len(self.coarse.points_m)
        most = fewer(_KEPT_SOLUTIONS, 8.0 * numbers)
        if most == _FEWEST:  # large ones: of the last one derivatives are asked for again
            for older in self._solutions.values():
                if older is not response:
                    older.forget_sensitivity()
        keep(self._solutions, key, response, most)
        return response

    def solution(
        self, stiffness: GaussianMap, state: BodyState, slack: float
    ) -> Response | ReducedResponse:
        """Return the solution on the coarse model, a recent one or that of a reduced basis.

        Parameters
        ----------
        slack : factor on `reduced_error`, within which reduced bases will do; 0 for the full model
        """
        known = (stiffness, solved_state(state)) in self._solutions
        if not slack or known or not self._is_reducible(stiffness, state):
            return self.solved(stiffness, state)
        if not self._bases:
            self._bases.append(ReducedBases(self.coarse))
        tolerance = slack * self.settings.reduced_error
        return self._reduced(self._bases[0], stiffness, state, tolerance)

    def _reduced(
        self, bases: ReducedBases, stiffness: GaussianMap, state: BodyState, tolerance: float
    ) -> Response | ReducedResponse:
        """Return the solution of a model in its bases, or the full one, which joins them."""
        near = bases.evaluate(self.body(bases.full, stiffness, state), tolerance)
        if near is not None:
            return near
        if bases.full is not self.coarse:
            response = self.solve(bases.full, stiffness, state)
            bases.add(response)
            return response
        response = self.solved(stiffness, state)
        bases.add(response, self._solutions.get((stiffness, plain_state(state))))
        return response

    def _is_reducible(self, stiffness: GaussianMap, state: BodyState) -> bool:
        """Return True for a state whose law reduced bases know."""
        return isinstance(stiffness, GaussianMap)

    def body(self, model: PalpationModel, stiffness: GaussianMap, state: BodyState) -> Body:
        """Return the body that a state makes of a map, for any model."""
        modulus = positive_modulus(ChangedMap(stiffness, state), model.points_m)
        return Body(modulus, *_law(state, modulus))

    def solve(self, model: PalpationModel, stiffness: GaussianMap, state: BodyState) -> Response:
        """Return the solution on any model."""
        try:
            return model.evaluate(*self.body(model, stiffness, state))
        except SolverError as error:
            raise InadmissibleError(str(error)) from error


def keep(last: dict, key: Any, value: Any, most: int) -> None:
    """Put a value last into a dictionary, and drop the first ones beyond a number."""
    last.pop(key, None)
    make_room(last, most)
    last[key] = value


def make_room(last: dict, most: int) -> None:
    """Drop the first values of a dictionary so that one more is no more than a number."""
    while len(last) >= most:
        del last[next(iter(last))]


def fewer(most: int, bytes_each: float) -> int:
    """Return the number of values to keep: so many, or fewer large ones."""
    return int(np.clip(_KEPT_BYTES / bytes_each, min(_FEWEST, most), most))


def _law(
    state: BodyState, modulus_pa: np.ndarray
) -> tuple[tuple[float, float] | None, Fibres | None, tuple[float, float] | None]:
    """Compliance of the support, fibres and skin of a state, each None without."""
    base, angle, share = state.base_m_per_pa, state.fibre_angle_rad, state.fibre_share
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])
    fibres = Fibres(direction, share * modulus_pa) if share else None
    skin = (state.skin_thickness_m, state.skin_factor)
    if not skin[1] > 0:
        raise InadmissibleError("a skin needs a positive modulus")
    return base if any(base) else None, fibres, skin if skin[0] > 0 else None


def plain_state(state: BodyState) -> BodyState:
    """Return the part of a state that changes the modulus."""
    return BodyState(state.box_m, 0.0, *state.modulus_changes)


def solved_state(state: BodyState) -> BodyState:
    """Return the part of a state that enters a finite element solution."""
    return state.changed(
        poisson_ratio=0.0,
        mesh_error_share=0.0,
        rigid_tip_share=0.0,
        shift_m=(0.0, 0.0),
        background_pa=None,
    )
