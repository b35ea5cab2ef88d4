"""Geometry confounders: wrong lengths in the study that mimic an effect.

A tip wider than stated, or a higher body, has nearly the pattern of a gradient, a skin or a
compliant base: a cosine of 0.98 and more beyond the map, with tips of two radii too. No scan
separates them, a calliper does. They are therefore no effects of the catalogue, which would only
make its groups longer; they are named beside the effect that they mimic.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from fem import Contacts, PalpationModel
from fem.mesh import Mesh
from identify.design.settings import CONFOUNDERS, ConfounderSettings
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError
from identify.select.accepted_effect import AcceptedEffect
from identify.select.explanation import Explanation
from identify.select.score_test import fitted_basis

_STEP = 0.02  # of a length, for its derivative

Length = Literal["tip_radius", "body_height"]


@dataclass(frozen=True)
class GeometryConfounder:
    """A stated length whose error would explain nearly as much as an effect.

    Attributes
    ----------
    effect : an accepted effect
    length : tip radius or body height
    change_m : the true length less the stated one; of all tips alike
    """

    effect: str
    length: Length
    change_m: float


def geometry_confounders(
    explained: Explanation, settings: ConfounderSettings = CONFOUNDERS
) -> tuple[GeometryConfounder, ...]:
    """Return the lengths that would explain nearly as much as an accepted effect.

    To first order.
    """
    known: dict[Length, PalpationModel] = {}
    return tuple(
        confounder
        for accepted in explained.accepted
        for confounder in _of_effect(explained, accepted, known, settings)
    )


def _of_effect(
    explained: Explanation,
    accepted: AcceptedEffect,
    known: dict[Length, PalpationModel],
    settings: ConfounderSettings,
) -> Iterator[GeometryConfounder]:
    number = next(
        (i for i, step in enumerate(explained.ladder) if accepted.name in step.fit.effect_names),
        0,
    )
    if number == 0:
        return
    before, after = (step.fit for step in explained.ladder[number - 1 : number + 1])
    for length, (model, step, stated) in _models(before, known).items():
        try:
            changed = before.at.body.compliance_on(model)
        except InadmissibleError:
            continue
        press = before.model.readings.press
        moved = before.at.by_compliance * (changed - before.at.body.compliance)[press] / step
        column = before.at.whitened(moved, press)
        basis = fitted_basis(before.at)
        column = column - basis @ (basis.T @ column)
        size = float(column @ before.at.residual / (column @ column))
        as_good = size**2 * (column @ column) >= settings.as_good * (before.chi2 - after.chi2)
        if as_good and abs(size) <= settings.largest_change * stated:
            yield GeometryConfounder(accepted.name, length, size)


def _models(
    fit: FitResult, known: dict[Length, PalpationModel]
) -> dict[Length, tuple[PalpationModel, float, float]]:
    """Return model, step and stated value of each length, m."""
    coarse = fit.model.mechanics.coarse
    present, mesh, found = coarse.contacts, coarse.mesh, {}

    def built(length: Length, mesh: Mesh, contacts: Contacts) -> PalpationModel:
        if length not in known:
            nu = coarse.stiffness.poisson_ratio
            known[length] = PalpationModel(mesh, nu, contacts, support=coarse.support)
        return known[length]

    if present.profile == "flat":
        stated = float(present.radius_m.min())
        step = -_STEP * stated  # narrower, so that no tip hangs over an edge
        contacts = replace(present, radius_m=present.radius_m + step)
        found["tip_radius"] = built("tip_radius", mesh, contacts), step, stated
    if "x0" in mesh.surfaces:  # a block
        top = mesh.nodes[:, 2].max()
        stated = float(top - mesh.nodes[:, 2].min())
        nodes = mesh.nodes.copy()
        nodes[:, 2] += _STEP * (nodes[:, 2] - top)  # the base sinks
        higher = built("body_height", Mesh(nodes, mesh.cells, mesh.surfaces), present)
        found["body_height"] = higher, _STEP * stated, stated
    return found
