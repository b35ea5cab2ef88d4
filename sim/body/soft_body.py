"""The soft body of the virtual laboratory: the finite element model of all planned presses.

A block is meshed regularly, any other shape from its surface. All contacts are solved at once, with
one factorisation. The body is linear, so that under a force F at press j the whole body moves by F
times the solution for 1 N there: the contact gets that column of the tetrahedral solution at each
exchange, not a law fitted to it. The tip's travel on a block is that of two meshes extrapolated
(`fem.palpation.richardson`), the surface that of the finer one. The meshes are the laboratory's own
(finer than the identifier's and cut differently), and so is its stiffness map.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from fem import (
    Contacts,
    Mesh,
    PalpationModel,
    RefinedModel,
    Support,
    Surface,
    tetrahedralize_surface,
)
from fem.contact import half_space_matrix, patch_grid
from fem.finite_strain import FiniteStrainModel, HyperelasticLaw, RigidTip
from fem.mesh import mesh_between, planes_over, probed_box, refined_planes
from fem.palpation import RefinedResponse, Response
from models import InputError
from sim.body.law import HERTZ_WIDTH, Creep, LawCurve, growing_contact, solved_radii
from sim.motion import Tip

DIVISIONS = (14, 14, 7)
COARSENING = 0.7
SPLIT = "alternating"
CELLS = float(np.prod(DIVISIONS))
CREPT_M = 2e-8  # from which on the contact asks for the law again
SLIGHT = 1e-3  # of the set force: the body is linear
LEVELS = (0.125, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.08)  # of the set force, of a hyperelastic path
RING_PATCHES = 40  # across a ring
SURFACE_EDGES = 15  # edges along the cube root of a closed surface's volume; the fit takes fewer
Divisions = tuple[int, int, int]


class SoftBody:
    """A body on its support, pressed by rigid tips.

    Parameters
    ----------
    shape : edges of a block from the body frame's origin, m; or vertices (n, 3) m and triangles
        (t, 3) of a closed surface
    modulus : Young's modulus (p,) Pa at points (p, 3) m
    poisson_ratio : of the whole body
    tips : radius of a flat tip, m, or one tip a press (j)
    points_m, directions : (j, 3) contacts, body frame, in the order of the presses
    divisions : of a block's finer mesh, see `fem.block_mesh`; another shape gets as many cells
    support : of the base, None is bonded
    force_n : set forces, (j,) or one: contacts that grow are solved around them
    law : hyperelastic law of the material, `fem.finite_strain.hyperelastic`; None is linear
    sticking : the surface of a hyperelastic body sticks to the tip; else it slides
    creep : of the travel, None is elastic
    bend_per_m : (j,) mean curvature of the surface under the tips, convex positive

    Attributes
    ----------
    compliance_m_per_n : (j,) of the presses at small depth; of growing contacts at the set force
    modulus : the truth
    curves : law of each press
    surface_nodes_m : (n, 3) nodes of the free surface, undeformed
    surface_triangles : (t, 3) corners of its triangles, seen from outside anticlockwise
    """

    def __init__(
        self,
        shape: tuple[float, float, float] | tuple[np.ndarray, np.ndarray],
        modulus: Callable[[np.ndarray], np.ndarray],
        poisson_ratio: float,
        tips: float | Sequence[Tip],
        points_m: np.ndarray,
        directions: np.ndarray,
        divisions: tuple[int, int, int] = DIVISIONS,
        support: Support | None = None,
        force_n: float | np.ndarray = 0.3,
        law: HyperelasticLaw | None = None,
        sticking: bool = True,
        creep: Creep | None = None,
        bend_per_m: np.ndarray | None = None,
    ) -> None:
        count = len(points_m)
        each = list(tips) if isinstance(tips, Sequence) else [Tip("flat", tips)] * count
        force = np.broadcast_to(force_n, count)
        plane = modulus(np.asarray(points_m, float)) / (1 - poisson_ratio**2)
        radii = [
            solved_radii(tip, f, e) if tip.grows else np.array([tip.radius_m])
            for tip, f, e in zip(each, force, plane, strict=True)
        ]
        owner = np.repeat(np.arange(count), [len(r) for r in radii])
        self._first = np.searchsorted(owner, np.arange(count))
        contacts = Contacts(
            np.asarray(points_m)[owner], np.asarray(directions)[owner], np.concatenate(radii)
        )
        meshes = true_meshes(shape, divisions, np.asarray(points_m, float), contacts.radius_m.min())
        self.modulus = modulus
        grows = np.array([each[j].grows for j in owner])
        solved = {
            kind: _solved(meshes, modulus, poisson_ratio, contacts, grows == kind, kind, support)
            for kind in sorted(set(grows.tolist()))
        }
        punch = np.empty(len(owner))
        for kind, found in solved.items():
            punch[grows == kind] = found.compliance
        self._punch = punch[self._first]
        bend = np.zeros(count) if bend_per_m is None else bend_per_m
        self.curves = [
            _law_curve(tip, radii[j], punch[owner == j], plane[j], bend[j])
            for j, tip in enumerate(each)
        ]
        if law is not None:
            self._stiffen(
                law, sticking, modulus, contacts, meshes[0], poisson_ratio, support, force, each
            )
        self.compliance_m_per_n = np.array(
            [
                c.at(0.0 if tip.kind == "flat" else f)[1]
                for c, tip, f in zip(self.curves, each, force, strict=True)
            ]
        )
        self._creep = creep
        self._press, self._time_s = -1, 0.0
        self._lag = np.zeros(len(creep.shares) if creep else 0)
        self._history: list[tuple[float, float]] = []
        self._keep_surface(meshes, solved, grows)

    def displacement(self, press: int, force_n: float) -> float:
        """Depth of the tip at a press under a force, m, with the creep up to now."""
        return self.curves[press].at(force_n)[0] + float(self._lag.sum())

    def tangent(self, press: int, force_n: float) -> float:
        """Local stiffness at a press, N/m, of a quick change."""
        return 1.0 / self.curves[press].at(force_n)[1]

    @property
    def in_time(self) -> bool:
        """True if the body creeps: its law then has to be asked in each step."""
        return self._creep is not None

    def advance(self, press: int, time_s: float, force_n: float) -> bool:
        """Creep on to a time under a force; True if the law has to be asked again.

        A press begins on a body that has recovered.
        """
        if press != self._press:
            self._press, self._time_s = press, time_s
            self._lag[:] = 0.0
            self._history = []
        if self._creep is None:
            return False
        quick = self.curves[press].at(max(force_n, 0.0))[0]
        before = float(self._lag.sum())
        shares, times = np.array(self._creep.shares), np.array(self._creep.times_s)
        left = np.exp(-(time_s - self._time_s) / times)
        self._lag = left * self._lag + (1 - left) * shares * quick
        lag = float(self._lag.sum())
        self._history.append((time_s, lag))
        self._time_s = time_s
        return abs(lag - before) > CREPT_M

    def displacement_at(self, press: int, force_n: float, time_s: float) -> float:
        """Depth of the tip under a force at an earlier time of the press just made, m."""
        quick = self.curves[press].at(force_n)[0]
        if not self._history or press != self._press:
            return quick
        times, lags = np.transpose(self._history)
        return quick + float(np.interp(time_s, times, lags))

    def surface_displacement(self, press: int, force_n: float) -> np.ndarray:
        """Displacement of `surface_nodes_m` under a force at a press, (n, 3) m.

        The mesh's own field, in proportion to the tip's depth: the sharp dimple at the tip's rim,
        which `displacement` has in it, is rounded off.
        """
        depth = self.curves[press].at(force_n)[0]
        return self._unit_displacement(press) * depth / self._punch[press]

    def _keep_surface(
        self,
        meshes: Sequence[Mesh],
        solved: Mapping[bool, Response | RefinedResponse],
        grows: np.ndarray,
    ) -> None:
        """Keep the free surface of the finest mesh, and how it moves under 1 N at each press."""
        mesh = meshes[-1]
        free = np.vstack([mesh.surface(s) for s in ("top", "sides") if s in mesh.surfaces])
        block = len(meshes) == 2
        surface, local = np.unique(_split(free) if block else free[:, :3], return_inverse=True)
        self.surface_triangles = local.reshape(-1, 3)
        self.surface_nodes_m = mesh.nodes[surface]
        fields = {
            kind: found.fine if isinstance(found, RefinedResponse) else found
            for kind, found in solved.items()
        }
        first = self._first  # not `self`: the cache below would keep the body, 0.7 GB, alive

        @lru_cache(maxsize=4)
        def unit_displacement(press: int) -> np.ndarray:
            row, kind = first[press], bool(grows[first[press]])
            number = int(np.count_nonzero(grows[:row] == kind))
            return fields[kind].displacement(number)[surface]

        self._unit_displacement = unit_displacement

    def _stiffen(
        self,
        law: HyperelasticLaw,
        sticking: bool,
        modulus: Callable[[np.ndarray], np.ndarray],
        contacts: Contacts,
        mesh: Mesh,
        poisson_ratio: float,
        support: Support | None,
        force: np.ndarray,
        tips: Sequence[Tip],
    ) -> None:
        """Replace the lines by paths of hyperelastic finite elements up to the set forces.

        Where there is no equilibrium, the depth is NaN.
        """
        if support is not None and not support.bonded:
            raise InputError("A hyperelastic body is bonded to its base here; give that support.")
        if any(tip.kind != "flat" for tip in tips):
            raise InputError(
                "A hyperelastic body is pressed by flat tips here; give --tips flat:..."
            )
        model, free = (
            FiniteStrainModel(mesh, poisson_ratio, contacts, law, tip=RigidTip(sticking=held))
            for held in (sticking, False)
        )
        compliance = np.array([curve.at(0.0)[1] for curve in self.curves])
        field = modulus(model.points_m)
        if sticking:  # the compliance above is that of a surface that slides
            slight = SLIGHT * force[:, None]
            held, slid = (one.evaluate(field, slight).readings_m[:, 0] for one in (model, free))
            compliance *= held / slid
        levels = force[:, None] * np.array(LEVELS)
        found = model.evaluate(field, levels, compliance)
        for j in range(len(tips)):
            self.curves[j] = LawCurve(
                np.r_[0.0, levels[j]],
                np.r_[0.0, found.readings_m[j]],
                np.r_[compliance[j], found.tangent_compliance[j]],
            )


def _law_curve(
    tip: Tip, radii_m: np.ndarray, compliance: np.ndarray, plane_modulus: float, bend_per_m: float
) -> LawCurve:
    """Return the law of a press by the compliances of flat punches of the tip's radii."""
    if tip.grows:
        return growing_contact(tip, radii_m, compliance, plane_modulus, bend_per_m)
    more = 0.0
    if tip.kind == "ring":
        near = 1 / (2 * plane_modulus * tip.radius_m)
        more = (ring_share(round(tip.inner_share, 3)) - 1) * near
    return LawCurve.line(compliance[0] + more)


