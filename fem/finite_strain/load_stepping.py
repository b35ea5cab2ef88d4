"""One press at rising dead load: quasi-Newton iterations, line search, steps of the load.

The equilibrium u(F) minimises  Pi(u) = W(u) - F b.u,  residual r = F b - f_int(u). The expensive
step is the factorisation of the tangent (20 times an iteration with it). So a factor is kept, at
following iterates and loads too, as the first approximation of a BFGS recursion, and is renewed
when the iterations contract too slowly. Every step must lower Pi or the slope along it. With
`refactor_above = 0` each iterate has its own tangent: Newton's method.

A rigid tip adds linear constraints, which every step obeys (`fem.finite_strain.tangent_solver`):
the search remains one for a minimum without constraints.

At each load the tangent compliance field z = du/dF = K_T^-1 b follows from the converged tangent by
conjugate gradients with the kept factor as preconditioner. It is the adjoint of the reading b.u,
and the slope of the path with which the next load's first guess is extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem.errors import SolverError
from fem.finite_strain.assembly import FiniteStrainBody
from fem.finite_strain.tangent_solver import TangentSolver, TipConstraints
from fem.solve.direct import Pattern

_ADJOINT_ITERATIONS = 20  # more cost as much as a factorisation
_BACKTRACKS = 12
_REST = 1e-3  # of the tolerance, at no load: all readings are told in terms of this compliance


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerances and limits of the iterations.

    Attributes
    ----------
    rtol : iterations, for u and for z, end when the error's energy norm is below this part of the
        solution's. Readings are off by its square (see `Equilibrium.reading_m`; 1e-8 measured at
        1e-4), their derivatives by about as much as it
    refactor_above : number of further iterations that the kept factor may be expected to take,
        beyond which the tangent is factorised anew; zero is Newton's method
    max_iterations : for one load
    smallest_step : load steps are halved down to this part of the largest load, then given up
    """

    rtol: float = 1e-4
    refactor_above: float = 16.0
    max_iterations: int = 40
    smallest_step: float = 1 / 64


@dataclass(frozen=True)
class Equilibrium:
    """A converged state at one load.

    Attributes
    ----------
    force_n : the load
    u : (3 f,) m, displacement
    z : (3 f,) m/N, its derivative with respect to the force
    reading_m : b.u + z.r, r the remaining residual: its error is of second order in that of u
    errors : relative energy norm of each iteration's correction, the first guess's first
    """

    force_n: float
    u: np.ndarray
    z: np.ndarray
    reading_m: float
    errors: tuple[float, ...]


class _NotConverged(Exception):
    """A load step that failed; its text becomes the path's message."""


