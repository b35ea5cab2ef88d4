"""Detection limits of a planned scan, at the estimate of the present one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fem import Contacts
from fem.contact import PressedSurface
from identify.body import BodyMechanics, BodyResponse, ChosenMechanics
from identify.design.detection_limits import Limit, bends_of, limits_at
from identify.design.scan_variants import (
    Design,
    Presses,
    mixed,
    presses_of,
    readings_of,
    variations,
)
from identify.design.settings import DETECTION, DetectionSettings
from identify.effects.base import Effect
from identify.fit.result import FitResult
from identify.map import FreeMap
from identify.measurement.chain import OperatingPoint
from identify.measurement.linearised import Linearised
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.residual.fitted_model import unit_compliance


class Solved(NamedTuple):
    """Presses whose body is solved at the estimate.

    Attributes
    ----------
    presses : j of them
    body : its response
    unit : (j,) compliance of a body of 1 Pa, None where the map is not free
    """

    presses: Presses
    body: BodyResponse
    unit: np.ndarray | None


def planned(
    fit: FitResult,
    design: Design,
    further: bool = False,
    like: BodyMechanics | None = None,
    solved: Iterable[Solved] = (),
) -> tuple[MeasurementModel, Linearised]:
    """Return the model of a planned scan, and its linearisation at a fit's estimate.

    Parameters
    ----------
    further : made after the present one, not in its place. The model is that beside one map, as the
        present scan tells more of it than its prior (`next_presses`)
    like : of another scan with its tips, whose near fields serve
    solved : planned scans at this estimate; their places with their tips need no solution
    """
    present = fit.model.readings
    timed = present.time_s is not None
    readings = readings_of(design.presses, timed, present if further else None)
    readings = replace(
        readings,
        travel_from=present.travel_from,
        deepest=present.deepest,
        stated=present.scales if further or fit.model.effects else None,
    )
    mechanics, unit = _mechanics(fit, design, like, solved)
    model = replace(
        fit.model,
        readings=readings,
        mechanics=mechanics,
        unit_compliance=unit,
        map_uncertainty=None,
    )
    body, off = model.body(fit.u), _off(fit, design.presses) if further else 1.0
    c = off * body.compliance
    e = body.local_modulus if unit is None else unit / c
    exact = OperatingPoint(c, e, readings.force_n, model.values(fit.u))
    # The travel decides on the latent force, beside which curved laws are made straight
    model = replace(model, displacement_m=model.chain.predict(exact))
    model = replace(model, displacement_m=model.around(body, fit.u, off).predicted_m)
    if fit.field is not None and not further:
        model = replace(model, map_uncertainty=_uncertainty(fit, body))
    at = model.around(body, fit.u, off)
    return model, replace(at, residual=np.zeros(len(readings)))


def _off(fit: FitResult, presses: Presses) -> np.ndarray:
    """Return the factors (j,) by which presses are softer than the map has them.

    The most probable compliances of the present scan's presses, at the nearest of them. Beside an
    effect that takes a tenth of the travel, a free map that was found without it is as much off.
    """
    made = presses_of(fit.model.readings)
    apart = np.linalg.norm(presses.point_m[:, None] - made.point_m, axis=2)
    return (fit.at.compliance / fit.at.body.compliance)[apart.argmin(axis=1)]


def _uncertainty(fit: FitResult, body: BodyResponse) -> MapUncertainty:
    """Return the prior of a free map in the compliances of a scan in place of the present one."""
    assert isinstance(fit.map, FreeMap)
    assert fit.field is not None
    by_field, error = body.by_field(), fit.field.hyper.error
    of_field = fit.field.hyper.prior(fit.map.grid).product(by_field) @ by_field.T
    each = np.ones(len(by_field))
    return MapUncertainty(of_field, error**2 * each, 0 * each, each)


def designs_on_body(fit: FitResult, designs: Iterable[Design]) -> tuple[Design, ...]:
    """Return the designs without the presses with a tip over the body's edge."""
    surface = PressedSurface(fit.model.mechanics.coarse.mesh)
    found = []
    for design in designs:
        fits = surface.bears(_contacts(fit, design.presses))
        if fits.all():
            found.append(design)
        elif fits.any():
            left_out = f" (without the {np.sum(~fits)} places too near an edge for the tip)"
            presses = design.presses.taken(np.flatnonzero(fits))
            found.append(replace(design, change=design.change + left_out, presses=presses))
    return tuple(found)


def _contacts(fit: FitResult, presses: Presses) -> Contacts:
    present = fit.model.mechanics.coarse.contacts
    # A sphere's patch is not its radius
    scale = present.radius_m / presses_of(fit.model.readings).radius_m
    return Contacts(
        presses.point_m,
        presses.direction,
        presses.radius_m * float(np.median(scale)),
        present.profile,
    )


