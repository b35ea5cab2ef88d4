"""Geometry confounders: wrong lengths in the study that mimic an effect.

A tip wider than stated, or a higher body, has nearly the pattern of a gradient, a skin or a
compliant base: a cosine of 0.98 and more beyond the map, with tips of two radii too. No scan
separates them, a calliper does. They are therefore no effects of the catalogue, which would only
make its groups longer; they are named beside the effect that they mimic.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fem import PalpationModel
from fem.mesh import Mesh, lower_base
from identify.design.settings import CONFOUNDERS, ConfounderSettings
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError
from identify.select.accepted_effect import AcceptedEffect
from identify.select.explanation import Explanation
from identify.select.score_test import fitted_basis

_STEP = 0.02  # of a radius, for its derivative
_SMALL = 1e-5  # of a height; fields on stretched cells change their volume by its square

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
    known: dict[Length, PalpationModel | Mesh] = {}
    return tuple(
        confounder
        for accepted in explained.accepted
        for confounder in _of_effect(explained, accepted, known, settings)
    )


def _of_effect(
    explained: Explanation,
    accepted: AcceptedEffect,
    known: dict[Length, PalpationModel | Mesh],
    settings: ConfounderSettings,
) -> Iterator[GeometryConfounder]:
    number = next(
        (i for i, step in enumerate(explained.ladder) if accepted.name in step.fit.effect_names),
        0,
    )
    if number == 0:
        return
    before, after = (step.fit for step in explained.ladder[number - 1 : number + 1])
    body = before.at.body
    for length, (other, step, stated) in _others(before, known).items():
        try:
            wider = isinstance(other, PalpationModel)
            changed = body.compliance_on(other) if wider else body.compliance_moved(other)
        except InadmissibleError:
            continue
        press = before.model.readings.press
        moved = before.at.by_compliance * (changed - body.compliance)[press] / step
        column = before.at.whitened(moved, press)
        basis = fitted_basis(before.at)
        column = column - basis @ (basis.T @ column)
        size = float(column @ before.at.residual / (column @ column))
        as_good = size**2 * (column @ column) >= settings.as_good * (before.chi2 - after.chi2)
        if as_good and abs(size) <= settings.largest_change * stated:
            yield GeometryConfounder(accepted.name, length, size)


def _others(
    fit: FitResult, known: dict[Length, PalpationModel | Mesh]
) -> dict[Length, tuple[PalpationModel | Mesh, float, float]]:
    """Return the model or the mesh with another length, the step to it and the stated value, m."""
    coarse = fit.model.mechanics.coarse
    present, mesh, found = coarse.contacts, coarse.mesh, {}
    if present.profile == "flat":
        stated = float(present.radius_m.min())
        step = -_STEP * stated  # narrower, so that no tip hangs over an edge
        if "tip_radius" not in known:
            contacts = replace(present, radius_m=present.radius_m + step)
            nu = coarse.stiffness.poisson_ratio
            known["tip_radius"] = PalpationModel(mesh, nu, contacts, support=coarse.support)
        found["tip_radius"] = known["tip_radius"], step, stated
    if "x0" in mesh.surfaces:  # a block
        stated = float(np.ptp(mesh.nodes[:, 2]))
        if "body_height" not in known:
            known["body_height"] = lower_base(mesh, _SMALL * stated)
        found["body_height"] = known["body_height"], _SMALL * stated, stated
    return found
