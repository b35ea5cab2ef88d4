"""From forces to what the robot reports: the measurement chain with the effects that it has.

d = reading(response(contact(C force(F)))), see `identify.effects.effect`. Everything beyond the
body's compliances is arithmetic on the m readings, so that its derivatives are differenced: one
more pass for each, at no cost beside the finite elements'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identify.effects.effect import Effect, Pressing, Values
from identify.noise import Noise
from identify.readings import Readings

_STEP = 1e-4  # of compliance, local modulus and typical sizes, for difference quotients


@dataclass(frozen=True)
class Chain:
    """The links beyond the body, for m readings of j presses.

    Attributes
    ----------
    readings : what was measured
    effects : those that act, in the order of the catalogue
    radius_m : (j,) contact radius that the body's model assumes
    profile : "flat" or "hertz", its pressure
    poisson_ratio : of the body
    """

    readings: Readings
    effects: Sequence[Effect]
    radius_m: np.ndarray
    profile: str
    poisson_ratio: float

    def predict(
        self,
        compliance: np.ndarray,
        modulus: np.ndarray,
        force_n: np.ndarray,
        values: Mapping[str, Values],
    ) -> np.ndarray:
        """Displacement (m,) for compliances and local moduli (j,), forces (m,) and effects' values.

        `values` holds, by the name of each effect, its parameters' values.
        """
        r = self.readings
        force = force_n
        for effect in self.effects:
            force = effect.force(r, force, values[effect.name])
        travel = compliance[r.press] * force
        pressing = Pressing(
            compliance[r.press],
            modulus[r.press],
            self.radius_m[r.press],
            self.poisson_ratio,
            "hertz" if self.profile == "hertz" else "flat",
        )
        for effect in self.effects:
            travel = effect.contact(r, pressing, force, travel, values[effect.name])
        for effect in self.effects:
            travel = effect.response(r, force, travel, values[effect.name])
        for effect in self.effects:
            travel = effect.reading(r, force, travel, values[effect.name])
        return travel

    def by_force(
        self,
        compliance: np.ndarray,
        modulus: np.ndarray,
        force_n: np.ndarray,
        values: Mapping[str, Values],
    ) -> np.ndarray:
        """Return the derivative (m,) of each displacement by its own force, m/N.

        The forces of a press are changed up and down in turn, so that what an effect remembers of
        earlier readings cancels.
        """
        step = _STEP * max(float(np.abs(force_n).max()), 1e-12)
        sign = np.where(np.arange(len(force_n)) % 2 == 0, step, -step)
        up = self.predict(compliance, modulus, force_n + sign, values)
        down = self.predict(compliance, modulus, force_n - sign, values)
        return (up - down) / (2 * sign)

    def by_body(
        self,
        compliance: np.ndarray,
        modulus: np.ndarray,
        force_n: np.ndarray,
        values: Mapping[str, Values],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives (m,) by compliance and local modulus of the reading's press."""
        up = self.predict((1 + _STEP) * compliance, modulus, force_n, values)
        down = self.predict((1 - _STEP) * compliance, modulus, force_n, values)
        by_compliance = (up - down) / (2 * _STEP * compliance[self.readings.press])
        if not any(effect.link == "contact" for effect in self.effects):
            return by_compliance, np.zeros_like(by_compliance)
        up = self.predict(compliance, (1 + _STEP) * modulus, force_n, values)
        down = self.predict(compliance, (1 - _STEP) * modulus, force_n, values)
        return by_compliance, (up - down) / (2 * _STEP * modulus[self.readings.press])


def latent_force(
    residual_m: np.ndarray, slope: np.ndarray, force_n: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residual's standard deviation s (m,) and the best estimate F^ (m,) of the force.

    s^2 = sd_d^2 + slope^2 sd_F^2 and F^ = F + slope sd_F^2 / s^2 e; see `identify.misfit`.
    """
    variance = noise.displacement_m**2 + (slope * noise.force_n) ** 2
    return np.sqrt(variance), force_n + slope * noise.force_n**2 / variance * residual_m
