"""Solutions with the tangent stiffness of a pressed body, the tip's constraints obeyed.

A rigid tip adds linear constraints B u = 0 (`fem.finite_strain.tips`). After each solve the
factor's own response to the constraints' forces is taken off, u - A^-1 B' (B A^-1 B')^-1 B u; among
the displacements so obtained the problem has no constraints any more. A surface that is pressed
hard would be unstable without the tip that holds it, so that its tangent alone cannot be
factorised: then it is propped by springs that are taken off again in the solution
(`_hold_propped`).

Factors may be in single precision: they then precondition the iterations of `solve_exactly`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from fem.errors import SolverError
from fem.finite_strain.assembly import FiniteStrainBody
from fem.solve.direct import Factor, Pattern


class TipConstraints(NamedTuple):
    """Constraints `rows @ u[dofs] = 0`: orthonormal rows (k, t), dofs (t,) of the free."""

    dofs: np.ndarray
    rows: np.ndarray

    def without_reactions(self, forces: np.ndarray) -> np.ndarray:
        """Take off, in place, the part of forces (3 f,) that the constraints balance.

        Rounding errors then scale with the remainder, which vanishes in equilibrium.
        """
        if len(self.rows):
            forces[self.dofs] -= (self.rows @ forces[self.dofs]) @ self.rows
        return forces


class _Held(NamedTuple):
    """A factor with its correction for the tip: u - responses (rows u[dofs])."""

    factor: Factor
    rows: np.ndarray
    responses: np.ndarray


class TangentSolver:
    """Factors of one body's tangent, for one press after another; for one thread.

    Parameters
    ----------
    body : what is pressed
    patterns : two analysed patterns, of which one keeps the linear factor

    Attributes
    ----------
    modulus_pa : (p,) of the last `begin`
    factorizations : done so far
    """

    def __init__(self, body: FiniteStrainBody, patterns: tuple[Pattern, Pattern]) -> None:
        self.body = body
        self.factorizations = 0
        self.modulus_pa: np.ndarray = np.empty(0)
        self._patterns = patterns
        self._linear: Factor | None = None
        self._linear_values = np.empty(0)

    def begin(self, modulus_pa: np.ndarray) -> None:
        """Factorise the linear stiffness of a modulus field (p,), which all presses share."""
        self.modulus_pa = modulus_pa
        self._linear_values = self.body.tangent_values(np.zeros(self.body.size), modulus_pa)
        self._linear = self._factorize(self._patterns[0], self._linear_values)

    def turn_to(self, constraints: TipConstraints) -> None:
        """Take up a press, with the linear factor."""
        assert self._linear is not None, "begin() comes first"
        self.constraints = constraints
        self._held_linear = self._held = self._hold(self._linear)

    def back_to_linear(self) -> None:
        """Solve with the linear factor again."""
        self._held = self._held_linear

    def _factorize(self, pattern: Pattern, values: np.ndarray) -> Factor:
        self.factorizations += 1
        return pattern.factorize(values)

    def _respond(self, factor: Factor, forces: np.ndarray) -> np.ndarray:
        """Displacements (3 f, k) under forces (k, t) on the constrained degrees of freedom."""
        loads = np.zeros((self.body.size, len(forces)), order="F")
        loads[self.constraints.dofs] = forces.T
        return factor.solve(loads)

    def _hold(self, factor: Factor) -> _Held:
        dofs, rows = self.constraints
        if not len(rows):
            return _Held(factor, rows, np.empty((self.body.size, 0)))
        responses = self._respond(factor, rows)
        return _Held(factor, rows, responses @ np.linalg.inv(rows @ responses[dofs]))

    def refactor(self, u: np.ndarray) -> None:
        """Factorise the tangent at u.

        Raises
        ------
        SolverError
            The body is unstable, the tip's constraints included; the linear factor is back.
        """
        self.back_to_linear()
        values = self.body.tangent_values(u, self.modulus_pa)
        try:
            held = self._hold(self._factorize(self._patterns[1], values))
        except SolverError:
            if not len(self.constraints.dofs):
                raise
            held = self._hold_propped(values)
        self._held = held

    def _hold_propped(self, values: np.ndarray) -> _Held:
        """Exact solution of a tangent K that is positive definite only with the tip's constraints.

        A = K + s T T' is factorised, with springs s at the constrained degrees of freedom, u[dofs]
        = T'u = v; in the solution, u = A^-1 (r + T w), they are taken off again: w = s v + rows' l,
        rows v = 0.
        """
        dofs, rows = self.constraints
        diagonal = self.body.stiffness.indptr[dofs]
        spring = 0.0
        for stiffer in (1.0, 10.0, 100.0):
            spring = stiffer * float(np.abs(values[diagonal]).mean())
            propped = values.copy()
            propped[diagonal] += spring
            try:
                factor = self._factorize(self._patterns[1], propped)
                break
            except SolverError:
                continue
        else:
            raise SolverError("the tangent is not positive definite away from the tip")
        t, k = len(dofs), len(rows)
        responses = self._respond(factor, np.eye(t))
        s = responses[dofs]
        # positive definite, where rows v = 0, if and only if v'(S^-1 - s)v is
        _, _, right = np.linalg.svd(rows)
        free = right[k:]
        try:
            np.linalg.cholesky(free @ (np.linalg.inv(s) - spring * np.eye(t)) @ free.T)
        except np.linalg.LinAlgError as error:
            raise SolverError("the tangent is not positive definite with the tip") from error
        system = np.block([[np.eye(t) - spring * s, -s @ rows.T], [rows, np.zeros((k, k))]])
        solved = np.linalg.inv(system)[:, :t]
        forces = spring * solved[:t] + rows.T @ solved[t:]
        return _Held(factor, np.eye(t), -responses @ forces)

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Displacement that balances rhs up to the constraints' own forces, and obeys them."""
        held = self._held
        u = held.factor.solve(rhs)
        if len(held.rows):
            _take_off(u, held.responses, held.rows @ u[self.constraints.dofs])
        return u

    def solve_linear(self, rhs: np.ndarray, rtol: float) -> np.ndarray:
        """Displacement of the unstrained body, to a relative error rtol of the energy norm.

        Raises
        ------
        SolverError
            Single precision is not enough for this body even to iterate with.
        """
        self.back_to_linear()
        found = self.solve_exactly(self._linear_values, rhs, self.solve(rhs), rtol, 100)
        if found is None:
            raise SolverError(
                "the linear stiffness is too close to singular to be solved with; is Poisson's "
                "ratio too close to 0.5?"
            )
        return found

    def solve_exactly(
        self,
        values: np.ndarray,
        rhs: np.ndarray,
        start: np.ndarray,
        rtol: float,
        max_iterations: int,
    ) -> np.ndarray | None:
        """Solve with the tangent of these values (nnz,), the held factor as preconditioner.

        Conjugate gradients, to a relative error rtol of the energy norm; None if it takes too long.
        """
        load = self.constraints.without_reactions(rhs.copy())
        x = start.copy()
        r = load - self.product(values, x)
        y = self.solve(r)
        p, rho, first = y.copy(), float(r @ y), float(load @ x)
        for _ in range(max_iterations):
            if abs(rho) <= rtol**2 * first:  # where nothing is left, rounding decides on its sign
                return x
            if not rho > 0:
                return None
            ap = self.product(values, p)
            curvature = float(p @ ap)
            if not curvature > 0:
                return None
            x += rho / curvature * p
            r -= rho / curvature * ap
            y = self.solve(r)
            new = float(r @ y)
            p = y + new / rho * p
            rho = new
        return x if abs(rho) <= rtol**2 * first else None

    def product(self, values: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the forces (3 f,) of a tangent's values (nnz,) on x, without those of the tip."""
        s = self.body.stiffness
        forces = np.empty_like(x)
        _product(forces, x, s.indptr, s.indices, values)
        return self.constraints.without_reactions(forces)


@numba.njit(cache=True, nogil=True)
def _product(y, x, indptr, indices, values):
    """Write to y the product of a symmetric matrix, given by its upper triangle, with x."""
    y[:] = 0.0
    for i in range(len(indptr) - 1):
        s = values[indptr[i]] * x[i]
        for k in range(indptr[i] + 1, indptr[i + 1]):
            j = indices[k]
            s += values[k] * x[j]
            y[j] += values[k] * x[i]
        y[i] += s


@numba.njit(cache=True, nogil=True)
def _take_off(u, responses, amounts):
    for i in range(len(u)):
        for k in range(len(amounts)):
            u[i] -= responses[i, k] * amounts[k]