def _mechanics(
    fit: FitResult, design: Design, like: BodyMechanics | None, solved: Iterable[Solved]
) -> tuple[BodyMechanics, np.ndarray | None]:
    """Return the mechanics of a design's presses and their compliance on a body of 1 Pa.

    Presses that are known keep their solutions.
    """
    mechanics, present = fit.model.mechanics, presses_of(fit.model.readings)
    presses = design.presses
    for known in (Solved(present, fit.at.body, fit.model.unit_compliance), *solved):
        chosen = presses.places_among(known.presses)
        if chosen is not None:
            unit = None if known.unit is None else known.unit[chosen]
            return ChosenMechanics.among(known.body, chosen), unit
    other = (like or mechanics).under(_contacts(fit, presses))
    if isinstance(fit.map, FreeMap) and mechanics.fine is None:
        return other, unit_compliance(other.coarse, fit)  # not corrected in the fit either
    other = other.corrected(fit.map, fit.at.state)
    # The mesh error is far from the tip: the same length under any tip
    now = fit.at.body.compliance
    apart = np.linalg.norm(presses.point_m[:, None] - present.point_m, axis=2)
    error = (mechanics.correction.model_error * now)[apart.argmin(axis=1)]
    share = error / other.evaluate(fit.map, fit.at.state).compliance
    other = replace(other, correction=replace(other.correction, model_error=share))
    return other, unit_compliance(other.coarse, fit)


@dataclass(frozen=True)
class Improvement:
    """A planned scan and its detection limits."""

    design: Design
    limits: tuple[Limit, ...]


def improvements(
    fit: FitResult,
    catalogue: Sequence[Effect],
    designs: Sequence[Design],
    progress: Callable[[str], None] | None = None,
    settings: DetectionSettings = DETECTION,
    limits: Sequence[Limit] = (),
) -> tuple[Improvement, ...]:
    """Return the limits of planned scans, in the order of the designs.

    Parameters
    ----------
    limits : of the present scan, whose bends serve all scans with its tips, and those of the first
        scan with other tips those after it. Against bends of their own: 0.8 to 1.2 of the limit; of
        other tips 0.5 to 2.7
    """
    bends = {_tips(presses_of(fit.model.readings)): limits} if limits else {}
    solved: list[Solved] = []
    found = []
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        tips = _tips(design.presses)
        model, at = planned(fit, design, solved=solved)
        known = bends_of(bends.get(tips, ()))
        own = limits_at(model, at, fit.u, catalogue, settings, known)
        bends.setdefault(tips, own)
        solved.append(Solved(design.presses, at.body, model.unit_compliance))
        found.append(Improvement(design, own))
    return tuple(found)


def _tips(presses: Presses) -> tuple[float, ...]:
    """Return the radii of the tips."""
    return tuple(np.unique(presses.radius_m.round(9)).tolist())


@dataclass(frozen=True)
class BetterScans:
    """Planned scans that see clearly smaller effects than the one that was made.

    Attributes
    ----------
    by_effect : for each effect the cheapest change that helps, and its limit there
    mixed : the scan that changes most at once; None if it helps nothing
    """

    by_effect: Mapping[str, tuple[Design, Limit]] = field(default_factory=dict)
    mixed: Improvement | None = None

    @property
    def in_mixed(self) -> dict[str, float]:
        """Smallest share of each effect that the mixed scan sees."""
        limits = () if self.mixed is None else self.mixed.limits
        return {limit.name: limit.smallest_share for limit in limits if limit.smallest_share}


def better_scans(
    fit: FitResult,
    catalogue: Sequence[Effect],
    limits: Sequence[Limit],
    say: Callable[[str], None],
    most_force_n: float | None = None,
    settings: DetectionSettings = DETECTION,
) -> BetterScans:
    """Return the changed scans that see clearly smaller effects.

    Parameters
    ----------
    limits : of the scan that was made; a changed scan must also see less than it does
    most_force_n : see `variations`
    """
    readings = fit.model.readings
    presses = presses_of(readings)
    all_at_once = mixed(presses, most_force_n)
    variants = variations(presses, readings.time_s is not None, most_force_n)
    designs = designs_on_body(fit, [*variants, all_at_once])
    plans = {
        plan.design.name: plan
        for plan in improvements(fit, catalogue, designs, say, settings, limits)
    }
    present = {limit.name: limit.smallest_share for limit in limits if limit.smallest_share}
    same = plans.pop("same")
    for limit in same.limits:
        if limit.smallest_share:
            made = present.get(limit.name, limit.smallest_share)
            present[limit.name] = min(made, limit.smallest_share)

    def helps(limit: Limit) -> bool:
        share, made = limit.smallest_share, present.get(limit.name, np.inf)
        return share is not None and share < settings.clearly_smaller * made

    whole = plans.pop(all_at_once.name, None)  # a tip that fits nowhere has no scan
    found: dict[str, tuple[Design, Limit]] = {}
    for plan in sorted(plans.values(), key=lambda plan: plan.design.presses.duration_s):
        for limit in plan.limits:
            if limit.name not in found and helps(limit):
                found[limit.name] = (plan.design, limit)
    helped = whole is not None and any(helps(limit) for limit in whole.limits)
    return BetterScans(found, whole if helped else None)
