"""Comparison of a chain with readings whose both columns have noise."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from identify.effects.base import Values
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.noise import Noise
from identify.measurement.settings import LATENT_FORCE, LatentForceSettings


class Judged(NamedTuple):
    """Comparison of a chain with m readings, with both columns' noise.

    Attributes
    ----------
    residual_m : measured less predicted displacement at the measured force
    sigma_m : its standard deviation
    latent_force_n : best estimate of the force
    slope : travel over force there, m/N
    """

    residual_m: np.ndarray
    sigma_m: np.ndarray
    latent_force_n: np.ndarray
    slope: np.ndarray


def judge(
    chain: Chain,
    compliance: np.ndarray,
    modulus: np.ndarray,
    displacement_m: np.ndarray,
    noise: Noise,
    values: Mapping[str, Values],
    latent_n: np.ndarray | None = None,
    slope_of: Callable[[OperatingPoint], np.ndarray] | None = None,
    settings: LatentForceSettings = LATENT_FORCE,
) -> Judged:
    """Compare a chain with the readings: errors in both columns.

    If travel and force are not proportional, the chain is linearised at the latent force instead of
    the measured one, in a few rounds: under a ball the slope at a small force differs much from the
    slope at that force with its noise. Source: Fuller, "Measurement Error Models", 3.2.

    `latent_n` (m,) is the latent force of a chain nearby, from which fewer rounds are needed;
    `slope_of` gives slopes of travel over force, where some are known (`KeptSlope`).
    """
    force, slope_of = chain.readings.force_n, slope_of or chain.by_force
    most = settings.steepest * compliance[chain.readings.press]
    at = force if latent_n is None or not chain.nonlinear else latent_n
    last = moved = np.zeros(len(force))
    for _ in range(settings.rounds if chain.nonlinear else 1):
        point = OperatingPoint(compliance, modulus, at, values)
        slope = np.clip(slope_of(point), -most, most)
        predicted = chain.predict(point) + slope * (force - at)
        residual = displacement_m - predicted
        sigma, latent = latent_force(residual, slope, force, noise)
        step = latent - at
        if np.abs(step).max(initial=0.0) < settings.tol * chain.readings.largest_force_n:
            at = latent
            break
        # Near no force the steep slope of a ball leads to and fro across it: between both, a secant
        turned = step * last < 0
        move = np.where(turned, step * moved / np.where(turned, last - step, 1.0), step)
        at, last, moved = at + move, step, move
    return Judged(residual, sigma, at, slope)


def latent_force(
    residual_m: np.ndarray, slope: np.ndarray, force_n: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residual's standard deviation s (m,) and the best estimate F^ (m,) of the force.

    s^2 = sd_d^2 + slope^2 sd_F^2 and F^ = F + slope sd_F^2 / s^2 e; see
    `identify.measurement.errors_in_variables`.
    """
    variance = noise.displacement_m**2 + (slope * noise.force_n) ** 2
    return np.sqrt(variance), force_n + slope * noise.force_n**2 / variance * residual_m
