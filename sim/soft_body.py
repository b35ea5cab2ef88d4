"""The soft body of the virtual laboratory: the finite element model of all planned presses.

All contacts are solved at once, with one factorisation. The body is linear, so that under a force
F at press j the whole body moves by F times the solution for 1 N there: what comes back to the
contact at each exchange is that column of the tetrahedral solution, not a law fitted to it. The
tip's travel is that of two meshes extrapolated (`fem.refined`), the surface that of the finer one.
The meshes are the laboratory's own (finer than the identifier's and cut differently), and so is
its stiffness map.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from fem import Contacts, PalpationModel, RefinedModel, block_mesh

DIVISIONS = (14, 14, 7)
COARSENING = 0.7
SPLIT = "alternating"


class SoftBody:
    """A block bonded to its base, pressed by a flat tip.

    Parameters
    ----------
    size_m : edges of the block, from the body frame's origin
    modulus : Young's modulus (p,) Pa at points (p, 3) m
    poisson_ratio : of the whole body
    tip_radius_m : of the flat tip
    points_m, directions : (j, 3) contacts, body frame, in the order of the presses
    divisions : of the finer mesh, see `fem.block_mesh`

    Attributes
    ----------
    compliance_m_per_n : (j,) of the presses
    modulus : the truth
    surface_nodes_m : (n, 3) nodes of the free surface, undeformed
    surface_triangles : (t, 3) corners of its triangles, seen from outside anticlockwise
    """

    def __init__(
        self,
        size_m: tuple[float, float, float],
        modulus: Callable[[np.ndarray], np.ndarray],
        poisson_ratio: float,
        tip_radius_m: float,
        points_m: np.ndarray,
        directions: np.ndarray,
        divisions: tuple[int, int, int] = DIVISIONS,
    ) -> None:
        coarser = [max(round(COARSENING * count), 1) for count in divisions]
        mesh, other = (block_mesh(size_m, counts, split=SPLIT) for counts in (divisions, coarser))
        radius = np.full(len(points_m), tip_radius_m)
        contacts = Contacts(points_m, directions, radius, "flat")
        fine = PalpationModel(mesh, poisson_ratio, contacts)
        model = RefinedModel(PalpationModel(other, poisson_ratio, contacts), fine)
        self.modulus = modulus
        solved = model.evaluate(modulus(model.points_m))
        self._response = solved.fine
        self.compliance_m_per_n = np.asarray(solved.compliance)
        self.nodes, self.cells = len(mesh.nodes), len(mesh.cells)
        quadratic = np.vstack([mesh.surface(name) for name in ("top", "sides")])
        self._surface, local = np.unique(_split(quadratic), return_inverse=True)
        self.surface_triangles = local.reshape(-1, 3)
        self.surface_nodes_m = mesh.nodes[self._surface]
        self._unit_displacement = lru_cache(maxsize=4)(self._solve_surface)

    def displacement(self, press: int, force_n: float) -> float:
        """Depth of the tip at a press under a force, m."""
        return float(self.compliance_m_per_n[press]) * force_n

    def tangent(self, press: int, force_n: float) -> float:
        """Local stiffness at a press, N/m; the same at every force."""
        del force_n
        return 1.0 / float(self.compliance_m_per_n[press])

    def surface_displacement(self, press: int, force_n: float) -> np.ndarray:
        """Displacement of `surface_nodes_m` under a force at a press, (n, 3) m.

        The mesh's own field: the sharp dimple at the tip's rim, which `displacement` has in it,
        is rounded off.
        """
        return force_n * self._unit_displacement(press)

    def _solve_surface(self, press: int) -> np.ndarray:
        return self._response.displacement(press)[self._surface]


def _split(triangles: np.ndarray) -> np.ndarray:
    """Four flat triangles for each quadratic one, (4 t, 3)."""
    corners = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    return triangles[:, corners].reshape(-1, 3)
