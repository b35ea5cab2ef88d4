"""A body with some surfaces held, solved for its loads: directly, or a large one iteratively."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from fem.contact.contacts import Contacts
from fem.errors import SolverError
from fem.linear.assembly import Stiffness
from fem.linear.support import Foundation
from fem.mesh.mesh import Mesh
from fem.palpation.layered_half_space import SkinCompliance, skin_compliance
from fem.palpation.skin import Membrane, Skin
from fem.solve.block_matrix import BlockMatrix
from fem.solve.direct import Pattern, Solver
from fem.solve.mixed_precision import (
    PreconditionerFactory,
    SinglePrecisionFactors,
    conjugate_gradients,
)
from fem.solve.two_grid import NU_LIMIT, TwoGrid

#: Unknowns from which iterations are faster than factors in double precision.
LARGE = 100_000
#: Part of the rows up to which loads count as sparse.
FEW = 0.02


class ConstrainedBody:
    """A body with some surfaces held: its matrix, its loads and the springs under its base."""

    def __init__(
        self, mesh: Mesh, nu: float, held: tuple[str, ...], weights: sp.csr_array, solver: Solver,
        resting: str, skin: tuple[str, Contacts], iterative_from: int = LARGE,
    ) -> None:  # fmt: skip
        self.stiffness = Stiffness(mesh, nu, held)
        columns = 3 * self.stiffness.free_nodes[:, None] + np.arange(3)
        self._loads = weights[:, columns.ravel()].T.tocsc()
        self._solver, self._resting, self._skin = solver, resting, skin
        self._iterative_from = iterative_from

    @property
    def loads(self) -> np.ndarray:
        """The loads (3 f, j), made at each call: of hundreds of presses they take 100 MB."""
        return self._loads.toarray(order="F")

    @cached_property
    def pattern(self) -> Pattern:
        """The analysed pattern, for any right-hand sides."""
        return self._solver.analyse(self.stiffness.indptr, self.stiffness.indices)

    @cached_property
    def loaded_pattern(self) -> Pattern:
        """The analysed pattern, for the loads: where few rows bear them, that saves a third."""
        rows = np.unique(self._loads.indices)
        if not len(rows) or len(rows) > FEW * self._loads.shape[0]:
            return self.pattern
        s = self.stiffness
        return self._solver.analyse(s.indptr, s.indices, loaded=rows)

    @cached_property
    def iterative(self) -> list[PreconditionerFactory]:
        """Ways to solve without factors in double precision; none where they gain nothing.

        A way that fails is not tried again.
        """
        if self._loads.shape[0] < self._iterative_from:
            return []
        s = self.stiffness
        ways: list[PreconditionerFactory] = []
        if s.poisson_ratio <= NU_LIMIT:
            ways.append(TwoGrid(s.mesh.nodes[s.free_nodes], self._solver))
        if self._solver.single_precision:
            ways.append(
                SinglePrecisionFactors(
                    lambda: self._solver.analyse(s.indptr, s.indices, approximate=True)
                )
            )
        return ways

    def solve(self, values: np.ndarray) -> np.ndarray:
        """Return the displacements (3 f, j) under all loads for values of the matrix."""
        matrix = None
        while self.iterative:
            way = self.iterative[0]
            if matrix is None:
                matrix = BlockMatrix.of_upper(self.stiffness.indptr, self.stiffness.indices, values)
            with suppress(SolverError):  # too rough, or not positive definite in single precision
                preconditioner = way.prepare(matrix, values)
                return conjugate_gradients(matrix, preconditioner, self.loads, way.most)
            del self.iterative[0]
        return self.loaded_pattern.factorize(values).solve(self.loads)

    @cached_property
    def foundation(self) -> Foundation:
        """The springs under the surface that is not held."""
        return Foundation(self.stiffness, self._resting)

    @cached_property
    def membrane(self) -> Membrane:
        """The membrane of the surface that may bear a skin."""
        return Membrane(self.stiffness, self._skin[0])

    def near_skin(self, skin: Skin) -> SkinCompliance:
        """D of each press by a skin, less the membrane's part."""
        contacts, nu = self._skin[1], self.stiffness.poisson_ratio
        return skin_compliance(contacts.radius_m, *skin, nu, contacts.profile_code, True)
