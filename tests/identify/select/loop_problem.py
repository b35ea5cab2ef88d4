"""A small scan, body and model on which the diagnosis is tested: 25 presses on a block.

The readings come from a finer mesh of another family with the near field of each press, the model
from a coarser one with its own; effects are planted here by formulas of their own.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.effects.readings import Readings
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from models.scan import Scan

SIZE = (0.06, 0.06, 0.03)
NU = 0.45
TRUE = GaussianMap(5000.0, (Inclusion(15000.0, 0.028, 0.034, 0.02, 0.008),))
NOISE = Noise(2e-5, 5e-3)
PEAK_N = 0.3


def points() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0.01, 0.05, 5), np.linspace(0.01, 0.05, 5))
    return np.column_stack([x.ravel(), y.ravel(), np.full(25, SIZE[2])])


def contacts(radius_m: float = 0.004) -> Contacts:
    down = np.tile([0.0, 0.0, -1.0], (25, 1))
    return Contacts(points(), down, np.full(25, radius_m))


@cache
def true_compliance(modulus: Callable[[np.ndarray], np.ndarray] = TRUE.modulus) -> np.ndarray:
    """Compliances (25,) of the true body: two meshes extrapolated, cells split the other way."""
    pair = [
        PalpationModel(block_mesh(SIZE, n, split="alternating"), NU, contacts())
        for n in ((6, 6, 4), (10, 10, 6))
    ]
    model = RefinedModel(*pair)
    return model.evaluate(modulus(model.points_m)).compliance


@cache
def mechanics() -> BodyMechanics:
    coarse, fine = (
        PalpationModel(block_mesh(SIZE, n), NU, contacts()) for n in ((5, 5, 3), (8, 8, 5))
    )
    own = BodyMechanics(
        coarse, RefinedModel(coarse, fine), lambda nu: PalpationModel(coarse.mesh, nu, contacts())
    )
    return own.corrected(TRUE, own.state())


@cache
def uncorrected() -> BodyMechanics:
    """The coarse mesh alone, which is then the truth as well; it keeps its models elsewhere."""
    own = mechanics()
    return replace(own, fine=None, correction=replace(own.correction, ratio=1.0, trend=None))


def timing(seed: int) -> tuple[np.ndarray, ...]:
    """Press, time, phase and true force of 25 presses with random rests."""
    rng = np.random.default_rng(1000 + seed)
    share = np.r_[np.arange(1, 9) / 8, np.ones(8), 1 - np.arange(1, 7) / 6]
    within = np.r_[np.arange(1, 9) / 8, 1 + 2 * np.arange(1, 9) / 8, 3 + np.arange(1, 7) / 6]
    start = np.cumsum(rng.uniform(4.1, 5.0, 25))
    press = np.repeat(np.arange(25), 22)
    phase = np.tile(np.array(["load"] * 8 + ["hold"] * 8 + ["unload"] * 6), 25)
    return press, (start[:, None] + within).ravel(), phase, PEAK_N * np.tile(share, 25)


def scan(displacement_m: np.ndarray, force_n: np.ndarray, seed: int) -> Scan:
    """The table of readings with noise added to both columns."""
    rng = np.random.default_rng(seed)
    press, time, phase, _ = timing(seed)
    return Scan(
        press=press,
        time_s=time,
        phase=phase,
        point_m=points()[press],
        direction=np.tile([0.0, 0.0, -1.0], (len(press), 1)),
        force_n=force_n + NOISE.force_n * rng.standard_normal(len(press)),
        displacement_m=displacement_m + NOISE.displacement_m * rng.standard_normal(len(press)),
        probe_radius_m=np.full(len(press), 0.004),
    )


def model(table: Scan, body: BodyMechanics | None = None) -> MeasurementModel:
    """The model of a scan, without effects."""
    box = np.array([[0.0, 0.0, 0.0], SIZE])
    return MeasurementModel(
        Readings.of(table), table.used().displacement_m, NOISE, body or mechanics(),
        parameter_space(TRUE, box),
    )  # fmt: skip
