"""Corrections that carry the coarse model's compliances to a finer mesh.

A correction is the ratio of both meshes' compliances at one map. It is made by a solution on the
finer mesh, or carried from such a solution for a map nearby (`Corrections`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fem import RefinedModel
from identify.body.coarse_solutions import fewer, keep, make_room
from identify.body.discretization_error import (
    ASSUMED,
    CarriedFine,
    FineModel,
    SupportError,
    TipPressure,
    fine_solution,
    tip_pressure,
)
from identify.body.linear_ratio import LinearRatio
from identify.body.other_models import OtherModels
from identify.body.ratio_trend import RatioTrend
from identify.body.settings import BodySettings
from identify.body.shifted_block import Shift
from identify.body.state import BodyState, ChangedMap
from identify.map.gaussian_map import GaussianMap

_KEPT_FINE = 6  # solutions of the finer model that are carried, of 15 MB each, the last used


@dataclass(frozen=True)
class Correction:
    """The finer model beside the coarse one, at one estimate.

    Attributes
    ----------
    ratio : (j,) carries the coarse model's compliance to the finer one's
    trend : how that follows the map, None where it is held
    support : what the coarse model makes too much or little of a support that gives way; None where
        it is firm
    model_error : (j,) the finer model's own relative error, as estimated
    tip : what the pressure under the tip depends on
    carried : it is carried from that of a map nearby
    """

    ratio: np.ndarray | float = 1.0
    trend: RatioTrend | None = None
    support: SupportError | None = None
    model_error: np.ndarray | float = 0.0
    tip: TipPressure = ASSUMED
    carried: bool = False

    def factor(self, stiffness: GaussianMap, state: BodyState) -> np.ndarray | float:
        """Factor (j,) on the coarse model's compliance on a firm support."""
        factor = self.ratio * (1 + state.mesh_error_share * self.model_error)
        factor = factor * (1 - state.rigid_tip_share * self.tip.gain)
        if self.trend is not None and self.trend.follows(stiffness):
            factor = factor * np.exp(self.trend.log_change(stiffness))
        return factor


