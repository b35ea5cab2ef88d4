"""From a study and its scan to the finite element models that the fit works with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fem import Contacts, Mesh, PalpationModel, RefinedModel, SolverError, Support
from fem.mesh import FEWEST_CELLS, lower_base, mesh_between, refined_planes
from identify import BodyModel, contacts_of
from models import InputError, Scan
from palpmap.study.body import Body
from palpmap.study.cell_size import (
    SURFACE_EDGES,
    block_planes,
    cell_size_m,
    closed_surface,
    edges_of,
    finer_planes,
    free_map_cell_m,
    probed_part,
    refuse_too_large,
)
from palpmap.study.contact_body import contact_body
from palpmap.study.study import Study

if TYPE_CHECKING:
    from fem.mesh import Surface

FEW = 20  # presses that tell it
THICKER = 1.2  # of an assumed thickness, to tell how far moduli depend on it
SEARCH = 0.75  # of the coarse divisions: a third of the time; with half of them fits go astray
WITHIN = 0.97  # of the distance from the middle, for points of a body without a mesh
OUTSIDE = (
    32,
    32,
    4,
)  # cells a side of the surface through contact points, where it is drawn or pressed


def build_body_model(study: Study, scan: Scan) -> BodyModel:
    """Build the models of a study's body, pressed where the placed scan says.

    Parameters
    ----------
    scan : in the body's frame, see `palpmap.study.placement.place_scan`

    Raises
    ------
    InputError
        A press that would push the body off the base on which it slides.
    fem.errors.MeshError
        A tip that hangs over an edge, or a surface that cannot be meshed.
    """
    ball = study.probe.tip == "sphere"
    surface = outside_of(study.body) if study.body.size_m is None else None
    probed = probed_part(study.body, scan.contact_points, scan.contact_radii)
    if study.map.kind == "inclusions":
        refuse_too_large(study.body, len(scan.press_ids), probed)
        meshes = _meshes(study, probed)
    else:
        meshes = (_mesh_of_free_map(study, len(scan.press_ids), probed),)
    contacts, note = contacts_of(scan, ball, meshes, surface)
    nu, support = study.body.poisson_ratio, support_of(study.body)
    if len(meshes) == 1:
        model = PalpationModel(meshes[0], nu, contacts, support=support)
        if study.body.support == "base-sliding":
            _check_held(model, scan)
        return BodyModel(model, model, model, _noted(study.body, model, note), surface)
    search = _search_model(study, meshes[0], contacts, probed)
    if study.body.support == "base-sliding":
        _check_held(search, scan)
    coarse, finer = (PalpationModel(mesh, nu, contacts, support=support) for mesh in meshes)
    fine = RefinedModel(coarse, finer) if study.body.shape == "block" else finer
    return BodyModel(search, coarse, fine, _noted(study.body, coarse, note), surface)


def _mesh_of_free_map(study: Study, presses: int, probed: np.ndarray | None) -> Mesh:
    """Return one mesh for a free map, which the cells must resolve: as fine as the time allows."""
    body, edges = study.body, edges_of(study.body)
    if edges is None:
        return _meshes(study, probed)[1]
    return _between(body, block_planes(edges, free_map_cell_m(body, presses, probed), probed))


def try_body_model(study: Study, scan: Scan) -> None:
    """Try all of a body's models that takes seconds; the errors are those of `build_body_model`."""
    probed = probed_part(study.body, scan.contact_points, scan.contact_radii)
    refuse_too_large(study.body, len(scan.press_ids), probed)
    edges = edges_of(study.body)
    if edges is None:
        from fem import check_underside

        check_underside(closed_surface(study.body))
        return
    planes = block_planes(edges, cell_size_m(study.body, probed), probed)
    mesh = _between(study.body, planes)
    contacts, _ = contacts_of(scan, study.probe.tip == "sphere", (mesh,))
    search = _search_model(study, mesh, contacts, probed)
    if study.body.support == "base-sliding":
        _check_held(search, scan)


def _search_model(
    study: Study, coarse: Mesh, contacts: Contacts, probed: np.ndarray | None
) -> PalpationModel:
    return PalpationModel(
        _search_mesh(study, coarse, probed),
        study.body.poisson_ratio,
        contacts,
        near_field=False,
        support=support_of(study.body),
    )