class PathFollower:
    """Follows presses on one body, one after another; for one thread.

    Parameters
    ----------
    body : what is pressed
    patterns : two analysed patterns of its tangent
    options : see `NewtonOptions`

    Attributes
    ----------
    tangent : holds the factors, and the modulus of the last `tangent.begin`
    iterations : done so far
    """

    def __init__(
        self, body: FiniteStrainBody, patterns: tuple[Pattern, Pattern], options: NewtonOptions
    ) -> None:
        self.body = body
        self.options = options
        self.tangent = TangentSolver(body, patterns)
        self.iterations = 0

    def press(self, load: np.ndarray, constraints: TipConstraints) -> Equilibrium:
        """Turn to one press; return its unloaded state, with the linear compliance field as z.

        load (3 f,) are the contact weights b.
        """
        self._load = load
        self.tangent.turn_to(constraints)
        z = self.tangent.solve_linear(load, _REST * self.options.rtol)
        return Equilibrium(0.0, np.zeros(self.body.size), z, 0.0, ())

    def follow(
        self,
        rest: Equilibrium,
        forces_n: np.ndarray,
        start: Sequence[Equilibrium | None],
        other: Equilibrium | None = None,
    ) -> tuple[list[Equilibrium | None], float, str]:
        """Equilibria of the press at rising forces.

        Parameters
        ----------
        rest : the unloaded state, from `press`
        forces_n : (l,) N, rising, not negative
        start : guess for each force, the equilibrium with another modulus, or None
        other : the unloaded state with that modulus

        Returns
        -------
        The equilibria, None from the first force on that was not reached; the largest force with a
        converged state; the reason for stopping there, empty if no force was missed.
        """
        path = [rest]
        found: list[Equilibrium | None] = []
        apart = [] if other is None else [_difference(rest, other)]
        smallest = self.options.smallest_step * float(forces_n[-1])
        for force, guess in zip(forces_n, start, strict=True):
            step, failed = float(force) - path[-1].force_n, math.inf
            while path[-1].force_n < force:
                target = _next_load(path[-1].force_n, float(force), step, failed, smallest)
                if guess is not None and target == force:
                    # This path smoothly continued, or the other modulus's and the difference so far
                    u = guess.u + (force - guess.force_n) * guess.z + apart[-1].u
                    smooth = _extrapolations(path, target)[0]
                    guesses = [smooth, u + (force - apart[-1].force_n) * apart[-1].z, u]
                    slope = guess.z + _extrapolated_slope(apart, target)
                else:
                    guesses = _extrapolations(path, target)
                    slope = _extrapolated_slope(path, target)
                step = target - path[-1].force_n
                try:
                    path.append(self._equilibrium(target, guesses, slope))
                    step *= 2
                    failed = failed if target < failed else math.inf
                except _NotConverged as reason:
                    self.tangent.back_to_linear()
                    failed = target
                    if step < 2 * smallest:
                        found += [None] * (len(forces_n) - len(found))
                        return found, path[-1].force_n, str(reason)
                path = path[-2:]
            found.append(path[-1])
            if guess is not None and force > apart[-1].force_n:
                apart = [*apart[-1:], _difference(path[-1], guess)]
        return found, path[-1].force_n, ""

    # ------------------------------------------------------------------ one load

    def _equilibrium(
        self, force: float, guesses: list[np.ndarray], slope_guess: np.ndarray
    ) -> Equilibrium:
        u, residual, energy = self._best(guesses, force)
        if self.options.refactor_above == 0:
            self._refactor(u)
        errors: list[float] = []
        memory: list[tuple[np.ndarray, np.ndarray, float]] = []
        rate, fresh = 1.0, self.options.refactor_above == 0
        for _ in range(self.options.max_iterations):
            self.iterations += 1
            step = self._direction(residual, memory)
            slope = float(step @ residual)
            if not slope > 0:
                self._refactor(u)
                memory.clear()
                continue
            # the work of the load bounds the solution's energy norm from below at small strain
            error = math.sqrt(slope / abs(force * float(self._load @ (u + step))))
            if errors:
                rate = error / errors[-1]
            errors.append(error)
            if error < self.options.rtol * max(1.0, 0.3 / max(rate, 0.01)):
                u = u + step
                return self._finished(force, u, errors, slope_guess)
            slow = len(errors) > 1 and self._remaining(error, rate) > self.options.refactor_above
            if slow and not fresh:
                self._refactor(u)
                memory.clear()
                fresh = True
                continue
            fresh = self.options.refactor_above == 0
            u_new, r_new, e_new = self._line_search(force, u, residual, energy, step)
            y = residual - r_new
            curvature = float(y @ (u_new - u))
            if self.options.refactor_above == 0:
                self._refactor(u_new)
            elif curvature > 0:
                memory.append((u_new - u, y, curvature))
            u, residual, energy = u_new, r_new, e_new
        raise _NotConverged(
            f"no convergence in {self.options.max_iterations} iterations at {force:.4g} N "
            f"(relative error {errors[-1] if errors else np.nan:.1g})"
        )

    def _remaining(self, error: float, rate: float) -> float:
        """Estimate the number of further iterations at this rate of contraction."""
        return math.log(self.options.rtol / error) / math.log(rate) if rate < 1 else math.inf

    def _best(
        self, guesses: list[np.ndarray], force: float
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Of some first guesses the one of least potential, with residual and potential."""
        best = None
        for u in guesses:
            residual, energy = self._residual(u, force)
            if np.isfinite(energy) and (best is None or energy < best[2]):
                best = u, residual, energy
        if best is None:
            raise _NotConverged(f"cells invert in every first guess at {force:.4g} N")
        return best

    def _residual(self, u: np.ndarray, force: float) -> tuple[np.ndarray, float]:
        internal, energy = self.body.internal_force(u, self.tangent.modulus_pa)
        residual = self.tangent.constraints.without_reactions(force * self._load - internal)
        return residual, energy - force * float(self._load @ u)

    def _line_search(
        self,
        force: float,
        u: np.ndarray,
        residual: np.ndarray,
        energy: float,
        step: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Halve the step until the potential falls, or the slope along it (for rounding)."""
        slope = float(step @ residual)
        length = 1.0
        for _ in range(_BACKTRACKS):
            trial = u + length * step
            r, e = self._residual(trial, force)
            if np.isfinite(e) and (
                e <= energy - 1e-4 * length * slope or abs(float(step @ r)) <= 0.5 * slope
            ):
                return trial, r, e
            length /= 2
        raise _NotConverged(
            f"no step lowers the energy at {force:.4g} N: cells are about to invert"
        )

    def _direction(
        self, residual: np.ndarray, memory: list[tuple[np.ndarray, np.ndarray, float]]
    ) -> np.ndarray:
        """BFGS's two-loop recursion around the kept factor (Nocedal 1980)."""
        q = residual.copy()
        parts = []
        for s, y, curvature in reversed(memory):
            a = float(s @ q) / curvature
            q -= a * y
            parts.append(a)
        step = self.tangent.solve(q)
        for (s, y, curvature), a in zip(memory, reversed(parts), strict=True):
            step += (a - float(y @ step) / curvature) * s
        return step

    # ------------------------------------------------------------------ factor and adjoint

    def _refactor(self, u: np.ndarray) -> None:
        try:
            self.tangent.refactor(u)
        except SolverError as error:
            raise _NotConverged(
                "the tangent stiffness is not positive definite any more: "
                "the body becomes unstable under the load"
            ) from error

    def _finished(
        self, force: float, u: np.ndarray, errors: list[float], slope_guess: np.ndarray
    ) -> Equilibrium:
        """Check the state and solve for its tangent compliance field."""
        residual, energy = self._residual(u, force)
        if not np.isfinite(energy):
            raise _NotConverged(f"cells invert at {force:.4g} N")
        tangent = self.tangent
        values = self.body.tangent_values(u, tangent.modulus_pa)
        rtol, most = self.options.rtol, _ADJOINT_ITERATIONS
        z = tangent.solve_exactly(values, self._load, slope_guess, rtol, most)
        if z is None:
            self._refactor(u)
            z = tangent.solve_exactly(values, self._load, tangent.solve(self._load), rtol, 100)
        if z is None:
            raise _NotConverged(f"the tangent at {force:.4g} N is too close to singular")
        reading = float(self._load @ u) + float(z @ residual)
        return Equilibrium(force, u, z, reading, tuple(errors))


def _next_load(last: float, asked: float, step: float, failed: float, smallest: float) -> float:
    """Force to try after `last`: a step on, or half-way to a force that failed from farther away.

    That force itself is tried again from nearby, as soon as halves are smaller than the smallest.
    """
    if math.isfinite(failed):
        half = (failed - last) / 2
        return failed if half < smallest else last + half
    return asked if asked - last < 1.001 * step else last + step


def _extrapolations(path: Sequence[Equilibrium], force: float) -> list[np.ndarray]:
    """First guesses at a force from the last one or two states and their slopes."""
    last = path[-1]
    step = force - last.force_n
    guesses = [last.u + step * last.z, last.u]
    if len(path) > 1:
        before = path[-2]
        h = last.force_n - before.force_n
        t = step / h  # cubic of both states and slopes, continued beyond the last
        chord = (last.u - before.u) / h
        second = (2 * last.z + before.z - 3 * chord) / h * h * h
        third = (last.z + before.z - 2 * chord) / (h * h) * h**3
        guesses.insert(0, last.u + step * last.z + t**2 * second + t**3 * third)
        guesses.insert(1, last.u + step * last.z + t**2 * (last.z - chord) * h)
    return guesses


def _extrapolated_slope(path: Sequence[Equilibrium], force: float) -> np.ndarray:
    """Slope at a force, linear in those of the last two states."""
    last = path[-1]
    if len(path) == 1:
        return last.z
    part = (force - last.force_n) / (last.force_n - path[-2].force_n)
    return last.z + part * (last.z - path[-2].z)


def _difference(state: Equilibrium, other: Equilibrium) -> Equilibrium:
    """Change of a state and its slope against those of another modulus, at the same force."""
    u = other.u + (state.force_n - other.force_n) * other.z
    return replace(state, u=state.u - u, z=state.z - other.z)
