"""Compliances of presses on a `HiddenBody`, for the bench: solutions and models are kept in memory.

Meshes and extrapolation are those of `sim.body.soft_body`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from fem import Contacts, Mesh, PalpationModel, RefinedModel
from fem.contact import half_space_matrix, patch_grid
from fem.mesh import mesh_between, planes_over
from fem.palpation import RefinedResponse, Response, travel_under
from sim.body.soft_body import COARSENING, DIVISIONS, SPLIT, Divisions
from sim.body.true_body import HiddenBody

SKINNED = 10 / 7  # times as many cells a side: a skin's effect reaches about a tip's radius
PATCHES = 12  # across a tip, where its pressure is solved for
UNCONVERGED = 0.57  # 8 x 8 x 4 cells of the paper's block


def block_compliance(
    body: HiddenBody,
    points_m: np.ndarray,
    radius_m: np.ndarray,
    profile: str = "flat",
    divisions: tuple[int, int, int] = DIVISIONS,
    converged: bool = True,
    upright: bool = False,
) -> np.ndarray:
    """Compliance of presses straight down on the top of a block, (j,) m/N.

    Meshes and solutions are kept in memory: the same presses on another map cost one solution, and
    the same body nothing.

    Parameters
    ----------
    body : the block
    points_m : (j, 2) x and y, in the frame in which the body is shifted
    radius_m : (j,) of the contact
    profile : of the pressure, see `fem.Contacts`
    divisions : of the finer mesh
    converged : False for a coarse mesh alone, which is about a hundredth too stiff
    upright : the flat tip keeps the surface under it level; else its pressure is the half-space's
    """
    rows = np.column_stack([points_m - np.array(body.shift_m), radius_m])
    unique, back = np.unique(rows, axis=0, return_inverse=True)
    where = (unique.tobytes(), profile, divisions, converged)
    shape = (body.size_m, body.poisson_ratio, body.skin_thickness_m)
    solved = _kept(
        _SOLVED, (body, upright, *where), lambda: _solve(body, shape, where, unique, upright)
    )
    return solved[back.ravel()]


_MODELS: OrderedDict[Hashable, Any] = OrderedDict()
_SOLVED: OrderedDict[Hashable, Any] = OrderedDict()
_LARGEST = {id(_MODELS): 2, id(_SOLVED): 256}  # a model of two tip radii takes 0.8 GB


def _kept(store: OrderedDict[Hashable, Any], key: Hashable, make: Callable[[], Any]) -> Any:
    """Return the entry of a key, made if it is missing; the oldest entry is dropped."""
    if key not in store:
        store[key] = make()
    store.move_to_end(key)
    while len(store) > _LARGEST[id(store)]:
        store.popitem(last=False)
    return store[key]


def forget_models() -> None:
    """Free the models that `block_compliance` keeps, gigabytes; their solutions stay."""
    _MODELS.clear()


def _solve(
    body: HiddenBody,
    shape: tuple,
    where: tuple[bytes, str, Divisions, bool],
    presses: np.ndarray,
    upright: bool,
) -> np.ndarray:
    _, profile, divisions, converged = where
    model = _kept(
        _MODELS, (shape, where), lambda: _model(body, profile, divisions, converged, presses)
    )
    response = _respond(model, body)
    result = np.array(response.compliance)
    if upright:
        own = response.fine if isinstance(response, RefinedResponse) else response
        result *= 1 - _upright_gain(own, body)
    result.flags.writeable = False
    return result


def _upright_gain(response: Response, body: HiddenBody) -> np.ndarray:
    """Relative part (j,) of the compliance that a tip loses which stays level.

    Forces q on a grid of patches that add up to nothing join the pressure, so that the
    complementary energy C + 2 q.u + q.G q is least: u is the travel under the tip, G the influence
    of patches on the half-space with the modulus at the contact. The least energy is C + q.u.
    """
    contacts = response.model.contacts
    modulus = body.modulus(contacts.points_m)
    centres, side = patch_grid(1.0, PATCHES, disc=True)
    system = np.ones((len(centres) + 1, len(centres) + 1))
    system[-1, -1] = 0  # the last row: the forces add up to nothing
    gain = np.empty(len(contacts))
    for j, radius in enumerate(contacts.radius_m):
        system[:-1, :-1] = half_space_matrix(centres * radius, side * radius, body.poisson_ratio)
        system[:-1, :-1] /= modulus[j]
        travel = travel_under(response, j, centres)
        forces = np.linalg.solve(system, np.append(-travel, 0.0))[:-1]
        gain[j] = -(forces @ travel) / response.compliance[j]
    return gain


def _respond(model: PalpationModel | RefinedModel, body: HiddenBody) -> Response | RefinedResponse:
    modulus = body.modulus(model.points_m)
    support = (body.base_normal_m_per_pa, body.base_tangential_m_per_pa)
    fibres = None
    if body.fibre_share:
        along = np.array([np.cos(body.fibre_angle_rad), np.sin(body.fibre_angle_rad), 0.0])
        fibres = (along, body.fibre_share * modulus)
    return model.evaluate(modulus, support, fibres)


def _model(
    body: HiddenBody,
    profile: str,
    divisions: tuple[int, int, int],
    converged: bool,
    presses: np.ndarray,
) -> PalpationModel | RefinedModel:
    top = np.full(len(presses), body.size_m[2])
    points = np.column_stack([presses[:, :2], top])
    contacts = Contacts(points, np.array([0.0, 0.0, -1.0]), presses[:, 2], profile)
    share = COARSENING if converged else UNCONVERGED
    if body.skin_thickness_m:
        x, y, z = (round(SKINNED * count) for count in divisions)
        divisions = (x, y, z)
    coarser = [max(round(share * count), 1) for count in divisions]
    coarse = PalpationModel(_layered(body, coarser, contacts), body.poisson_ratio, contacts)
    if not converged:
        return coarse
    fine = PalpationModel(_layered(body, list(divisions), contacts), body.poisson_ratio, contacts)
    return RefinedModel(coarse, fine)


def _layered(body: HiddenBody, divisions: list[int], contacts: Contacts) -> Mesh:
    """Mesh of the block; a skin gets a layer of cells of its own."""
    x, y, height = body.size_m
    below = height - body.skin_thickness_m
    points = contacts.points_m - [0, 0, body.skin_thickness_m]
    planes = planes_over((x, y, below), divisions, points, contacts.radius_m.min())
    if body.skin_thickness_m:
        planes[2] = np.append(planes[2], height)
    return mesh_between(planes, SPLIT)
