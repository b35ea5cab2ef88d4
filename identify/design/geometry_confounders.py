"""Lengths of the study that, were they wrong, would look like what was found.

A tip that is wider than stated, or a body that is higher, leaves nearly the pattern of a gradient,
a skin or a base that gives way: patterns with a cosine of 0.98 and more beyond the map, with tips
of two radii too. No scan tells them apart, a calliper does. So they are no effects of the
catalogue, which would only make its groups longer; they are named beside what looks like them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from fem import Contacts, PalpationModel
from fem.mesh.mesh import Mesh
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError
from identify.select.accepted_effect import AcceptedEffect
from identify.select.forward_selection import Explanation
from identify.select.score_test import fitted_basis

_STEP = 0.02  # of a length, for its derivative
_MOST = 0.3  # of a length; more is no slip of the study
_AS_GOOD = 0.9  # of what the effect takes off chi-square

Length = Literal["tip_radius", "body_height"]


@dataclass(frozen=True)
class GeometryConfounder:
    """A stated length that would explain nearly as much as an effect, if it were wrong.

    Attributes
    ----------
    effect : that was added, see `identify.select.forward_selection.Addition`
    length : which
    change_m : the true length less the stated one; of all tips alike
    """

    effect: str
    length: Length
    change_m: float


def geometry_confounders(explained: Explanation) -> tuple[GeometryConfounder, ...]:
    """Return the lengths that would explain nearly as much as an addition; to first order."""
    known: dict[Length, PalpationModel] = {}
    return tuple(
        found
        for addition in explained.accepted
        for found in _of_addition(explained, addition, known)
    )


def _of_addition(
    explained: Explanation, addition: AcceptedEffect, known: dict[Length, PalpationModel]
) -> Iterator[GeometryConfounder]:
    number = next(
        (i for i, step in enumerate(explained.ladder) if addition.name in step.fit.effect_names),
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
        as_good = size**2 * (column @ column) >= _AS_GOOD * (before.chi2 - after.chi2)
        if as_good and abs(size) <= _MOST * stated:
            yield GeometryConfounder(addition.name, length, size)


def _models(
    fit: FitResult, known: dict[Length, PalpationModel]
) -> dict[Length, tuple[PalpationModel, float, float]]:
    """Return model, step and stated value of each length, m."""
    coarse = fit.model.mechanics.coarse
    own, mesh, found = coarse.contacts, coarse.mesh, {}

    def built(length: Length, mesh: Mesh, contacts: Contacts) -> PalpationModel:
        if length not in known:
            nu = coarse.stiffness.poisson_ratio
            known[length] = PalpationModel(mesh, nu, contacts, support=coarse.support)
        return known[length]

    if own.profile == "flat":
        stated = float(own.radius_m.min())
        step = -_STEP * stated  # narrower, so that no tip comes to hang over an edge
        contacts = Contacts(own.points_m, own.directions, own.radius_m + step, own.profile)
        found["tip_radius"] = built("tip_radius", mesh, contacts), step, stated
    if "x0" in mesh.surfaces:  # a block
        top = mesh.nodes[:, 2].max()
        stated = float(top - mesh.nodes[:, 2].min())
        nodes = mesh.nodes.copy()
        nodes[:, 2] += _STEP * (nodes[:, 2] - top)  # the base sinks
        higher = built("body_height", Mesh(nodes, mesh.cells, mesh.surfaces), own)
        found["body_height"] = higher, _STEP * stated, stated
    return found
