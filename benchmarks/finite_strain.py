"""Presses at finite strain, all together here and one a run in CalculiX, on the same mesh.

Part of `python benchmarks/run.py`. CalculiX takes part where `ccx` is installed; it gets a few
presses, to the largest force with its own automatic increments and both cores, and its time for all
presses is scaled from those.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from fem import Contacts, PalpationModel, block_mesh
from fem.contact.contacts import contact_weights
from fem.finite_strain.hyperelastic import Fung, NeoHookean
from fem.finite_strain.model import FiniteStrainModel
from fem.finite_strain.tips import DeadPressure, RigidTip
from fem.linear.assembly import lame
from fem.mesh.mesh import Mesh

SIZE_M = (0.096, 0.096, 0.048)
DIVISIONS = (8, 8, 4)
RADIUS_M = 0.005
NU = 0.49
DEEPEST_M = 0.2 * SIZE_M[2]
LEVELS = 5
PRESSES = 9  # a side
CALCULIX_RUNS = 2
CASES = (
    ("neo-Hookean, dead pressure", NeoHookean(), DeadPressure()),
    ("neo-Hookean, rigid tip", NeoHookean(), RigidTip(4)),
    ("Fung b = 1, rigid tip", Fung(1.0), RigidTip(4)),
)


def modulus_at(points: np.ndarray, weight_pa: float = 12e3) -> np.ndarray:
    distance = ((points - [0.030, 0.048, 0.036]) ** 2).sum(axis=1)
    return 6e3 + weight_pa * np.exp(-distance / (2 * 0.010**2))


def row(mesh: Mesh, contacts: Contacts, name: str, law, tip) -> str:
    model = FiniteStrainModel(mesh, NU, contacts, law, tip=tip)
    model.evaluate(6e3, [0.01])  # loads compiled code
    modulus = modulus_at(model.points_m)
    linear = PalpationModel(mesh, NU, contacts)
    accurate = linear.evaluate(modulus_at(linear.points_m)).compliance
    forces = np.linspace(0, 1, LEVELS + 1)[1:] * (DEEPEST_M / accurate)[:, None]
    start = time.perf_counter()
    cold = model.evaluate(modulus, forces, accurate)
    middle = time.perf_counter()
    moved = modulus_at(model.points_m, weight_pa=12.5e3)
    warm = model.evaluate(moved, forces, accurate, start=cold)
    end = time.perf_counter()
    warm.gradient(np.ones((len(modulus), 5)), np.zeros((len(contacts), 5)))
    last = time.perf_counter() - end
    failed = sum(map(bool, cold.messages))
    work = f"{cold.factorizations / cold.readings_m.size:.2f}"
    return (
        f"| {name} | {middle - start:.1f} | {end - middle:.1f} | {last:.2f} | {work} | {failed} | "
        f"{1e3 * np.nanmax(cold.readings_m):.1f} |"
    )


def deck(mesh: Mesh, weights: np.ndarray, force: float, young: float) -> str:
    """CalculiX's input of one press of a homogeneous neo-Hookean body."""
    lam, mu = (young * value for value in lame(NU))
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(mesh.nodes)]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=BODY"]
    lines += [", ".join(map(str, [k + 1, *(cell + 1)])) for k, cell in enumerate(mesh.cells)]
    lines += ["*NSET, NSET=BASE", *map(str, mesh.surface_nodes("base") + 1)]
    lines += ["*BOUNDARY", "BASE, 1, 3", "*MATERIAL, NAME=SOFT", "*HYPERELASTIC, NEO HOOKE",
              f"{mu / 2:.12e}, {2 / (lam + 2 * mu / 3):.12e}",
              "*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT",
              "*STEP, NLGEOM, INC=200", "*STATIC", f"{1 / LEVELS}, 1.0", "*CLOAD"]  # fmt: skip
    for node, axis in zip(*np.nonzero(weights), strict=True):
        lines.append(f"{node + 1}, {axis + 1}, {force * weights[node, axis]:.12e}")
    return "\n".join([*lines, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def calculix(mesh: Mesh, contacts: Contacts) -> tuple[float, float, int, float]:
    """Seconds of a press in CalculiX; here: of all presses, and how many; readings apart.

    Presses that become unstable under this load before its largest value count in the time here,
    but not among those that CalculiX would have to do.

    A homogeneous neo-Hookean body under dead pressure; CalculiX's law differs in the volumetric
    part, which Poisson's ratio of 0.49 leaves little to do.
    """
    ccx = shutil.which("ccx")
    assert ccx
    model = FiniteStrainModel(mesh, NU, contacts, NeoHookean())
    force = DEEPEST_M / model.evaluate(6e3, [0.01]).mesh_compliance
    levels = np.linspace(0, 1, LEVELS + 1)[1:] * force[:, None]
    start = time.perf_counter()
    here = model.evaluate(6e3, levels)
    ours = time.perf_counter() - start
    reached = np.flatnonzero([not message for message in here.messages])
    weights = contact_weights(mesh, contacts)
    # from the middle outwards: nearer the edges the surface is closer to its limit
    off = np.linalg.norm(contacts.points_m - contacts.points_m.mean(axis=0), axis=1)
    seconds, apart = [], 0.0
    for j in reached[np.argsort(off[reached], kind="stable")][: 2 * CALCULIX_RUNS]:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "press.inp").write_text(deck(mesh, weights[j], force[j], 6e3))
            start = time.perf_counter()
            done = subprocess.run(
                [ccx, "-i", "press"],
                cwd=folder,
                env=os.environ | {"OMP_NUM_THREADS": str(os.cpu_count())},
                capture_output=True,
                text=True,
                timeout=600,
            )
            elapsed = time.perf_counter() - start
            if done.returncode:
                continue  # it found no way to the largest force
            last = displacements(Path(folder) / "press.dat", len(mesh.nodes))
        seconds.append(elapsed)
        apart = max(apart, abs(np.sum(weights[j] * last) / here.readings_m[j, -1] - 1))
        if len(seconds) == CALCULIX_RUNS:
            return float(np.mean(seconds)), ours, len(reached), apart
    raise RuntimeError(f"ccx failed: {done.stdout[-500:]}")


def displacements(path: Path, nodes: int) -> np.ndarray:
    """Displacement (n, 3) m of all nodes at the end of CalculiX's last increment."""
    rows = [line.split() for line in path.read_text().splitlines()]
    numbers = [[float(word) for word in row] for row in rows if len(row) == 4 and row[0].isdigit()]
    last = np.array(numbers[-nodes:])
    if not np.array_equal(last[:, 0], np.arange(1, nodes + 1)):
        raise RuntimeError("CalculiX has not printed all nodes")
    return last[:, 1:]


def table() -> list[str]:
    """Return the lines of the table."""
    mesh = block_mesh(SIZE_M, DIVISIONS)
    place = np.linspace(0.012, 0.084, PRESSES)
    points = [(x, y, SIZE_M[2]) for x in place for y in place]
    contacts = Contacts(points, (0, 0, -1), RADIUS_M)
    lines = [
        f"{len(contacts)} presses at {LEVELS} forces each, down to {1e3 * DEEPEST_M:.1f} mm "
        f"(linear) in a block of {1e3 * SIZE_M[2]:.0f} mm; {3 * len(mesh.nodes):,} unknowns.",
        "",
        "| law and tip | cold s | warm s | derivative s | factorisations a state | not reached | "
        "deepest mm |",
        "|---|---:|---:|---:|---:|---:|---:|",
        *(row(mesh, contacts, *case) for case in CASES),
    ]
    if shutil.which("ccx") is None:
        return [*lines, "", "CalculiX (ccx) is not installed and was not compared."]
    theirs, ours, reached, apart = calculix(mesh, contacts)
    whole = reached * theirs
    return [
        *lines,
        "",
        f"Homogeneous neo-Hookean body, dead pressure: {len(contacts)} presses here {ours:.1f} s, "
        f"of which {reached} reach the largest force before the surface becomes unstable; CalculiX "
        f"{theirs:.1f} s a press, so {whole:.0f} s for these (scaled from {CALCULIX_RUNS}), "
        f"{whole / ours:.0f} times as long. Their readings at the largest force, whose volumetric "
        f"laws differ, are {100 * apart:.2f} % apart.",
    ]


if __name__ == "__main__":
    print("\n".join(table()))
    sys.exit()
