"""Body, tips, presses and noise of a blind trial: those of the paper's block, or drawn anew."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from models import USUAL_RADIUS_M, PressProgram, grid_program

if TYPE_CHECKING:
    from palpmap.blind.trial import Trial
    from sim.body import TruthMap

RADII_M = {1: (0.005,), 2: (0.003, 0.010)}
SMALL_RADII_M = {1: (0.005,), 2: (0.003, 0.007)}  # a tip of 10 mm would reach over its edges
PRESSES_PER_SIDE = 9
SMALL = 2 / 3  # edges of a small trial's block, over those of the usual one
SMALL_PER_SIDE, SMALL_DIVISIONS, SMALL_CELL_M = 6, (10, 10, 5), 0.012
MIXED = {"shuffled": True, "force_shares": (0.5, 1.5), "rested": True}
"""Additions of a mixed scan to the plain one's places, see `models.press_program.grid_program`."""
RIM = 1.5  # radii of the tip from a varied block's edges to the first presses
TRAVEL = 0.7  # radii of the tip that a varied half-space would give way
DISPLACEMENT_NOISE, FORCE_NOISE = 0.006, 0.017  # of travel and force, as on the paper's block


@dataclass(frozen=True)
class Layout:
    """What is pressed, with what, where, and how well it is measured.

    Attributes
    ----------
    size_m : edges of the block
    truth : its map
    program : the presses
    poisson_ratio : of the block
    noise : one standard deviation of displacement (m) and force (N); None for the laboratory's own
    divisions : of the truth's finer mesh; None for the laboratory's own
    cell_m : size of the model's cells that the study states; None for none
    """

    size_m: tuple[float, float, float]
    truth: "TruthMap"
    program: PressProgram
    poisson_ratio: float
    noise: tuple[float, float] | None = None
    divisions: tuple[int, int, int] | None = None
    cell_m: float | None = None

    @property
    def radii_m(self) -> tuple[float, ...]:
        """Radii of the tips, m."""
        return tuple(np.unique(self.program.radius_m).tolist())

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of `sim.bench.planted_scan` that differ from its own."""
        given = {
            "size_m": self.size_m,
            "poisson_ratio": self.poisson_ratio,
            "noise": self.noise,
            "divisions": self.divisions,
        }
        return {name: value for name, value in given.items() if value is not None}


def usual_layout(
    trial: "Trial", per_side: int | None = None, truth: "TruthMap | None" = None
) -> Layout:
    """Return the paper's block or the small one, pressed on a grid over all of it.

    Parameters
    ----------
    per_side : presses along each edge, None for 9, or 6 of a small trial
    truth : the body, None for that of `draw_map`
    """
    from sim.body import PAPER_SIZE_M, HiddenBody

    scale = SMALL if trial.small else 1.0
    x, y, z = (round(scale * edge, 6) for edge in PAPER_SIZE_M)
    mixed: dict[str, Any] = MIXED if trial.mixed else {}
    return Layout(
        (x, y, z),
        truth or draw_map(trial.seed, scale),
        grid_program(
            (x, y, z),
            per_side or (SMALL_PER_SIDE if trial.small else PRESSES_PER_SIDE),
            (SMALL_RADII_M if trial.small else RADII_M)[trial.radii],
            seed=trial.seed,
            **mixed,
        ),
        HiddenBody().poisson_ratio,
        divisions=SMALL_DIVISIONS if trial.small else None,
        cell_m=SMALL_CELL_M if trial.small else None,
    )


def draw_map(seed: int, scale: float = 1.0) -> "TruthMap":
    """Draw a body: background 4 to 8 kPa and one inclusion in the middle, 2 to 6 times as stiff.

    `scale` is that of all lengths.
    """
    from sim.body import PAPER_SIZE_M, Inclusion, TruthMap

    rng = np.random.default_rng([seed, 12])
    background = float(rng.uniform(4000, 8000))
    x, y = rng.uniform(0.35, 0.65, 2) * PAPER_SIZE_M[:2]
    centre = (float(x), float(y), PAPER_SIZE_M[2] - float(rng.uniform(0.008, 0.022)))
    weight = background * (float(rng.uniform(2, 6)) - 1)
    radius = scale * float(rng.uniform(0.008, 0.014))
    x, y, z = (scale * at for at in centre)
    return TruthMap(background, (Inclusion(weight, (x, y, z), radius),))


def varied_layout(trial: "Trial") -> Layout:
    """Draw a block and a scan of it that have little in common with the paper's.

    Edges of 4 to 25 cm; a tip of 1.5 to 8 mm (a second one of twice its radius); 36 to 121 presses
    1 to 3 radii apart, on any part of the top; Poisson's ratio 0.3 to 0.499; a background of 1 to
    200 kPa; an inclusion 0.2 to 0.5 or 2 to 6 times as stiff, 1 to 2.2 radii wide and as deep as
    a tip feels it.
    """
    from sim.body import Inclusion, TruthMap

    rng = np.random.default_rng([trial.seed, 14])
    tip = _log_uniform(rng, 0.0015, 0.008)
    radii = (tip, 2 * tip)[: trial.radii]
    x = _log_uniform(rng, 0.04, 0.25)
    y = x * _log_uniform(rng, 0.6, 1 / 0.6)
    z = max(min(x, y) * float(rng.uniform(0.2, 0.7)), 5 * tip)
    count, rim = int(rng.integers(6, 12)), RIM * radii[-1]
    step = min(tip * float(rng.uniform(1, 3)), (min(x, y) - 2 * rim) / (count - 1))
    width = step * (count - 1)
    corner = rim + rng.uniform(size=2) * np.maximum(np.array([x, y]) - 2 * rim - width, 0)
    poisson_ratio = float(rng.choice([0.3, 0.45, 0.49, 0.499]))
    background = _log_uniform(rng, 1e3, 2e5)
    factor = float(rng.uniform(*([(0.2, 0.5), (2, 6), (2, 6)][int(rng.integers(3))])))
    radius = tip * float(rng.uniform(1, 2.2))
    depth = min(radius * float(rng.uniform(0.8, 1.8)), 0.8 * z)
    at = corner + width * rng.uniform(0.25, 0.75, 2)
    centre = (float(at[0]), float(at[1]), z - depth)
    truth = TruthMap(background, (Inclusion(background * (factor - 1), centre, radius),))
    force = TRAVEL * 2 * tip**2 * background / (1 - poisson_ratio**2)
    program = _program(trial, radii, corner, step, count, force)
    noise = DISPLACEMENT_NOISE * TRAVEL * tip, FORCE_NOISE * force
    return Layout((x, y, z), truth, program, poisson_ratio, noise, _divisions((x, y, z)))


def _program(
    trial: "Trial",
    radii_m: tuple[float, ...],
    corner_m: np.ndarray,
    step_m: float,
    count: int,
    force_n: float,
) -> PressProgram:
    """Lay a grid of presses on a part of the top; force is that of the first tip."""
    mixed: dict[str, Any] = MIXED if trial.mixed else {}
    edge = step_m * (count - 1)
    grid = grid_program(
        (edge, edge, edge),
        count,
        radii_m,
        force_n * USUAL_RADIUS_M / radii_m[0],
        trial.seed,
        margin_share=0.0,
        **mixed,
    )
    return replace(grid, x_m=grid.x_m + corner_m[0], y_m=grid.y_m + corner_m[1])


def _divisions(size_m: Sequence[float]) -> tuple[int, int, int]:
    """Return divisions of the truth's mesh into near cubes, as many as on the paper's block."""
    from sim.body import DIVISIONS

    cell = np.cbrt(np.prod(size_m) / np.prod(DIVISIONS))
    x, y, z = (max(round(edge / cell), 4) for edge in size_m)
    return x, y, z


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
