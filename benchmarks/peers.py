"""The paper's mesh in other programs: the same work, the same answer, the time it takes.

Each takes part where it is installed (`pip install -e ".[bench]"`) and runs in a process of its
own. Part of `python benchmarks/run.py`.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version

import numpy as np

from fem.contact.contacts import contact_weights
from fem.linear.assembly import lame
from identify.map.parameters import parameter_space
from identify.optimize.bfgs import minimize_bfgs_residuals
from identify.optimize.optimizers import OPTIMIZERS
from palpmap.paper.identical_twin import (
    FORCE_N,
    FTOL,
    POISSON_RATIO,
    SIZE_M,
    paper_model,
    paper_tests,
    solve_test,
    symbol,
)

TEST = next(test for test in paper_tests() if test.name == "V")
FITS, SCIKIT_FEM_RUNS, TORCH_FEM_PRESSES = 5, 5, 4
DIFFERENCE = 1e-6  # step of the finite differences, in scaled coordinates
SAME = 1e-6  # largest relative difference that counts as the same answer


def seconds_of(work: Callable[[], object], runs: int) -> float:
    """Median time of a call, after one that does not count."""
    work()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def ours() -> dict[str, float]:
    """Seconds here: Test V, an evaluation, with its derivatives, factor and solve alone."""
    model = paper_model()
    modulus = TEST.correct.modulus(model.points_m)
    body = model._bonded
    values = body.stiffness.values(modulus[: len(body.stiffness.points_m)])  # no contact points
    solve_test(TEST, model, OPTIMIZERS["bfgs"])
    results = [solve_test(TEST, model, OPTIMIZERS["bfgs"]) for _ in range(FITS)]
    result = results[0]
    return {
        "fit": float(np.median([result.seconds for result in results])),
        "evaluations": result.evaluations,
        "error": float(result.relative_error.max()),
        "all": seconds_of(lambda: model.evaluate(modulus).sensitivity, 9),
        "bare": seconds_of(lambda: body.pattern.factorize(values).solve(body.loads), 9),
    }


def differenced_fit() -> tuple[int, float]:
    """Return the evaluations that Test V takes with differences, and its largest error.

    Counted with this model, which gives the same compliances and is fast enough to be asked.
    """
    model = paper_model()
    box = np.array([np.zeros(3), SIZE_M])
    space = parameter_space(TEST.initial, box, [symbol(t).name for t in TEST.theta])
    count = 0

    def compliances(u: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        return FORCE_N * model.evaluate(space.to_map(u).modulus(model.points_m)).compliance

    observed = FORCE_N * model.evaluate(TEST.correct.modulus(model.points_m)).compliance
    scale = np.linalg.norm(observed)

    def residuals(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = compliances(u)
        columns = [
            (compliances(u + step) - here) / DIFFERENCE for step in DIFFERENCE * np.eye(len(u))
        ]
        return (here - observed) / scale, np.column_stack(columns) / scale

    end = minimize_bfgs_residuals(
        residuals, space.to_scaled(TEST.initial), bounds=space.bounds, ftol=FTOL
    )
    found, true = space.to_map(end.x).values, TEST.correct.values
    return count, float(np.abs(np.asarray(found) / np.asarray(true) - 1).max())


def scikit_fem() -> tuple[float, float]:
    """Seconds of one evaluation without derivatives, and how far its compliances are from ours."""
    import skfem
    from scipy.sparse.linalg import splu
    from skfem.helpers import ddot, sym_grad, trace

    model = paper_model()
    mesh = model.mesh
    modulus = TEST.correct.modulus(model.points_m)
    basis = skfem.Basis(
        skfem.MeshTet(mesh.nodes.T.copy(), mesh.cells.T.copy(), sort_t=False),
        skfem.ElementVector(skfem.ElementTetP1()),
        intorder=1,
    )
    lam, mu = lame(POISSON_RATIO)

    @skfem.BilinearForm
    def stiffness(u, v, w):
        a, b = sym_grad(u), sym_grad(v)
        return w["young"] * (lam * trace(a) * trace(b) + 2 * mu * ddot(a, b))

    dofs = basis.nodal_dofs  # (3, n)
    free = dofs[:, model.stiffness.free_nodes].T.ravel()
    loads = contact_weights(mesh, model.contacts)[:, model.stiffness.free_nodes]
    loads = np.asfortranarray(loads.reshape(len(loads), -1).T)

    def compliances() -> np.ndarray:
        matrix = stiffness.assemble(basis, young=modulus[: len(mesh.cells), None])
        factor = splu(matrix[free][:, free].tocsc())
        return np.einsum("dj,dj->j", loads, factor.solve(loads))

    reference = model.evaluate(modulus).compliance
    apart = float(np.abs(compliances() / reference - 1).max())
    return seconds_of(compliances, SCIKIT_FEM_RUNS), apart


def torch_fem() -> tuple[float, float]:
    """Seconds of one press with its gradient, and how far both are from ours."""
    import torch
    from torchfem import Solid
    from torchfem.materials import IsotropicElasticity3D

    torch.set_default_dtype(torch.float64)
    model = paper_model()
    mesh = model.mesh
    modulus = TEST.correct.modulus(model.points_m)
    response = model.evaluate(modulus)
    sensitivity = response.sensitivity[:, : len(mesh.cells)]  # then those of the contact points
    young = torch.tensor(modulus[: len(mesh.cells)], requires_grad=True)
    solid = Solid(
        torch.tensor(mesh.nodes),
        torch.tensor(mesh.cells.astype(np.int64)),
        IsotropicElasticity3D(young, torch.full_like(young, POISSON_RATIO)),
    )
    held = torch.zeros(len(mesh.nodes), 3, dtype=torch.bool)
    held[torch.tensor(mesh.surface_nodes("base").astype(np.int64))] = True
    solid.constraints = held
    loads = torch.tensor(contact_weights(mesh, model.contacts))
    apart = 0.0

    def press(j: int) -> None:
        nonlocal apart
        solid.forces = loads[j]
        compliance = (solid.solve(differentiable_parameters=young)[0] * loads[j]).sum()
        (gradient,) = torch.autograd.grad(compliance, young)
        far = np.abs(gradient.numpy() - sensitivity[j]).max()
        apart = max(
            apart,
            abs(float(compliance.detach()) / response.compliance[j] - 1),
            far / np.abs(sensitivity[j]).max(),
        )

    chosen = np.linspace(0, len(loads) - 1, TORCH_FEM_PRESSES + 2).astype(int)[1:-1]
    press(chosen[0])
    start = time.perf_counter()
    for j in chosen:
        press(j)
    return (time.perf_counter() - start) / len(chosen), apart


def alone(work: Callable) -> tuple[float, float]:
    """Run in a process of its own: libraries do not share their threads then."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        seconds, apart = pool.submit(work).result()
    if apart > SAME:
        raise RuntimeError(f"{work.__name__} has another answer: {apart:.1e} apart")
    return seconds, apart