def _noted(body: Body, model: PalpationModel, note: str) -> str:
    """Return a note, with how far moduli depend on a thickness that nobody measured."""
    edges = edges_of(body)
    if not body.thickness_assumed or edges is None:  # no closed surface has an assumed thickness
        return note
    mesh, presses = model.mesh, len(model.contacts)
    some = np.linspace(0, presses - 1, min(presses, FEW)).round().astype(int)
    contacts = model.contacts.some(np.unique(some))
    thicker = lower_base(mesh, (THICKER - 1) * edges[2])
    here, there = (
        model.on(one, contacts).evaluate(1.0).compliance for one in (mesh, thicker)
    )  # near fields are those of the model
    low, middle, high = np.percentile(100 * (there / here - 1), [5, 50, 95])
    told = (
        f"The thickness is assumed: were it {100 * (THICKER - 1):.0f} % more, an even body would "
        f"be {middle:.2g} % softer under the presses ({low:.2g} to {high:.2g} %), and the moduli "
        "found would be higher by as much."
    )
    return f"{note} {told}".strip()


def support_of(body: Body) -> Support:
    """Return the supports of a study's body.

    >>> from palpmap.study.study import Body
    >>> support_of(Body(shape="block", size_m=(0.1, 0.1, 0.05), poisson_ratio=0.3,
    ...                 support="base-sliding", held_sides=("x0",)))
    Support(surface='base', normal=0.0, tangential=inf, held=('x0',))
    """
    normal, tangential = body.base_normal_m_per_pa or 0.0, body.base_tangential_m_per_pa or 0.0
    if body.support == "base-sliding":
        tangential = np.inf
    return Support("base", normal, tangential, body.held_sides)


def _check_held(model: PalpationModel, scan: Scan) -> None:
    """Refuse presses that nothing but a sliding base resists; the modulus does not matter."""
    try:
        model.evaluate(1.0)
    except SolverError as error:
        raise InputError(
            f'study, key body.support: found "base-sliding", but {error}; press straight onto the '
            'base, give held_sides, or support = "base-elastic" with a tangential compliance'
        ) from error


def _search_mesh(study: Study, coarse: Mesh, probed: np.ndarray | None) -> Mesh:
    """Return the mesh on which starts are tried; of a closed surface another would cost more."""
    edges = edges_of(study.body)
    if edges is None:
        return coarse
    planes = block_planes(edges, cell_size_m(study.body, probed), probed)
    factors = [max(SEARCH, FEWEST_CELLS / (len(p) - 1)) for p in planes]
    return _between(
        study.body, [refined_planes(p, f) for p, f in zip(planes, factors, strict=True)]
    )


def outside_of(body: Body) -> Surface:
    """Return the closed surface of a study's body that is no block, body frame.

    Raises
    ------
    fem.errors.MeshError
        A surface that cannot be used.
    """
    from fem import check_surface, check_underside

    if body.shape == "from-contacts":
        even = [
            np.linspace(0, e, n + 1) for e, n in zip(edges_of(body) or (), OUTSIDE, strict=True)
        ]
        mesh = _between(body, even)
        return check_surface(mesh.nodes, mesh.boundary[:, :3])
    surface = closed_surface(body)
    check_underside(surface)
    return surface


def points_of(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3) that stand for those of a body's mesh, and its box (2, 3), body frame.

    They lie within the body by as much as the mesh's own points.
    """
    if body.size_m is None:
        vertices = outside_of(body).vertices
        middle = vertices.mean(axis=0)
        return middle + WITHIN * (vertices - middle), np.array(
            [vertices.min(axis=0), vertices.max(axis=0)]
        )
    size = np.array(body.size_m)
    even = 0.5 + WITHIN * np.linspace(-0.5, 0.5, 25)
    return np.stack(np.meshgrid(even, even, even), axis=-1).reshape(-1, 3) * size, np.array(
        [0 * size, size]
    )


def _between(body: Body, planes_m: Sequence[np.ndarray]) -> Mesh:
    """Mesh a block, or the body under the surface through contact points as a bent block."""
    block = mesh_between(planes_m)
    if body.size_m is not None:
        return block
    from fem.mesh import under_surface, widened_margins

    made = contact_body(body)
    if not block.focused:
        counts = [len(p) - 1 for p in planes_m[:2]]
        block = widened_margins(block, counts, made.margin_m)
    return under_surface(block, made.corner_m.tolist(), made.surface.heights)


def _meshes(study: Study, probed: np.ndarray | None) -> tuple[Mesh, Mesh]:
    """Mesh the body twice, both quadratic, the second finer."""
    cell_m, edges = cell_size_m(study.body, probed), edges_of(study.body)
    if edges is not None:
        coarse = block_planes(edges, cell_m, probed)
        return _between(study.body, coarse), _between(study.body, finer_planes(coarse))
    from fem import tetrahedralize_surface

    surface = closed_surface(study.body)
    coarse, finer = (
        tetrahedralize_surface(surface.vertices, surface.triangles, length, fine_box_m=probed)
        for length in (cell_m, cell_m * SURFACE_EDGES[0] / SURFACE_EDGES[1])
    )
    return coarse, finer
