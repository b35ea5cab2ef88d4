"""Fit of effects with one free compliance per press, without a map.

The shape of a press's curve of travel over force (contact, response, instrument) is one question,
the stiffness of the body under each press another. A free compliance C_j for each press in place of
the map separates the two, without finite elements:

    min over C, p of  sum_i r_i(C_press(i), E_press(i), p)^2,      E_j = K_j / C_j

with the local modulus E_j of a homogeneous body of this compliance (K_j its compliance for 1 Pa).
The compliances are eliminated press by press (variable projection: Golub and Pereyra, SIAM J.
Numer. Anal. 10, 1973; Kaufman's derivative), so that only the few parameters p of the effects are
sought. The fit holds however far the map is from the truth, but does not see effects that act on
compliances alone (any effect of the body).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fem import Contacts
from identify.body.state import BodyState
from identify.effects.base import Effect, Values
from identify.effects.readings import Readings
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.settings import FREE_COMPLIANCE, FreeComplianceSettings
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.effect_in_model import EffectInModel, effect_values
from identify.measurement.judge import Judged, judge
from identify.measurement.kept_slope import KeptSlope
from identify.measurement.noise import Noise
from identify.measurement.places import disagreement, numbered, places_of
from identify.measurement.shared_error import decorrelated, lag_error_m
from identify.measurement.traced_chain import TracedChain
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.result import InadmissibleError

_STEP = 1e-4  # of a parameter's scale, for difference quotients


@dataclass(frozen=True)
class FreeCompliance:
    """Readings with one free compliance per press.

    Attributes
    ----------
    readings, displacement_m, noise : measurement, (m,) m
    contacts, poisson_ratio, growth : of the body's model, see `Chain`
    unit_compliance : (j,) compliance of a homogeneous body of 1 Pa, K_j
    state : the body without effects, for the bounds of parameters
    settings : of the fit
    """

    readings: Readings
    displacement_m: np.ndarray
    noise: Noise
    contacts: Contacts
    poisson_ratio: float
    unit_compliance: np.ndarray
    state: BodyState
    growth: np.ndarray | None = None
    settings: FreeComplianceSettings = FREE_COMPLIANCE

    def some(self, presses: np.ndarray) -> FreeCompliance:
        """Return some of the presses, of rising indices (k,)."""
        rows = np.isin(self.readings.press, presses)
        return replace(
            self,
            readings=self.readings.some(presses),
            displacement_m=self.displacement_m[rows],
            contacts=self.contacts.some(presses),
            unit_compliance=self.unit_compliance[presses],
            growth=None if self.growth is None else self.growth[presses],
        )

    def chain(self, effects: Sequence[Effect]) -> Chain:
        """Return the chain with some effects."""
        contacts = self.contacts
        return Chain(
            self.readings, effects, contacts.radius_m, contacts.profile, self.poisson_ratio,
            contacts.curvature_per_m, self.growth,
        )  # fmt: skip

    def part(self, effect: Effect, start: Values) -> EffectInModel:
        """Return an effect with its bounds and values to start from."""
        return EffectInModel(effect, effect.bounded(self.readings, self.state), dict(start))

    def shows(self, effect: Effect) -> bool:
        """Whether press curves can show an effect: not if it acts on compliances alone."""
        return effect.link != "body" and effect.untestable(self.readings) is None

    def begun(self, effect: Effect, initial: Values) -> EffectInModel:
        """Return an effect from given values, or from its null and the middle of its grid."""
        grid = effect.grid(self.readings, self.state)
        return self.part(effect, initial or {**grid[len(grid) // 2], **effect.null})

    @cached_property
    def _slopes(self) -> np.ndarray:
        """Each press's own travel over force, (j,) m/N."""
        r, d = self.readings, self.displacement_m
        slope = np.bincount(r.press, r.force_n * d) / np.bincount(r.press, r.force_n**2)
        usual = float(np.median(slope[slope > 0])) if (slope > 0).any() else 1.0
        return np.where(slope > 0, slope, usual)

    @cached_property
    def felt(self) -> np.ndarray:
        """Whether each press (j,) met resistance: its force rises well above the noise."""
        r = self.readings
        travel = np.bincount(r.press, r.force_n * self.displacement_m, r.presses)
        least = self.settings.felt * self.noise.force_n
        felt = (r.peak_force_n[r.first] > least) & (travel > 0)
        return felt if felt.any() else np.ones_like(felt)

    def fit(
        self,
        parts: Sequence[EffectInModel],
        compliance: np.ndarray | None = None,
        weight: np.ndarray | None = None,
    ) -> FreeComplianceFit:
        """Fit effects, from their starts, and the compliances beside them.

        `weight` (j,) is that of each press, beside its own.

        Raises
        ------
        InadmissibleError
            The start gives numbers that are not finite.
        """
        weight = self.felt * (1.0 if weight is None else weight)
        best = self._fit(parts, compliance, weight)
        if best.unknowns == 0:
            return best
        for _ in range(self.settings.reweighted):
            found = self._fit(best.parts, best.compliance, weight * best.weight)
            settled = found.misfit > best.misfit - self.settings.ftol
            best = found if found.misfit < best.misfit else best
            if settled:
                break
        return best

    def residual(
        self, found: FreeComplianceFit, log_c: np.ndarray, log_e: np.ndarray, growth: np.ndarray
    ) -> np.ndarray:
        """Return the whitened residual (m,) beside a fit's effects on other bodies.

        `log_c`, `log_e` and `growth` (j,) are those of the compliance, the modulus under the tip
        and the contact, see `identify.effects.sphere`.
        """
        chain = replace(self.chain([part.effect for part in found.parts]), growth=growth)
        c, e = np.exp(log_c), np.exp(log_e)
        judged = judge(chain, c, e, self.displacement_m, self.noise, found.values)
        return self._white(judged, judged.residual_m)

    def compared(self, found: FreeComplianceFit) -> FreeComplianceFit:
        """Return a fit with the chi-square by which presses of one place differ in compliance.

        The effects' parameters move towards equal compliances as far as the curves let them. A
        stiffness that goes smoothly with the order of pressing is taken off: bodies soften.
        """
        place = numbered(places_of(self.readings))
        weight = found.weight
        again = int(np.sum(weight > 0)) - len(np.unique(place[weight > 0])) - 2
        if again <= 0:
            return found
        u = np.concatenate([np.empty(0), *(part.to_scaled() for part in found.parts)])
        chain = self.chain([part.effect for part in found.parts])
        log_c, judged, columns, follow = self._eliminate(
            chain, found.parts, u, found.values, np.log(found.compliance)
        )
        c, press = np.exp(log_c), self.readings.press
        at = OperatingPoint(c, e := self.unit_compliance / c, judged.latent_force_n, found.values)
        own = self._white(judged, chain.by_log_compliance(at))
        weight = weight * np.bincount(press, own**2, len(c))
        course = self.readings.order[:, None] / max(self.readings.order.max(), 1)
        course = np.hstack([course, np.log1p(self.settings.early * course)])
        held = np.hstack([np.zeros((len(columns), 2)), columns])
        between = disagreement(np.log(e), weight, place, np.hstack([course, -follow]), held)
        return replace(found, between=between, again=again)

    def _fit(
        self, parts: Sequence[EffectInModel], compliance: np.ndarray | None, weight: np.ndarray
    ) -> FreeComplianceFit:
        """Fit with given weights (j,) of the presses."""
        root, most = np.sqrt(weight)[self.readings.press], self.settings.longest_step
        chain = self.chain([part.effect for part in parts])
        log_c = np.log(self._slopes if compliance is None else compliance)
        at, follow, latent = np.zeros(0), np.zeros((len(log_c), 0)), None
        latest: dict[bytes, FreeComplianceFit] = {}

        def residuals(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            nonlocal log_c, at, follow, latent
            values = effect_values(parts, u)
            if len(at):
                log_c = log_c + np.clip(follow @ (u - at), -most, most)
            log_c, judged, columns, follow = self._eliminate(chain, parts, u, values, log_c, latent)
            at, latent = u, judged.latent_force_n
            r = self._white(judged, judged.residual_m)
            latest.clear()
            latest[u.tobytes()] = FreeComplianceFit(
                tuple(parts), values, self.readings.press, np.exp(log_c), r, judged.residual_m,
                judged.residual_m / judged.slope, _at_bound(parts, values), self.felt,
                self.settings,
            )  # fmt: skip
            columns = -root[:, None] * columns
            # A step that no derivative leads to (the instant of a jump) would shorten all others
            columns[:, np.linalg.norm(columns, axis=0) < self.settings.unfelt] = 0.0
            return root * r, columns

        start = np.concatenate([np.empty(0), *(part.to_scaled() for part in parts)])
        if len(start) == 0:
            residuals(start)
            return latest[start.tobytes()]
        sought = [p for part in parts for p in part.parameters]
        lower = np.array([p.to_scaled(p.lower) for p in sought])
        upper = np.array([p.to_scaled(p.upper) for p in sought])
        found = minimize_gauss_newton(
            residuals,
            start,
            bounds=(lower, upper),
            ftol=self.settings.ftol,
            rtol=self.settings.rtol,
            max_evaluations=self.settings.max_evaluations,
        )
        if found.x.tobytes() not in latest:
            residuals(found.x)
        fit = latest[found.x.tobytes()]
        parts = tuple(replace(part, start=fit.values[part.effect.name]) for part in parts)
        return replace(fit, parts=parts)

    def _eliminate(
        self,
        chain: Chain,
        parts: Sequence[EffectInModel],
        u: np.ndarray,
        values: Mapping[str, Values],
        log_c: np.ndarray,
        latent: np.ndarray | None = None,
    ) -> tuple[np.ndarray, Judged, np.ndarray, np.ndarray]:
        """Best ln C (j,) for given effects, the readings there, columns (m, q) beyond C.

        It begins at the `latent` forces (m,) of effects nearby, if there are any. Returned last is
        the derivative (j, q) of the best ln C by the effects' parameters.
        """
        press, presses = self.readings.press, self.readings.presses
        most, widest = self.settings.longest_step * self.felt, self.settings.widest
        usual = float(np.median(np.log(self._slopes)))
        # To a press of noise alone any compliance fits, also none at all: it has the usual one
        log_c = np.where(self.felt, log_c, usual)
        kept, least, last = log_c, np.full(presses, np.inf), np.zeros(presses)
        count = np.maximum(np.bincount(press, minlength=presses), 1)
        for number in range(self.settings.compliance_steps + 1):
            if number == self.settings.compliance_steps:
                log_c = kept
            c = np.exp(log_c)
            e = self.unit_compliance / c
            judged = judge(
                chain, c, e, self.displacement_m, self.noise, values, latent, KeptSlope(chain)
            )
            latent = judged.latent_force_n
            r = self._white(judged, judged.residual_m)
            own = self._white(judged, chain.by_log_compliance(OperatingPoint(c, e, latent, values)))
            square = np.maximum(np.bincount(press, own**2, presses), 1e-30)
            short = np.bincount(press, own * r, presses) / square
            travel = self._white(judged, self.displacement_m)
            travel = np.bincount(press, own * travel, presses) / square
            step = np.clip(_in_logarithms(short, travel), -most, most)
            if not np.isfinite(step).all():
                raise InadmissibleError("the effects leave a press without a finite compliance")
            # Under a strong stiffening Newton's steps overshoot: to and fro, or to where no slope
            # leads back; one such press would end the whole search
            misfit = np.bincount(press, r**2, presses)
            lost = misfit > self.settings.lost * least
            kept, least = np.where(lost, kept, log_c), np.where(lost, least, misfit)
            step = np.where(lost, (kept - log_c) / 2, step)
            most, last = np.where(step * last < 0, most / 2, most), step
            moved = np.clip(log_c + step, usual - widest, usual + widest) - log_c
            own_error = np.sqrt(np.maximum(misfit / count, 1.0) / square)
            if np.max(np.abs(moved) / own_error) < self.settings.compliance_tol:
                break
            log_c = log_c + moved
        columns = self._columns(chain, parts, u, c, e, judged.latent_force_n)
        columns = self._white(judged, columns)
        shares = np.empty((presses, columns.shape[1]))
        for k in range(columns.shape[1]):
            shares[:, k] = np.bincount(press, own * columns[:, k], presses) / square
            columns[:, k] -= own * shares[press, k]
        return np.log(c), judged, columns, -shares

    def _white(self, judged: Judged, change_m: np.ndarray) -> np.ndarray:
        """Whiten changes (m,) or (m, q) by the noise and the errors of first touch and lag."""
        sigma = judged.sigma_m
        errors = np.column_stack([np.full_like(sigma, self.noise.touch_m), self._lag_m])
        errors /= sigma[:, None]
        return decorrelated((change_m.T / sigma).T, errors, self.readings.press)

    @cached_property
    def _lag_m(self) -> np.ndarray:
        return lag_error_m(self.noise, self.readings, self.displacement_m)

    def _columns(
        self,
        chain: Chain,
        parts: Sequence[EffectInModel],
        u: np.ndarray,
        c: np.ndarray,
        e: np.ndarray,
        latent: np.ndarray,
    ) -> np.ndarray:
        """Difference quotients (m, q) of the prediction by the scaled parameters."""
        at = OperatingPoint(c, e, latent, effect_values(parts, u))
        traced, found = TracedChain(chain, at), np.empty((len(latent), len(u)))
        owner = [part.effect.name for part in parts for _ in part.parameters]
        for k, name in enumerate(owner):
            sides = []
            for sign in (1.0, -1.0):
                moved = u.copy()
                moved[k] += sign * _STEP
                sides.append(traced.with_values(name, effect_values(parts, moved)[name]))
            found[:, k] = (sides[0] - sides[1]) / (2 * _STEP)
        return found


def _in_logarithms(short: np.ndarray, travel: np.ndarray) -> np.ndarray:
    """Step of ln C (j,) at which the modelled travel, a power of C, becomes the measured one.

    `short` (j,) is what is missing of the measured `travel` (j,), both over the travel's derivative
    by ln C. Newton's own step, `short`, comes back from a travel that is far too long too slowly.
    """
    modelled = travel - short
    power = (travel > 0) & (modelled > 0)
    ratio = np.divide(travel, modelled, out=np.ones_like(travel), where=power)
    return np.where(power, modelled * np.log(ratio), short)


def _at_bound(parts: Sequence[EffectInModel], values: Mapping[str, Values]) -> tuple[str, ...]:
    held = []
    for part in parts:
        for p in part.parameters:
            own = values[part.effect.name][p.name]
            slack = 1e-9 * (p.upper - p.lower)
            searched = [b for side, b in (("lower", p.lower), ("upper", p.upper))
                        if p.natural not in (side, "both")]  # fmt: skip
            ends = [b for b in searched if b != p.null]
            if any(abs(own - b) <= slack for b in ends):
                held.append(f"{part.effect.name}.{p.name}")
    return tuple(held)
