"""Readings of presses at finite strain, and how they correct accurate linear ones.

A mesh that one can afford is far too stiff under a tip's rim at small strain already
(`fem.near_field.enrichment` repairs that). It serves here only for the departure of a reading from
proportionality: of the same mesh with the same tip, at force F,

    ratio(F) = b.u(F) / (C F),      C = b.u/F at small strain.

How far that ratio can be trusted was measured on a block of 96 x 96 x 48 mm, flat tip a = 5 mm,
nu = 0.49, neo-Hookean, at a depth of 0.9 a in the middle: with a rigid tip of degree 4 it is 0.970,
0.988, 1.001 on 8 x 8 x 4, 12 x 12 x 6, 16 x 16 x 8 graded cells (volumetric locking holds it down),
with mean dilatation 1.000 and 1.026 on the first two, and 1.01 to 1.05 on meshes fitted to the rim:
an error of 3 to 5 %. With a dead pressure it is 1.00 and 1.08 on the first two and rises on and on,
as the pressure's singular rim cuts into the surface. A rigid tip is the one to take for depths
beyond about a/4.

Given the accurate linear compliance C_a of a press, the mesh is loaded to the depth that the body
really has, F' = F C_a/C, since strain depends on depth, and the reading is d(F) = b.u(F') =
C_a F ratio(F'). Derivatives: with the tangent compliance field z = K_T^-1 b,

    d(b.u) = -z . d(f_int)/dE dE + (b.z) dF'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fem.contact.contacts import Contacts, PressedSurface, contact_weights
from fem.errors import SolverError
from fem.finite_strain.assembly import FiniteStrainBody
from fem.finite_strain.hyperelastic import HyperelasticLaw
from fem.finite_strain.load_stepping import Equilibrium, NewtonOptions, PathFollower
from fem.finite_strain.tangent_solver import TipConstraints
from fem.finite_strain.tips import DeadPressure, TipShape
from fem.linear.modulus_samples import checked_modulus
from fem.mesh.mesh import Mesh
from fem.solve.direct import Solver, default_solver
from fem.solve.threads import available_cores, map_over_workers, solver_for_threads


class LoadNotReached(SolverError):
    """Presses that found no equilibrium at some of their forces; `response` has the rest."""

    def __init__(self, message: str, response: FiniteStrainResponse) -> None:
        super().__init__(message)
        self.response = response


@dataclass(frozen=True)
class FiniteStrainResponse:
    """Readings of presses at finite strain, for one modulus field.

    Attributes
    ----------
    forces_n : (j, l) as asked for
    readings_m : (j, l) travel of the tips; NaN where no equilibrium was found
    ratio : (j, l) reading over the linear reading of the same mesh and tip at the same force on it
    tangent_compliance : (j, l) d reading/d force, m/N
    mesh_compliance : (j,) linear compliance of the mesh with the tip, m/N
    reached_n : (j,) the largest force for which there is an equilibrium: the largest asked for, or
        less, with the reason in `messages`
    messages : (j,) empty where all went well
    factorizations, iterations : work done, over all presses
    """

    forces_n: np.ndarray
    readings_m: np.ndarray
    ratio: np.ndarray
    tangent_compliance: np.ndarray
    mesh_compliance: np.ndarray
    reached_n: np.ndarray
    messages: tuple[str, ...]
    factorizations: int
    iterations: int
    _model: FiniteStrainModel = field(repr=False)
    _modulus: np.ndarray = field(repr=False)
    _states: list[list[Equilibrium | None]] = field(repr=False)
    _linear: np.ndarray = field(repr=False)  # (j, 3 f) linear fields of 1 N
    _scale: np.ndarray = field(repr=False)  # (j,) force on the mesh / force

    @property
    def complete(self) -> bool:
        """True if every force was reached."""
        return not any(self.messages)

    def require_complete(self) -> None:
        """Raise `LoadNotReached` where some force was not reached; the worst press is named."""
        if self.complete:
            return
        failed = [j for j, message in enumerate(self.messages) if message]
        part = self.reached_n / np.maximum(self.forces_n.max(axis=1), 1e-300)
        worst = min(failed, key=lambda j: part[j])
        raise LoadNotReached(
            f"{len(failed)} of {len(self.messages)} presses found no equilibrium at their largest "
            f"force; press {worst} stopped at {self.reached_n[worst]:.3g} of "
            f"{self.forces_n[worst].max():.3g} N: {self.messages[worst]}. Ask for smaller forces, "
            "a larger tip or a finer mesh under the tip",
            self,
        )

    def displacement(self, j: int, level: int) -> np.ndarray:
        """Nodal displacement at press j and force number `level`, (n, 3) m."""
        state = self._states[j][level]
        if state is None:
            raise LoadNotReached(f"press {j} did not reach force {level}", self)
        return self._model.body.nodal(state.u)

    def errors(self, j: int, level: int) -> tuple[float, ...]:
        """Relative error, energy norm, of each iteration at press j and force `level`."""
        state = self._states[j][level]
        return () if state is None else state.errors

    def gradient(
        self, modulus_gradient: np.ndarray, compliance_gradient: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the derivative of the readings with respect to parameters, (j, l, k).

        Parameters
        ----------
        modulus_gradient : (p, k) dE/dtheta at the model's `points_m`
        compliance_gradient : (j, k) derivative of the accurate compliances, where they were given
        """
        direction = np.asarray(modulus_gradient, float)
        scaled = bool((self._scale != 1).any())
        if scaled and compliance_gradient is None:
            raise SolverError(
                "this response was made with accurate compliances: their gradient belongs to it"
            )
        parts = [self._press_gradient(j, direction) for j in range(len(self._states))]
        mesh = np.array([linear for _, linear in parts])  # (j, k) of the mesh's compliance
        result = np.array([readings for readings, _ in parts])
        if scaled:
            c = self.mesh_compliance[:, None]
            change = (np.asarray(compliance_gradient) - self._scale[:, None] * mesh) / c
            tangent = self.tangent_compliance / self._scale[:, None]  # of the mesh, (j, l) m/N
            result += (tangent * self.forces_n)[:, :, None] * change[:, None]
        return result

    def _press_gradient(self, j: int, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradients of press j's readings (l, k) and of its compliance on the mesh (k,)."""
        body = self._model.body
        readings = np.full((self.forces_n.shape[1], direction.shape[1]), np.nan)
        for level, state in enumerate(self._states[j]):
            if state is not None:
                readings[level] = -body.sensitivity(state.u, state.z) @ direction
        return readings, -body.linear_energies(self._linear[j]) @ direction


class FiniteStrainModel:
    """A hyperelastic body on its support, pressed at given contacts.

    Parameters
    ----------
    mesh : four or ten nodes a cell
    poisson_ratio : of the whole body, at small strain
    contacts : the presses
    law : hyperelastic law, `fem.finite_strain.hyperelastic`
    tip : how the tip holds the surface, `fem.finite_strain.tips`; default `DeadPressure()`, whose
        limit of small force is the linear `PalpationModel` without near field (up to nu = 0.49:
        beyond, that one resists the volume's change in the mean over a cell, see
        `fem.linear.assembly.split_lame`)
    fixed_surface : name of the mesh surface that is bonded
    mean_dilatation : see `FiniteStrainBody`
    options : of the iterations
    solver : direct solver, default `fem.solve.direct.default_solver()`
    workers : threads, default as many as there are cores
    """

    def __init__(
        self,
        mesh: Mesh,
        poisson_ratio: float,
        contacts: Contacts,
        law: HyperelasticLaw,
        *,
        tip: TipShape | None = None,
        fixed_surface: str = "base",
        mean_dilatation: bool = False,
        options: NewtonOptions | None = None,
        solver: Solver | None = None,
        workers: int | None = None,
    ) -> None:
        self.body = FiniteStrainBody(mesh, poisson_ratio, law, fixed_surface, mean_dilatation)
        self.contacts = contacts
        stiffness = self.body.stiffness
        self._loads = np.ascontiguousarray(stiffness.restrict(contact_weights(mesh, contacts)).T)
        self._constraints = self._tip_constraints(tip or DeadPressure())
        chosen = solver_for_threads(solver or default_solver())
        options = options or NewtonOptions()

        def follower(_: None, __: int) -> PathFollower:
            pattern = (stiffness.indptr, stiffness.indices)
            first, second = (chosen.analyse(*pattern, approximate=True) for _ in range(2))
            return PathFollower(self.body, (first, second), options)

        count = min(workers or available_cores(), len(contacts))
        self._followers = map_over_workers([None] * count, follower, count)

    def _tip_constraints(self, tip: TipShape) -> list[TipConstraints]:
        surface = PressedSurface(self.body.mesh)
        result = []
        for j in range(len(self.contacts)):
            nodal = tip.constraints(surface, self.contacts, j)[:, self.body.stiffness.free_nodes]
            rows = nodal.reshape(len(nodal), self.body.size)
            dofs = np.flatnonzero(rows.any(axis=0))
            result.append(TipConstraints(dofs, np.ascontiguousarray(rows[:, dofs])))
        return result

    @property
    def points_m(self) -> np.ndarray:
        """Sample points of the modulus, (p, 3) m; those of a `PalpationModel` on this mesh."""
        return self.body.stiffness.points_m

    def evaluate(
        self,
        modulus_pa: np.ndarray | float,
        forces_n: np.ndarray | Sequence[float],
        accurate_compliance: np.ndarray | None = None,
        start: FiniteStrainResponse | None = None,
    ) -> FiniteStrainResponse:
        """Follow every press up to its largest force.

        Parameters
        ----------
        modulus_pa : (p,) Young's modulus at `points_m`, or one number for a homogeneous body
        forces_n : (j, l), or (l,) for all presses alike; in any order, not negative
        accurate_compliance : (j,) m/N, linear, of the same presses and modulus; without it the
            readings are those of the bare mesh
        start : an earlier response with as many forces, as of a modulus nearby, to start from

        Raises
        ------
        SolverError
            Moduli or forces that cannot be computed with. A force without an equilibrium is no
            error here: see `FiniteStrainResponse.reached_n` and `require_complete`.
        """
        count = len(self.contacts)
        modulus = checked_modulus(modulus_pa, len(self.points_m))
        forces = np.atleast_1d(np.asarray(forces_n, float))
        forces = np.broadcast_to(forces, (count, forces.shape[-1])).copy()
        if not (np.isfinite(forces).all() and forces.size and forces.min() >= 0):
            raise SolverError("forces must be finite and not negative: a press pushes")
        accurate = None
        if accurate_compliance is not None:
            accurate = _checked_compliance(accurate_compliance, count)
        if start is not None and start.forces_n.shape != forces.shape:
            raise SolverError(
                "a response to start from needs the same number of presses and forces"
            )
        done = [(f.tangent.factorizations, f.iterations) for f in self._followers]
        presses = map_over_workers(
            self._followers,
            lambda follower, j: self._press(follower, j, modulus, forces[j], accurate, start),
            count,
        )
        work = [
            (f.tangent.factorizations - a, f.iterations - b)
            for f, (a, b) in zip(self._followers, done, strict=True)
        ]
        return self._response(modulus, forces, presses, accurate, work)

    def _press(
        self,
        follower: PathFollower,
        j: int,
        modulus: np.ndarray,
        forces: np.ndarray,
        accurate: np.ndarray | None,
        start: FiniteStrainResponse | None,
    ) -> tuple[Equilibrium, list[Equilibrium | None], float, str]:
        """Linear field, states in the order of the forces, largest force on the mesh, message."""
        if follower.tangent.modulus_pa is not modulus:
            follower.tangent.begin(modulus)  # in the thread that works with the factor
        rest = follower.press(self._loads[j], self._constraints[j])
        linear = float(self._loads[j] @ rest.z)
        scale = 1.0 if accurate is None else float(accurate[j]) / linear
        order = np.argsort(forces, kind="stable")
        guesses = [None] * len(forces) if start is None else [start._states[j][i] for i in order]
        other = None if start is None else replace(rest, z=start._linear[j])
        found, reached, message = follower.follow(rest, forces[order] * scale, guesses, other)
        states: list[Equilibrium | None] = [None] * len(forces)
        for place, state in zip(order, found, strict=True):
            states[place] = state
        return rest, states, reached, message

    def _response(
        self,
        modulus: np.ndarray,
        forces: np.ndarray,
        presses: list[tuple[Equilibrium, list[Equilibrium | None], float, str]],
        accurate: np.ndarray | None,
        work: list[tuple[int, int]],
    ) -> FiniteStrainResponse:
        linear = np.array([rest.z for rest, *_ in presses])
        compliance = np.einsum("jd,jd->j", self._loads, linear)
        scale = np.ones(len(forces)) if accurate is None else np.asarray(accurate) / compliance
        readings, tangent = (np.full(forces.shape, np.nan) for _ in range(2))
        for j, (_, states, _, _) in enumerate(presses):
            for level, state in enumerate(states):
                if state is not None:
                    readings[j, level] = state.reading_m
                    tangent[j, level] = scale[j] * (self._loads[j] @ state.z)
        expected = (compliance * scale)[:, None] * forces
        ratio = np.divide(readings, expected, out=np.ones(forces.shape), where=expected > 0)
        reached = np.array([reached for *_, reached, _ in presses]) / scale
        for array in (forces, readings, ratio, tangent, compliance, reached, scale):
            array.setflags(write=False)
        return FiniteStrainResponse(
            forces_n=forces,
            readings_m=readings,
            ratio=ratio,
            tangent_compliance=tangent,
            mesh_compliance=compliance,
            reached_n=reached,
            messages=tuple(message for *_, message in presses),
            factorizations=sum(f for f, _ in work),
            iterations=sum(i for _, i in work),
            _model=self,
            _modulus=modulus,
            _states=[states for _, states, _, _ in presses],
            _linear=linear,
            _scale=scale,
        )


def _checked_compliance(accurate: np.ndarray, count: int) -> np.ndarray:
    """Return accurate compliances (j,) as numbers to scale forces with."""
    found = np.asarray(accurate, float)
    if found.shape != (count,) or not (np.isfinite(found).all() and found.min() > 0):
        raise SolverError(
            f"accurate compliances must be {count} positive finite numbers in m/N, one a press; "
            f"got {found if found.size <= count else found.shape}"
        )
    return found