@dataclass(frozen=True)
class Corrections:
    """Corrections of a coarse model, made or carried; the last ones are kept."""

    _fine: dict[tuple, CarriedFine] = field(default_factory=dict)
    _supports: list[SupportError] = field(default_factory=list)
    _elsewhere: list[tuple] = field(default_factory=list)  # of the body elsewhere

    def at(
        self,
        models: OtherModels,
        fine: FineModel,
        stiffness: GaussianMap,
        state: BodyState,
        slack: float,
    ) -> Correction:
        """Return the correction for a map and a state, see `BodyMechanics.corrected`."""
        plain = models.plain(state)
        shift = models.shifted.near(state.shift_m)
        if any(shift):
            return self._elsewhere_at(models, shift, stiffness, plain, slack)
        models.shifted.forget_fine()
        firm = self._firm(models, fine, stiffness, plain, slack)
        if not any(state.base_m_per_pa):
            return firm
        support = self._support(models, fine, firm, state.base_m_per_pa, stiffness, plain, slack)
        return replace(firm, support=support)

    def estimated(
        self, fine: FineModel, there: ChangedMap, coarse: np.ndarray
    ) -> np.ndarray | None:
        """Finer model's compliance (j,) m/N, linear around its nearest solution, or None.

        `coarse` (j,) are the coarse model's compliances there.
        """
        found = [known.estimated(fine, there, coarse) for known in self._fine.values()]
        carried, error = min(found, key=lambda one: one[1], default=(coarse, np.inf))
        return carried if np.isfinite(error) and carried.min() > 0 else None

    def _firm(
        self,
        models: OtherModels,
        fine: FineModel,
        stiffness: GaussianMap,
        plain: BodyState,
        slack: float,
    ) -> Correction:
        """Return the correction on the model's own support."""
        changed, settings = ChangedMap(stiffness, plain), models.settings
        if slack and self._fine:
            compliance = models.solution(stiffness, plain, slack).compliance
            for key, known in reversed(self._fine.items()):
                at = known.at(fine, changed, models.coarse, compliance, slack, settings)
                if at is not None:
                    keep(self._fine, key, known, len(self._fine))
                    same = known.trend.follows(stiffness)
                    trend = known.trend.around(stiffness) if same else None
                    carried = _believed(at[0] / compliance, at[1], known.tip, settings)
                    return replace(carried, trend=trend, carried=True)
        for known in [*self._fine.values()][:1]:  # before the solution takes its memory
            make_room(self._fine, fewer(_KEPT_FINE, known.ratio.nbytes))
        coarse = models.solved(stiffness, plain)
        found = fine_solution(fine, changed, models.coarse, coarse.compliance, settings)
        tip = tip_pressure(found.response, changed)
        trend = None
        if isinstance(stiffness, GaussianMap):
            ratio = LinearRatio.of(coarse, found.response, changed)
            added = fine.added_share if isinstance(fine, RefinedModel) else 0.0
            trend = RatioTrend.of(coarse, found.response, found.compliance, added, changed)
            carries = CarriedFine(ratio, found.response.unevenness, tip, trend)
            most = fewer(_KEPT_FINE, carries.ratio.nbytes)
            keep(self._fine, (stiffness, plain), carries, most)
        own = _believed(found.compliance / coarse.compliance, found.error, tip, settings)
        return replace(own, trend=trend)

    def _support(
        self,
        models: OtherModels,
        fine: FineModel,
        firm: Correction,
        base: tuple[float, float],
        stiffness: GaussianMap,
        plain: BodyState,
        slack: float,
    ) -> SupportError:
        """Return the error of a support that gives way, beside the corrected firm one.

        On cells of 12 mm the effect of a base that lets a block of 32 mm slide is 27 % too large.
        """
        settings = models.settings
        for known in reversed(self._supports if slack else []):
            if known.serves(np.array(base), settings.near_support):
                return known
        giving = plain.changed(base_normal_m_per_pa=base[0], base_tangential_m_per_pa=base[1])
        held, soft = (models.solution(stiffness, s, slack).compliance for s in (plain, giving))
        changed = ChangedMap(stiffness, giving)
        found = fine_solution(fine, changed, models.coarse, soft, settings, base)
        log_ratio = np.log(found.compliance / soft / firm.ratio)
        own = SupportError(np.array(base), np.log(soft / held), log_ratio)
        self._supports.append(own)
        del self._supports[:-_KEPT_FINE]
        return own

    def _elsewhere_at(
        self,
        models: OtherModels,
        shift: Shift,
        stiffness: GaussianMap,
        plain: BodyState,
        slack: float,
    ) -> Correction:
        """Return the correction of a body elsewhere, whose finer model is made for that place.

        Making it costs as much as thirty solutions, so that a search takes the correction of a
        place and a map nearby.
        """
        settings = models.settings
        coarse = models.solution(stiffness, plain, slack).compliance
        wide = min(max(slack, 1.0), settings.carried_slack)
        reach, grown = wide * settings.carried_shift_m, wide * settings.carried_change
        for place, known, corrected in reversed(self._elsewhere if slack else []):
            apart = np.abs(np.subtract(place, shift)).max()
            if apart <= reach and np.abs(np.log(coarse / known)).max() <= grown:
                return replace(corrected, carried=True)
        there, finer = models.shifted.fine_at(shift)
        changed = ChangedMap(stiffness, plain)
        known = models.solve(there, stiffness, plain).compliance
        found = fine_solution(finer, changed, there, known, settings)
        factor = np.exp(models.log_shift_factor(stiffness, plain, shift, slack=slack))
        tip = tip_pressure(found.response, changed)
        corrected = _believed(found.compliance / (coarse * factor), found.error, tip, settings)
        self._elsewhere.append((shift, coarse, corrected))
        del self._elsewhere[:-_KEPT_FINE]
        return corrected


def _believed(
    ratio: np.ndarray, error: np.ndarray, tip: TipPressure, settings: BodySettings
) -> Correction:
    """Return the correction by a ratio (j,) within its bounds, beyond which it counts as error."""
    kept = np.clip(ratio, *settings.believed_ratio)
    return Correction(kept, model_error=error + (kept - ratio) / kept, tip=tip)
