"""The paper's six tests as an identical twin: the paper's mesh makes the data and explains them.

This proves derivative and optimiser, not the physics: 3 N on single nodes of a 6 kPa block give
displacements of up to 284 mm in a body 48 mm high. Conditions: Table I of the paper (file
`models/paper_table1.toml`) and its section III.B.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from fem import Contacts, PalpationModel, default_solver, paper_mesh
from fem.solve import Solver, available_cores, map_over_workers, solver_for_threads
from identify.body import BodyMechanics, compliance
from identify.map import GaussianMap, Inclusion, parameter_space
from identify.optimize import Optimizer

FORCE_N = 3.0
POISSON_RATIO = 0.49
DEPTH_M = 0.036
SIZE_M = (0.096, 0.096, 0.048)
CONTACTS_A_SIDE = 9
LARGEST_RELATIVE_ERROR = 1e-6

# With eq. 3 divided by half the sum of squared observations, this gradient tolerance
# (sqrt(2 FTOL)) leaves the parameters within 1e-8.
FTOL = 1e-19


@dataclass(frozen=True)
class Symbol:
    """A parameter under the paper's name: `name` of the map's, `unit`, and units per SI unit."""

    name: str
    unit: str
    per_si: float


def symbol(theta: str) -> Symbol:
    """Return what the paper's w0, w1, qx1, qy1, r1, ... stand for.

    >>> symbol("qx2")
    Symbol(name='inclusion_2.x_m', unit='mm', per_si=1000.0)
    """
    if theta == "w0":
        return Symbol("background_pa", "Pa", 1.0)
    letters, number = theta[:-1], theta[-1]
    field, unit, per_si = {
        "w": ("weight_pa", "Pa", 1.0),
        "qx": ("x_m", "mm", 1e3),
        "qy": ("y_m", "mm", 1e3),
        "r": ("radius_m", "mm", 1e3),
    }[letters]
    return Symbol(f"inclusion_{number}.{field}", unit, per_si)


@dataclass(frozen=True)
class PaperTest:
    """One test of Table I: the parameters sought (paper's names), start and truth."""

    name: str
    theta: tuple[str, ...]
    initial: GaussianMap
    correct: GaussianMap


@dataclass(frozen=True)
class PaperResult:
    """How one test ended.

    `path` (iterations, k) holds the sought parameters in the paper's units, `evaluations` counts
    those of misfit and gradient, `seconds` is the time of the search.
    """

    test: PaperTest
    path: np.ndarray
    evaluations: int
    seconds: float
    message: str

    def values(self, stiffness: GaussianMap) -> np.ndarray:
        """Return the sought parameters (k,) of a map in the paper's units."""
        return _values(stiffness, self.test.theta)

    @property
    def relative_error(self) -> np.ndarray:
        """|found / correct - 1| (k,) of the sought parameters."""
        return np.abs(self.path[-1] / self.values(self.test.correct) - 1)

    @property
    def passed(self) -> bool:
        """Whether every sought parameter is within `LARGEST_RELATIVE_ERROR`."""
        return bool(np.all(self.relative_error <= LARGEST_RELATIVE_ERROR))


def paper_tests() -> tuple[PaperTest, ...]:
    """Read Table I (its reading is explained in the file)."""
    text = files("models").joinpath("paper_table1.toml").read_text(encoding="utf-8")
    return tuple(
        PaperTest(name, tuple(row["theta"]), _table_map(row["initial"]), _table_map(row["correct"]))
        for name, row in tomllib.loads(text).items()
    )


def paper_model(solver: Solver | None = None) -> PalpationModel:
    """Build the paper's block, pressed at 81 single nodes: every second one of the top face."""
    x = np.linspace(0, SIZE_M[0], CONTACTS_A_SIDE)
    points = np.array([(a, b, SIZE_M[2]) for b in x for a in x])
    down = np.array([0.0, 0.0, -1.0])
    contacts = Contacts(points, np.tile(down, (len(points), 1)), np.zeros(len(points)), "nodal")
    return PalpationModel(paper_mesh(), POISSON_RATIO, contacts, solver=solver)


def solve_test(test: PaperTest, model: PalpationModel, optimizer: Optimizer) -> PaperResult:
    """Make a test's observations with the model and find its parameters again."""
    observed = FORCE_N * compliance(model, test.correct)
    scale = float(np.linalg.norm(observed))
    box = np.array([np.zeros(3), SIZE_M])
    free = [symbol(theta).name for theta in test.theta]
    space, mechanics = parameter_space(test.initial, box, free), BodyMechanics.of(model)
    path = []

    def residuals(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        body = mechanics.evaluate(space.to_map(u), mechanics.state())
        gradient = body.by_map[:, list(space.free)] * space.slope(u)
        return (FORCE_N * body.compliance - observed) / scale, FORCE_N * gradient / scale

    began = time.perf_counter()
    result = optimizer(
        residuals,
        space.to_scaled(test.initial),
        bounds=space.bounds,
        ftol=FTOL,
        callback=lambda u, _: path.append(_values(space.to_map(u), test.theta)),
    )
    seconds = time.perf_counter() - began
    return PaperResult(test, np.array(path), result.nfev, seconds, result.message)


def solve_tests(
    tests: Sequence[PaperTest],
    optimizer: Optimizer,
    solved: Callable[[PaperResult], None] = lambda _: None,
) -> list[PaperResult]:
    """Solve several tests, one a core side by side; `solved` is called with each, in its thread.

    Two solves side by side take less time than two threads inside one after the other.
    """
    solver = solver_for_threads(default_solver())
    models = [paper_model(solver) for _ in range(min(available_cores(), len(tests)))]
    # The more is sought, the longer it takes: the longest first, that none is left over at the end
    order = sorted(range(len(tests)), key=lambda i: -len(tests[i].theta))

    def solve(model: PalpationModel, place: int) -> PaperResult:
        result = solve_test(tests[order[place]], model, optimizer)
        solved(result)
        return result

    results = dict(zip(order, map_over_workers(models, solve, len(tests)), strict=True))
    return [results[i] for i in range(len(tests))]


def _table_map(row: dict[str, Any]) -> GaussianMap:
    """Build the map from a row's w0, w1, q1, r1, ... (Pa, mm)."""
    count = sum(key.startswith("q") for key in row)
    inclusions = tuple(
        Inclusion(
            float(row[f"w{i}"]),
            row[f"q{i}"][0] * 1e-3,
            row[f"q{i}"][1] * 1e-3,
            DEPTH_M,
            row[f"r{i}"] * 1e-3,
        )
        for i in range(1, count + 1)
    )
    return GaussianMap(float(row["w0"]), inclusions)


def _values(stiffness: GaussianMap, theta: Sequence[str]) -> np.ndarray:
    """Return the parameters by the paper's names and units."""
    values = dict(zip(stiffness.names, stiffness.values, strict=True))
    return np.array([values[symbol(t).name] * symbol(t).per_si for t in theta])