def _solved(
    meshes: Sequence[Mesh],
    modulus: Callable[[np.ndarray], np.ndarray],
    poisson_ratio: float,
    punches: Contacts,
    chosen: np.ndarray,
    grows: bool,
    support: Support | None,
) -> Response | RefinedResponse:
    """Solve for the chosen punches; those of a contact that grows by a Hertz pressure.

    One of six fifths of the punch's radius is as compliant on a half-space, and under other parts
    of the body as wide; without a singular rim it is four times as exact on a curved surface.
    """
    radius, profile = punches.radius_m[chosen], "flat"
    if grows:
        radius, profile = HERTZ_WIDTH * radius, "hertz"
    contacts = Contacts(punches.points_m[chosen], punches.directions[chosen], radius, profile)
    models = [PalpationModel(m, poisson_ratio, contacts, support=support) for m in meshes]
    model = RefinedModel(*models) if len(models) == 2 else models[0]
    return model.evaluate(modulus(model.points_m))


@lru_cache(maxsize=64)
def ring_share(inner_share: float) -> float:
    """Compliance of a rigid ring over that of a full disc of its radius, on a half-space (1).

    Both by the same patches, so that the error of their size falls out.
    """
    both = []
    for inner in (0.0, inner_share):
        centres, side = patch_grid(1.0, RING_PATCHES, disc=True)
        kept = centres[np.hypot(*centres.T) > inner]
        matrix = half_space_matrix(kept, side, 0.3)
        both.append(1 / float(np.linalg.solve(matrix, np.ones(len(kept))).sum()))
    return both[1] / both[0]


