"""The model of a scan: a stiffness map and effects, none or several, as a least-squares problem.

The unknowns are the map's free parameters and the parameters of the effects, all scaled to order
one. Residuals are whitened with both columns' noise (`identify.measurement.chain.judge`),
derivatives taken at the latent force (see `identify.measurement.errors_in_variables`):
r = (d - f(F)) / s, dr/dp = -(df/dp at F^) / s. A map alone under a flat tip is linear in the force,
d = C F: a search then needs two rows a press (`evaluate`), not all readings.

Nothing is changed in place: `with_effect` and `without` return new models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identify.body.compliance import refuse_impossible
from identify.body.mechanics import BodyMechanics
from identify.body.response import BodyResponse
from identify.body.state import BodyState
from identify.effects.base import Effect, changes_body
from identify.effects.readings import Readings
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import ParameterSpace
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.derivatives import Derivatives
from identify.measurement.effect_in_model import EffectInModel, effect_values
from identify.measurement.errors_in_variables import PressTable, press_table
from identify.measurement.judge import Judged, judge
from identify.measurement.linearised import Compressed, Linearised
from identify.measurement.map_uncertainty import MapUncertainty, MarginalMap
from identify.measurement.noise import Noise
from identify.measurement.settings import TOUCH
from identify.measurement.shared_error import SharedErrors, lag_error_m

_OWN_STEPS = 10  # at most, of each press's ln C beside an uncertain map
_OWN_TOL, _LONGEST_MOVE = 1e-3, 0.5  # of ln C: the end of these steps, and the longest


@dataclass(frozen=True)
class MeasurementModel:
    """A scan's readings with a model of body and measurement chain.

    Attributes
    ----------
    readings, displacement_m, noise : measurement, (m,) m
    mechanics : the body's finite elements
    space : the map's free parameters
    press_error : relative error of the map in each press's compliance, counted beside the noise if
        larger; the readings of a press share it
    effects : effects beside the map, in the order of the chain
    unit_compliance : (j,) of the homogeneous body of 1 Pa: the modulus under a tip is then that of
        the homogeneous body of the press's compliance, which is what the tip feels; else the map's
        at one point under it
    map_uncertainty : of a free map, which is then no unknown of its own: residual and derivatives
        are those beside every map of its prior
    straight : the readings are, or count as, those of a flat tip, whatever the body's contacts
    """

    readings: Readings
    displacement_m: np.ndarray
    noise: Noise
    mechanics: BodyMechanics
    space: ParameterSpace
    effects: tuple[EffectInModel, ...] = ()
    press_error: float = 0.0
    unit_compliance: np.ndarray | None = None
    map_uncertainty: MapUncertainty | None = None
    straight: bool = False

    @cached_property
    def chain(self) -> Chain:
        """The links beyond the body."""
        contacts = self.mechanics.contacts
        return Chain(
            self.readings,
            [part.effect for part in self.effects],
            contacts.radius_m,
            "flat" if self.straight else contacts.profile,
            self.mechanics.poisson_ratio,
            contacts.curvature_per_m,
            self.mechanics.correction.tip.growth,
        )

    def _chain(self, body: BodyResponse) -> Chain:
        """Return the links beyond an evaluated body, which may know how a contact grows on it."""
        return self.chain if body.growth is None else replace(self.chain, growth=body.growth)

    @cached_property
    def unknowns(self) -> ParameterSpace:
        """The map's free parameters, then those of the effects as `effect.parameter`."""
        parts = [
            replace(p, name=f"{part.effect.name}.{p.name}")
            for part in self.effects
            for p in part.parameters
        ]
        return replace(self.space, beyond=tuple(parts))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k unknowns."""
        return self.unknowns.names

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(part.effect.name for part in self.effects)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (k,) in scaled coordinates."""
        return self.unknowns.bounds

    def with_effect(
        self, effect: Effect, start: Mapping[str, float], state: BodyState
    ) -> MeasurementModel:
        """Return the model with one more effect, its parameters starting from the given values."""
        part = EffectInModel(effect, effect.bounded(self.readings, state), dict(start))
        return replace(self, effects=(*self.effects, part))

    def without(self, name: str) -> MeasurementModel:
        """Return the model without an effect."""
        return replace(self, effects=tuple(p for p in self.effects if p.effect.name != name))

    def started(self, u: np.ndarray) -> MeasurementModel:
        """Return the model whose effects start at scaled coordinates u (k,)."""
        values = self.values(u)
        parts = [replace(part, start=values[part.effect.name]) for part in self.effects]
        return replace(self, effects=tuple(parts))

    def start(self, stiffness: GaussianMap) -> np.ndarray:
        """Scaled coordinates (k,) of a map and of the effects' starts."""
        parts = [part.to_scaled() for part in self.effects]
        return np.concatenate([self.space.to_scaled(stiffness), *parts])

    def map(self, u: np.ndarray) -> GaussianMap:
        """Return the map at scaled coordinates (k,)."""
        return self.space.to_map(u)

    def values(self, u: np.ndarray) -> dict[str, dict[str, float]]:
        """Parameters of the effects at scaled coordinates (k,), by effect and name."""
        return effect_values(self.effects, u[len(self.space.free) :])

    def state(self, values: Mapping[str, Mapping[str, float]]) -> BodyState:
        """Return the body as the effects have changed it."""
        background = self.space.start.background_pa
        state = self.mechanics.state().changed(background_pa=background)
        for part in self.effects:
            if changes_body(part.effect):
                state = part.effect.body(state, **values[part.effect.name])
        return state

    def corrected(self, u: np.ndarray, slack: float = 0.0) -> MeasurementModel:
        """Return the model carried to the finer body at scaled coordinates u (k,).

        `slack` see `BodyMechanics.corrected`.
        """
        mechanics = self.mechanics.corrected(self.map(u), self.state(self.values(u)), slack)
        return replace(self, mechanics=mechanics)

    @cached_property
    def table(self) -> PressTable:
        """The readings as two rows a press."""
        r = self.readings
        return press_table(r.press, self.displacement_m, r.force_n, r.presses)

    @property
    def is_linear(self) -> bool:
        """Whether d = C F with the noise alone, so that two rows a press suffice."""
        plain = self.press_error == 0 and self.map_uncertainty is None
        shares = self.noise != self.noise.of_readings
        return plain and not (self.effects or self.chain.nonlinear or shares)

    def evaluate(self, u: np.ndarray, slack: float = 0.0) -> Compressed | Linearised:
        """Residual and derivatives at scaled coordinates (k,), compressed if that is exact.

        `slack` see `BodyMechanics.evaluate`.

        Raises
        ------
        InadmissibleError
            The body is impossible there.
        """
        if not self.is_linear:
            return self.linearise(u, slack)
        body = self.body(u, slack)
        residual, by_c = self.table.residuals(body.compliance, self.noise)
        by_map = body.by_map[:, list(self.space.free)] * self.space.slope(u)
        jacobian = -(by_c[:, :, None] * by_map[:, None, :]).reshape(residual.size, len(u))
        return Compressed(residual.ravel(), jacobian, self.table.rms(body.compliance))

    def residual(self, u: np.ndarray, slack: float = 0.0) -> np.ndarray:
        """Return the residual of `evaluate` alone, where that is cheaper without derivatives."""
        if self.is_linear:
            return self.table.residuals(self.body(u, slack).compliance, self.noise)[0].ravel()
        if self.map_uncertainty is not None or self.press_error:
            return self.linearise(u, slack).residual  # the map's own error acts by derivatives
        body = self.body(u, slack)
        c, e = body.compliance, body.local_modulus
        if self.unit_compliance is not None:
            e = self.unit_compliance / c
        judged = judge(self._chain(body), c, e, self.displacement_m, self.noise, self.values(u))
        return self._shared(judged.sigma_m).whitened(judged.residual_m / judged.sigma_m)

    @cached_property
    def _lag_m(self) -> np.ndarray:
        return lag_error_m(self.noise, self.readings, self.displacement_m)

    def _shared(self, sigma_m: np.ndarray, *errors_m: np.ndarray) -> SharedErrors:
        """Return the errors that readings share.

        `errors_m` (m,) are further ones of a press. That of the first touch is partly common to
        all presses, that of the lag wholly. A free map is whitened press by press.
        """
        touch, lag = np.full_like(sigma_m, self.noise.touch_m), self._lag_m
        alone = self.map_uncertainty is not None
        own = np.column_stack([*errors_m, touch, alone * lag]) / sigma_m[:, None]
        common = np.column_stack([TOUCH.common_share * touch, lag]) / sigma_m[:, None]
        return SharedErrors.of(own, (not alone) * common, self.readings.press)

    def linearise(self, u: np.ndarray, slack: float = 0.0) -> Linearised:
        """Evaluate model and derivatives at scaled coordinates (k,).

        `slack` see `BodyMechanics.evaluate`.

        Raises
        ------
        InadmissibleError
            The body is impossible there (a modulus that is not positive, a Poisson's ratio of one
            half).
        """
        return self.around(self.body(u, slack), u)

    def by_log_compliance(self, at: Linearised) -> np.ndarray:
        """Return the derivative (m,) of the prediction by ln C of its press, m.

        The modulus under the tip moves with it.
        """
        press = self.readings.press
        return at.by_compliance * at.compliance[press] - at.by_modulus * at.modulus[press]

    def moved_by_body(self, at: Linearised, dc: np.ndarray, de: np.ndarray) -> np.ndarray:
        """Return the change (m,) of the predictions by that of the body's C and moduli (j,), m."""
        if self.unit_compliance is not None:
            dc = at.compliance / at.body.compliance * dc
            de = -at.modulus / at.compliance * dc
        press = self.readings.press
        return at.by_compliance * dc[press] + at.by_modulus * de[press]

    def body(self, u: np.ndarray, slack: float = 0.0) -> BodyResponse:
        """Solve the body at scaled coordinates (k,); see `linearise`."""
        body = self.mechanics.evaluate(self.map(u), self.state(self.values(u)), slack)
        refuse_impossible(body.compliance)
        return body

    def around(
        self, body: BodyResponse, u: np.ndarray, factor: np.ndarray | float = 1.0
    ) -> Linearised:
        """Linearise the chain beyond an evaluated body, without finite elements.

        Parameters
        ----------
        factor : (j,) on the body's compliances, where a press may differ from the map
        """
        if self.map_uncertainty is None:
            return self._with_jacobian(*self._judged(body, u, factor))
        return self._marginal(body, u, self.map_uncertainty)

    def _with_jacobian(self, at: Linearised, by: Derivatives) -> Linearised:
        return replace(at, jacobian=at.whitened(by.by_unknowns(), self.readings.press))

    def _judged(
        self, body: BodyResponse, u: np.ndarray, factor: np.ndarray | float = 1.0
    ) -> tuple[Linearised, Derivatives]:
        """Return the chain beyond an evaluated body without its Jacobian, and what makes that."""
        values, press = self.values(u), self.readings.press
        c, e = factor * body.compliance, body.local_modulus
        if self.unit_compliance is not None:
            e = self.unit_compliance / c
        chain = self._chain(body)
        judged = judge(chain, c, e, self.displacement_m, self.noise, values)
        residual, sigma, latent = judged.residual_m, judged.sigma_m, self._latent(judged)
        point = OperatingPoint(c, e, latent, values)
        by = Derivatives(self, u, body, chain, point)
        by_c, by_e = by.by_body
        map_error = self.press_error * (by_c * c[press] - by_e * e[press])
        shared = self._shared(sigma, map_error)
        linear = Linearised(
            predicted_m=self.displacement_m - residual,
            sigma_m=sigma,
            latent_force_n=latent,
            residual=shared.whitened(residual / sigma),
            jacobian=np.empty((len(residual), 0)),
            rms_m=float(np.sqrt(np.mean(residual**2))),
            shared_errors=shared.own,
            common_errors=shared.common,
            by_compliance=by_c,
            by_modulus=by_e,
            compliance=c,
            modulus=e,
            body=body,
            state=self.state(values),
            values=values,
        )
        return linear, by

    def _latent(self, judged: Judged) -> np.ndarray:
        """Return the best estimate (m,) of the force, N.

        A shared error of the travel is no error of the force: counted as one, chi-square fell along
        no step near its minimum.
        """
        if not (self.noise.touch_m or self.noise.lag_s):
            return judged.latent_force_n
        shared, sigma = self._shared(judged.sigma_m), judged.sigma_m
        apart = shared.transposed(shared.whitened(judged.residual_m / sigma)) / sigma
        return self.readings.force_n + judged.slope * self.noise.force_n**2 * apart

    def _marginal(self, body: BodyResponse, u: np.ndarray, uncertain: MapUncertainty) -> Linearised:
        """Return the model with every map of the prior beside it, its predictions by the best.

        Linear where each press is most probable beside them, in a few steps: around the map, whose
        own error may be many times the noise, a press's bent curve would be taken for an effect.
        """
        press, moved = self.readings.press, np.zeros(len(body.compliance))
        weight = np.sqrt(uncertain.felt)[press]
        for _ in range(_OWN_STEPS):
            at, by = self._judged(body, u, np.exp(moved))
            by_s = self.by_log_compliance(at)
            there = replace(uncertain, offset=uncertain.offset + moved)
            marginal = MarginalMap(there, weight * at.whitened(by_s, press), press)
            about_mean = marginal.about_mean(weight * at.residual)
            by_map, further = marginal.moved(about_mean), marginal.probable(about_mean)
            if np.abs(further).max() < _OWN_TOL:
                break
            moved = moved + np.clip(further, -_LONGEST_MOVE, _LONGEST_MOVE)
        at = self._with_jacobian(at, by)
        predicted = at.predicted_m + by_s * by_map[press]
        return replace(
            at,
            residual=marginal.whitened(about_mean),
            jacobian=marginal.whitened((at.jacobian.T * weight).T),
            predicted_m=predicted,
            rms_m=float(np.sqrt(np.mean((self.displacement_m - predicted) ** 2))),
            marginal=marginal,
        )
