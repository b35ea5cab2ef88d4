"""Compliance of every press on a body, for any modulus field and support.

One factorisation K = G G' gives all compliances. With y = G^-1 B for the load B of a press and
Y = G^-1 k for the four functions of its near field (`fem.near_field.enrichment`),

    C = y'y + g'alpha,    (a - Y'Y) alpha = g = l - Y'y,    u = G'^-1 (y - Y alpha),

so that only one right-hand side a press goes through both halves of a solve. The derivatives follow
from the same fields, see `fem.palpation.response`.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from fem.contact.contacts import Contacts, PressedSurface, contact_weights
from fem.errors import SolverError
from fem.linear.assembly import Stiffness
from fem.linear.modulus_samples import (
    CLOSE_SAMPLES,
    QuadraticModulus,
    checked_modulus,
    close_points_m,
)
from fem.linear.support import Support, first_order_rest
from fem.mesh.focus import probed_box
from fem.mesh.mesh import Mesh
from fem.near_field.enrichment import Enrichment, close_cells, enrich, neighbourhood
from fem.near_field.points import FUNCTIONS
from fem.palpation.constrained_body import LARGE, ConstrainedBody
from fem.palpation.fibres import FibrePlane, Fibres, checked_fibres, plane_of
from fem.palpation.material import Material
from fem.palpation.response import Response
from fem.palpation.skin import Skin
from fem.solve.direct import Solver, default_solver
from fem.solve.threads import available_cores

__all__ = ["PalpationModel", "Response"]

_GROUP = 16  # presses whose near fields are solved together


class NearFields(NamedTuple):
    """Near fields of a group of presses for one modulus field.

    Attributes
    ----------
    coupling : (j, m, 3 f) k of each function
    energy : (j, m, m) a
    load : (j, m) l
    """

    coupling: np.ndarray
    energy: np.ndarray
    load: np.ndarray


class PalpationModel:
    """A body on its support, pressed at given contacts; evaluated for any modulus field.

    For one thread at a time: it keeps one factor. Threads side by side need a model each.

    Parameters
    ----------
    mesh : four or ten nodes a cell
    poisson_ratio : of the whole body
    contacts : the presses
    fixed_surface : name of the mesh surface that is bonded, where no support is given
    near_field : add the exact near field of each press (see `fem.near_field`); without it the
        result is that of the bare mesh, as in the paper. A nodal contact has none.
    solver : direct solver, default `fem.solve.direct.default_solver()`
    support : of the body, in place of `fixed_surface`
    skin_surface : name of the surface that bears a skin, where one is evaluated
    iterative_from : number of unknowns from which iterations replace factors in double precision
    like : model of the same material and kind of tip, whose near fields serve where cells lie alike
    """

    def __init__(
        self,
        mesh: Mesh,
        poisson_ratio: float,
        contacts: Contacts,
        fixed_surface: str = "base",
        near_field: bool = True,
        solver: Solver | None = None,
        support: Support | None = None,
        skin_surface: str = "top",
        iterative_from: int = LARGE,
        like: PalpationModel | None = None,
    ) -> None:
        self.mesh = mesh
        self.contacts = contacts
        self.support = support or Support(fixed_surface)
        self._skin_surface = skin_surface
        self._iterative_from = iterative_from
        self._solver = solver or default_solver()
        weights = contact_weights(mesh, contacts)
        self._weights = sp.csr_array(weights.reshape(len(contacts), -1))  # few nodes bear a press
        self._bonded = self._hold(poisson_ratio, (self.support.surface, *self.support.held))
        self.stiffness = self._bonded.stiffness
        self._plane: FibrePlane | None = None
        self.enrichment: Enrichment | None = None
        #: cells around the tips, with modulus samples of their own (`fem.linear.modulus_samples`)
        self.close_cells = np.zeros(0, int)
        if near_field and contacts.profile != "nodal":
            surface, presses = PressedSurface(mesh), range(len(contacts))
            with ThreadPoolExecutor(available_cores()) as pool:  # each thread keeps some memory
                places = list(
                    pool.map(lambda j: neighbourhood(self.stiffness, surface, contacts, j), presses)
                )
            self.close_cells = close_cells(mesh, places)
            self.enrichment = enrich(
                self.stiffness, surface, contacts, weights, places, self.close_cells,
                None if like is None else like.enrichment,
            )  # fmt: skip

    def on(self, mesh: Mesh, contacts: Contacts | None = None) -> PalpationModel:
        """Return the same model on another mesh, or under other contacts of this kind."""
        return PalpationModel(
            mesh,
            self.stiffness.poisson_ratio,
            self.contacts if contacts is None else contacts,
            near_field=self.enrichment is not None,
            solver=self._solver,
            support=self.support,
            skin_surface=self._skin_surface,
            iterative_from=self._iterative_from,
            like=self,
        )

    def _hold(
        self, poisson_ratio: float, held: tuple[str, ...], mesh: Mesh | None = None
    ) -> ConstrainedBody:
        return ConstrainedBody(
            mesh or self.mesh,
            poisson_ratio,
            held,
            self._weights,
            self._solver,
            self.support.surface,
            (self._skin_surface, self.contacts),
            self._iterative_from,
        )

    @cached_property
    def floating(self) -> ConstrainedBody:
        """The body whose supported surface can move."""
        return self._hold(self.stiffness.poisson_ratio, self.support.held)

    @cached_property
    def probed_m(self) -> np.ndarray:
        """Part of the body that the presses may show, a box (2, 3) m; see `fem.mesh.probed_box`."""
        points, radii, box = self.contacts.points_m, self.contacts.radius_m, self.mesh.box_m
        return probed_box(points, box, float(radii.min())) if self.mesh.focused else box

    @cached_property
    def points_m(self) -> np.ndarray:
        """Sample points of the modulus, (p, 3) m.

        In every cell; then in those around the tips, where there are near fields; last at the
        contact points, which only a skin asks for.
        """
        corners = self.mesh.nodes[self.mesh.cells[self.close_cells, :4]]
        own = self.stiffness.points_m, close_points_m(corners), self.contacts.points_m
        points = np.vstack(own)
        points.setflags(write=False)  # every evaluation of a search asks for them
        return points

    def evaluate(
        self,
        modulus_pa: np.ndarray | float,
        support_compliance: tuple[float, float] | None = None,
        fibres: Fibres | tuple | None = None,
        skin: Skin | tuple | None = None,
    ) -> Response:
        """Solve for all presses.

        Parameters
        ----------
        modulus_pa : (p,) Young's modulus at `points_m`, Pa, or one number for a homogeneous body.
        support_compliance : normal and tangential compliance (m/Pa) that the support has beyond its
            own, in series; the near fields need not be made again for another one.
        fibres : direction and modulus of fibres, see `fem.palpation.fibres.Fibres`
        skin : thickness and modulus factor of a skin on the surface `skin_surface`, see
            `fem.palpation.skin`;
            it counts in `compliance`, `sensitivity` and `skin_sensitivity`

        Raises
        ------
        SolverError
            A modulus that is not positive and finite, or a body that a press pushes off a support
            on which it slides.
        """
        material = self.material(modulus_pa, fibres, skin)
        support, springs = self.held(material, support_compliance)
        body = self._bonded if springs is None else self.floating
        values = self.values(body, material)
        if springs is not None:
            body.foundation.add(values, springs)
        if self.enrichment is not None:
            compliance, field, amplitude = self._enriched(body, material, values)
        else:
            field = body.solve(values)
            compliance = np.einsum("dj,dj->j", body.loads, field)
            amplitude = np.zeros((len(compliance), 0))
        response = Response(compliance, self, body, material, field, amplitude, springs)
        if springs is not None:
            if np.isinf(support[1]):
                _check_equilibrium(response, springs)
            compliance += first_order_rest(support, springs, response.support_sensitivity)
        if material.skin is not None:
            compliance += body.near_skin(material.skin).value / material.local
        for array in (compliance, field, amplitude):
            array.setflags(write=False)
        return response

    def moved(self, mesh: Mesh, floating: bool) -> ConstrainedBody:
        """Return the body on a mesh with the same cells and nodes elsewhere, for its matrix."""
        own = self.support
        held = own.held if floating else (own.surface, *own.held)
        return self._hold(self.stiffness.poisson_ratio, held, mesh)

    def held(
        self, material: Material, support_compliance: tuple[float, float] | None = None
    ) -> tuple[tuple[float, float], tuple[float, float] | None]:
        """Compliances (normal, tangential) that a support is to have, and those of its springs.

        See `evaluate`; a bonded support has no springs.
        """
        own, more = self.support, (0.0, 0.0) if support_compliance is None else support_compliance
        support = replace(own, normal=own.normal + more[0], tangential=own.tangential + more[1])
        asked = support.normal, support.tangential
        if support.bonded:
            return asked, None
        return asked, self.floating.foundation.effective(*asked, material.modulus)

    def material(
        self,
        modulus_pa: np.ndarray | float,
        fibres: Fibres | tuple | None = None,
        skin: Skin | tuple | None = None,
    ) -> Material:
        """Return the body's material for the arguments of `evaluate`."""
        modulus = checked_modulus(modulus_pa, len(self.points_m))
        split = len(self.stiffness.points_m)
        if fibres is not None:
            direction, strength = checked_fibres(fibres, len(modulus))
            fibres = Fibres(direction, np.asarray(strength)[:split])
        skin = None if skin is None else Skin(*skin)
        modulus, close, local = np.split(modulus, [split, len(modulus) - len(self.contacts)])
        close = QuadraticModulus(close.reshape(-1, len(CLOSE_SAMPLES)))
        return Material(modulus, fibres, skin, close, local)

    def _enriched(
        self, body: ConstrainedBody, material: Material, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compliances (j,), fields (3 f, j) and amplitudes (j, m) with the near fields."""
        factor, field = body.pattern.factorize(values), body.loads  # each replaced by its field
        compliance = np.empty(field.shape[1])
        amplitude = np.zeros((len(compliance), FUNCTIONS))
        for group, near in self.near_fields(body.stiffness, material):
            shape = near.coupling.shape  # (j, m, d): a matrix of columns in memory for the factor
            k = factor.forward(near.coupling.reshape(-1, shape[2]).T).T.reshape(shape)
            half = factor.forward(field[:, group])  # all products with the inverse need no more
            missing = near.load - (k @ half.T[..., None])[..., 0]
            schur = near.energy - k @ k.swapaxes(1, 2)
            amplitude[group] = own = _solve_definite(schur, missing)
            compliance[group] = np.einsum("dj,dj->j", half, half) + np.sum(missing * own, axis=1)
            field[:, group] = factor.backward(half - (own[:, None] @ k)[:, 0].T)
        return compliance, field, amplitude

    def values(self, body: ConstrainedBody, material: Material) -> np.ndarray:
        """Values of a body's stiffness matrix, without the support's springs."""
        close = (self.close_cells, material.close.values)
        values = body.stiffness.values(material.modulus, close)
        if material.fibres is not None:
            direction, strength = material.fibres
            values += body.stiffness.fibre_values(direction, np.asarray(strength))
        if material.skin is not None:
            values += material.skin.stretch_m * body.membrane.values(material.modulus)
        return values

    def near_fields(
        self, stiffness: Stiffness, material: Material
    ) -> Iterator[tuple[slice, NearFields]]:
        """Near fields in groups of presses, so that memory does not grow with their number."""
        enrichment = self.enrichment
        if enrichment is None:
            return
        by_cell = material.modulus.reshape(-1, stiffness.samples)
        integrals = [(part, by_cell) for part in enrichment.ordinary]
        integrals.append((enrichment.close, material.close.values))
        if material.fibres is not None:
            direction, strength = material.fibres
            along = self.fibre_plane(direction).near(direction)
            integrals.append((along, np.reshape(strength, by_cell.shape)))
        m = FUNCTIONS
        for first in range(0, len(enrichment.load), _GROUP):
            load = enrichment.load[first : first + _GROUP]
            by_function = np.zeros((len(load), m, 3 * len(stiffness.free_nodes)))
            energy = np.zeros((len(load), m, m))
            for part, table in integrals:
                part.add(by_function, energy, first, stiffness.free_cells, table)
            near = NearFields(by_function, energy, load)
            yield slice(first, first + len(load)), near

    def fibre_plane(self, direction: np.ndarray) -> FibrePlane:
        """Return a plane that holds the direction: the last one used, if it does."""
        if self._plane is not None and self._plane.holds(direction):
            return self._plane
        return self.plane(plane_of(direction))

    def plane(self, plane: np.ndarray) -> FibrePlane:
        """Return the effect of fibres in a plane (2, 3), kept until another plane is asked for."""
        if self._plane is None or not np.array_equal(self._plane.plane, plane):
            self._plane = FibrePlane(
                self.stiffness, self.contacts, plane, self.enrichment is not None
            )
        return self._plane


def _solve_definite(schur: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Amplitudes (j, m) of the near fields; without a positive energy (j, m, m) there are none."""
    try:
        np.linalg.cholesky(schur)
    except np.linalg.LinAlgError as error:
        raise SolverError(
            "the map is finer than the mesh around a tip resolves: the near field there has no "
            "positive energy; use a finer mesh, or a map that varies less within its cells"
        ) from error
    return np.linalg.solve(schur, missing[..., None])[..., 0]


def _check_equilibrium(response: Response, springs: tuple[float, float]) -> None:
    """Refuse a body that only the last springs of a sliding support keep in place."""
    slid = response.support_sensitivity[:, 1] * springs[1] / response.compliance
    if slid.max() > 1e-2:
        worst = int(slid.argmax())
        raise SolverError(
            f"press {worst} pushes the body off its sliding support: it needs a tangential "
            "compliance that is finite, a surface that is held, or a press across the support"
        )
