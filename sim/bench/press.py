"""The presses on the bench: a scan of a virtual block without the arm, with planted effects.

Everything is computed noise-free, effect by effect,

    F(t) -> C F -> contact -> response -> sensors -> samples,

then sampled, and noise is added to both columns. The effects are those of `sim.planted`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models import Scan
from sim.planted.bench import PARTS, Bench
from sim.planted.effect import HiddenEffect

DISPLACEMENT_NOISE_M = 2e-5
FORCE_NOISE_N = 5e-3

Planted = tuple[HiddenEffect, Mapping[str, float]]
"""An effect and its values by name."""


@dataclass(frozen=True)
class Pressed:
    """Noise-free readings, both (j, s) for s samples a press.

    Attributes
    ----------
    force_n : as the sensor reads it
    displacement_m : as the robot reports it
    """

    force_n: np.ndarray
    displacement_m: np.ndarray


def press(bench: Bench, planted: Sequence[Planted] = ()) -> Pressed:
    """Make all presses, noise-free.

    Parameters
    ----------
    planted : hidden effects with their values; within each link in this order
    """
    body = bench.body
    for effect, values in planted:
        body = effect.body(body, values)
    bench = replace(bench, body=body)
    force = bench.force_n
    travel = bench.elastic_m
    for effect, values in planted:
        travel = effect.contact(bench, travel, values)
    for effect, values in planted:
        travel = effect.response(bench, travel, values)
    for effect, values in planted:
        force, travel = effect.sensor(bench, force, travel, values)
    return Pressed(force[:, bench.sampled], travel[:, bench.sampled])


def record(
    bench: Bench,
    pressed: Pressed,
    seed: int,
    displacement_noise_m: float = DISPLACEMENT_NOISE_M,
    force_noise_n: float = FORCE_NOISE_N,
) -> Scan:
    """Return the scan: readings with noise.

    Parameters
    ----------
    seed : of the noise
    displacement_noise_m, force_noise_n : one standard deviation of a reading
    """
    presses, samples = pressed.force_n.shape
    rng = np.random.default_rng([seed, 2])
    program = bench.program
    top = np.full(presses, bench.body.size_m[2])
    points = np.column_stack([bench.points_m, top])
    count = presses * samples
    return Scan(
        press=np.repeat(np.arange(presses), samples),
        time_s=bench.time_s[:, bench.sampled].ravel(),
        phase=np.tile(np.array(PARTS)[bench.part[bench.sampled]], presses),
        point_m=np.repeat(points, samples, axis=0),
        direction=np.tile([0.0, 0.0, -1.0], (count, 1)),
        force_n=pressed.force_n.ravel() + force_noise_n * rng.standard_normal(count),
        displacement_m=pressed.displacement_m.ravel()
        + displacement_noise_m * rng.standard_normal(count),
        probe_radius_m=np.repeat(program.radius_m, samples),
    )