def true_meshes(
    shape: tuple[float, float, float] | tuple[np.ndarray, np.ndarray],
    divisions: Divisions,
    points_m: np.ndarray,
    radius_m: float,
) -> list[Mesh]:
    """Return the laboratory's own meshes of a shape: two of a block, the second finer, else one.

    Where presses at points (j, 3) m by tips of a radius and more show a small part of a body,
    cells are even there, and wider elsewhere.
    """
    if len(shape) == 3:
        finer = planes_over(shape, divisions, points_m, radius_m)
        # Of cells that grow otherwise outside, the two would not tell the limit of ever finer ones
        coarser = [refined_planes(planes, COARSENING) for planes in finer]
        return [mesh_between(planes, SPLIT) for planes in (coarser, finer)]
    surface = Surface(*shape)
    box = np.array([surface.vertices.min(axis=0), surface.vertices.max(axis=0)])
    probed = probed_box(points_m, box, radius_m)
    part = None if np.array_equal(probed, box) else probed
    volume = surface.volume if part is None else float(np.prod(part[1] - part[0]))
    edge = float(np.cbrt(volume) / (SURFACE_EDGES * np.cbrt(np.prod(divisions) / CELLS)))
    return [tetrahedralize_surface(*surface, edge, fine_box_m=part)]


def _split(triangles: np.ndarray) -> np.ndarray:
    """Four flat triangles for each quadratic one, (4 t, 3)."""
    corners = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    return triangles[:, corners].reshape(-1, 3)