def here(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def table() -> list[str]:
    """Return the lines of the table."""
    own = ours()
    presses = len(paper_model().contacts)
    lines = [
        "| work on the paper's mesh | program | s | times as long | answers apart |",
        "|---|---|---:|---:|---:|",
        f"| Test V, the whole fit | palpmap, {own['evaluations']} evaluations | {own['fit']:.1f} | "
        f"1 | {own['error']:.0e} of the truth |",
    ]
    notes = []
    if here("skfem"):
        count, error = differenced_fit()
        seconds, apart = alone(scikit_fem)
        whole = count * seconds
        lines.append(
            f"| | scikit-fem {version('scikit-fem')}, SuperLU, finite differences, {count} "
            f"evaluations of {seconds:.2f} s | {whole:.0f} | {whole / own['fit']:.0f} | "
            f"{apart:.0e} |"
        )
        notes.append(
            f"scikit-fem's evaluations are counted in the same BFGS on differences (error at its "
            f"end {error:.0e}) and multiplied with the median time of {SCIKIT_FEM_RUNS}."
        )
    else:
        notes.append("scikit-fem is not installed and was not compared.")
    lines.append(f"| {presses} presses and all derivatives | palpmap | {own['all']:.3f} | 1 | |")
    lines.append(
        f"| | bare factor and solve by the direct solver | {own['bare']:.3f} | "
        f"{own['bare'] / own['all']:.2f} | |"
    )
    if here("torchfem"):
        seconds, apart = alone(torch_fem)
        whole = presses * seconds
        lines.append(
            f"| | torch-fem {version('torch-fem')}, {presses} presses of {seconds:.2f} s | "
            f"{whole:.0f} | {whole / own['all']:.0f} | {apart:.0e} |"
        )
        notes.append(
            f"torch-fem solves one load case at a time: {TORCH_FEM_PRESSES} were measured."
        )
    else:
        notes.append("torch-fem is not installed and was not compared.")
    notes.append("JAX-FEM was not compared: it needs petsc4py, of which PyPI has the source only.")
    return [*lines, "", " ".join(notes)]


if __name__ == "__main__":
    print("\n".join(table()))
