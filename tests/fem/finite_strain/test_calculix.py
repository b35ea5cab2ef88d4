"""One press at finite strain, on the same mesh, against CalculiX (independent code and element)."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fem import Contacts, block_mesh
from fem.contact.contacts import contact_weights
from fem.finite_strain.hyperelastic import NeoHookean
from fem.finite_strain.load_stepping import NewtonOptions
from fem.finite_strain.model import FiniteStrainModel
from fem.linear.assembly import lame
from fem.mesh.mesh import Mesh
from fem.solve.direct import default_solver

CCX = shutil.which("ccx")
SIZE = (0.06, 0.06, 0.03)
MODULUS = 6e3


def deck(mesh: Mesh, weights: np.ndarray, force: float, c10: float, d1: float) -> str:
    """Input of a static, geometrically nonlinear run, all numbers in m, N, Pa.

    A field of a line may have 20 characters. Mid-edges are numbered as in
    `fem.mesh.mesh.TET_EDGES`.
    """

    def rows(label: str, table: np.ndarray) -> list[str]:
        return [label, *(", ".join(map(str, row)) for row in table.tolist())]

    numbers = np.arange(1, len(mesh.nodes) + 1)
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in zip(numbers, mesh.nodes,
                                                                         strict=True)]  # fmt: skip
    cells = np.column_stack([np.arange(1, len(mesh.cells) + 1), mesh.cells + 1])
    lines += rows("*ELEMENT, TYPE=C3D10, ELSET=BODY", cells)
    lines += rows("*NSET, NSET=BASE", mesh.surface_nodes("base")[:, None] + 1)
    lines += ["*BOUNDARY", "BASE, 1, 3", "*MATERIAL, NAME=SOFT", "*HYPERELASTIC, NEO HOOKE",
              f"{c10:.12e}, {d1:.12e}", "*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT",
              "*STEP, NLGEOM, INC=200", "*STATIC", "0.1, 1.0, 1e-4, 0.2", "*CLOAD"]  # fmt: skip
    node, axis = np.nonzero(weights)
    loads = force * weights[node, axis]
    lines += [f"{n + 1}, {a + 1}, {f:.12e}" for n, a, f in zip(node, axis, loads, strict=True)]
    return "\n".join([*lines, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def displacement_by_calculix(folder: Path, text: str, nodes: int) -> np.ndarray:
    (folder / "press.inp").write_text(text)
    done = subprocess.run(
        [str(CCX), "-i", "press"], cwd=folder, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout[-2000:]
    blocks = re.split(
        r"displacements \(vx,vy,vz\).*?time\s+(\S+)\n", (folder / "press.dat").read_text()
    )
    assert float(blocks[-2]) == pytest.approx(1.0)
    table = np.array([line.split() for line in blocks[-1].splitlines() if line.strip()], float)
    u = np.zeros((nodes, 3))
    u[table[:, 0].astype(int) - 1] = table[:, 1:]
    return u


def calculix_force(model: FiniteStrainModel, u: np.ndarray, c10: float, d1: float) -> np.ndarray:
    """Internal forces (n, 3) of W = C10 (I1 J^(-2/3) - 3) + (J - 1)^2/D1, the law of CalculiX."""
    body = model.body
    f = np.eye(3) + np.einsum("eia,eqib->eqab", u[body.mesh.cells], body.gradients)
    j = np.linalg.det(f)[..., None, None]
    h = np.linalg.inv(f).swapaxes(-1, -2)
    i1 = np.einsum("eqab,eqab->eq", f, f)[..., None, None]
    stress = 2 * c10 * j ** (-2 / 3) * (f - i1 / 3 * h) + 2 / d1 * (j - 1) * j * h
    nodal = np.einsum("eq,eqab,eqib->eia", body.weights_m3, stress, body.gradients)
    force = np.zeros_like(u)
    np.add.at(force, body.mesh.cells, nodal)
    return force


def solved_with_calculix_law(
    model: FiniteStrainModel, u: np.ndarray, load: np.ndarray, c10: float, d1: float
) -> np.ndarray:
    """Equilibrium (n, 3) with the law of CalculiX, from u on; our tangent as an approximate one."""
    body, free = model.body, model.body.stiffness.free_nodes
    pattern = default_solver().analyse(body.stiffness.indptr, body.stiffness.indices)
    modulus = np.full(len(model.points_m), MODULUS)
    u = u.copy()
    for _ in range(100):
        missing = (load - calculix_force(model, u, c10, d1))[free].ravel()
        if np.linalg.norm(missing) < 1e-9 * np.linalg.norm(load):
            return u
        factor = pattern.factorize(body.tangent_values(u[free].ravel(), modulus))
        u[free] += 0.5 * factor.solve(missing).reshape(-1, 3)
    raise AssertionError("no equilibrium with the law of CalculiX")


@pytest.mark.slow
@pytest.mark.skipif(CCX is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize(
    ("nu", "force", "apart"), [(0.45, 1.5, 0.02), (0.49, 3.0, 0.01), (0.49, 0.3, 0.002)]
)
def test_a_press_agrees_with_calculix(nu, force, apart, tmp_path):
    # CalculiX knows another compressible neo-Hookean law: the same at small strain with C10 = mu/2
    # and 2/D1 = the bulk modulus, and where J = 1. So the readings come together as nu nears 1/2;
    # with the other law in our equations the two codes agree at any nu.
    mesh = block_mesh(SIZE, (4, 4, 2))
    contacts = Contacts([(0.03, 0.03, 0.03)], (0, 0, -1), 0.012)
    model = FiniteStrainModel(mesh, nu, contacts, NeoHookean(), options=NewtonOptions(rtol=1e-9))
    lam, mu = (MODULUS * value for value in lame(nu))
    c10, d1 = mu / 2, 2 / (lam + 2 * mu / 3)
    response = model.evaluate(MODULUS, [force])
    weights = contact_weights(mesh, contacts)[0]
    reference = displacement_by_calculix(
        tmp_path, deck(mesh, weights, force, c10, d1), len(mesh.nodes)
    )
    reading = float((weights * reference).sum())
    ours = response.readings_m[0, 0]
    assert ours == pytest.approx(reading, rel=apart)
    u = solved_with_calculix_law(model, response.displacement(0, 0), force * weights, c10, d1)
    assert float((weights * u).sum()) == pytest.approx(reading, rel=1e-4)
    np.testing.assert_allclose(u, reference, atol=1e-3 * np.abs(reference).max())
    if force > 2:
        assert ours > 0.2 * SIZE[2]
        assert abs(response.ratio[0, 0] - 1) > 0.02
