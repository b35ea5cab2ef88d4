"""The model of a fit, made anew from the fit's record."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from fem import PalpationModel
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.body.state import BodyState, ChangedMap
from identify.effects.base import Effect, changes_body
from identify.effects.readings import Readings
from identify.effects.unknown_course import COURSES
from identify.fit.result import FitResult
from identify.map import FreeMap, GaussianMap
from identify.map.initial_guess import REFERENCE_PA
from identify.map.parameters import ParameterSpace, parameter_space
from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.model import MeasurementModel
from models import Catalogue, InputError


def fitted_model(
    experiment: PlacedExperiment, fit: FitResult, catalogue: Catalogue[Effect]
) -> MeasurementModel:
    """Return the model of a fit, also of one that was read from a file, at its estimate.

    Raises
    ------
    InputError
        An effect that is in no catalogue.
    """
    readings, body = Readings.of(experiment.scan), experiment.body
    mechanics = BodyMechanics.of(body.coarse, body.fine)
    free = [name for name, estimate in fit.parameters.items() if estimate.free]
    if isinstance(fit.map, FreeMap):
        space = ParameterSpace(fit.map, (), ())
    else:
        names = [name for name in free if name in fit.map.names]
        space = parameter_space(fit.map, body.coarse.mesh.box_m, names, body.coarse.probed_m)
    values: dict[str, dict[str, float]] = {}
    for name, estimate in fit.parameters.items():
        effect, _, parameter = name.partition(".")
        if parameter and name not in fit.map.names:
            values.setdefault(effect, {})[parameter] = estimate.value
    known = {effect.name: effect for effect in (*COURSES, *catalogue)}
    unknown = [name for name in values if name not in known]
    if unknown:
        raise InputError(
            f"the fit has the effect '{unknown[0]}', which is not in the catalogue; give the file "
            "that it came from in the study"
        )
    state = mechanics.state().changed(background_pa=fit.map.background_pa)
    parts = tuple(
        EffectInModel(known[name], known[name].bounded(readings, state), given)
        for name, given in values.items()
    )
    model = MeasurementModel(
        readings, experiment.scan.used().displacement_m, fit.noise.of_readings,
        mechanics, space, parts, unit_compliance=unit_compliance(body.coarse, fit),
    )  # fmt: skip
    return carried_as(fit, model, model.start(fit.map))


def carried_as(fit: FitResult, model: MeasurementModel, u: np.ndarray) -> MeasurementModel:
    """Carry a model to the finer one, at scaled coordinates u (k,), as the fit's model was.

    The fit of a free map without a finer model keeps the contact of a ball on a half-space.
    """
    if isinstance(fit.map, FreeMap) and model.mechanics.fine is None:
        return model
    return model.corrected(u)


def unit_compliance(model: PalpationModel, fit: FitResult) -> np.ndarray | None:
    """Return the compliance (j,) of a body of 1 Pa, for the modulus under a tip of a free map."""
    if not isinstance(fit.map, FreeMap):
        return None
    return REFERENCE_PA * compliance(model, GaussianMap(REFERENCE_PA))


def changed_map(
    fit: FitResult,
    box_m: np.ndarray,
    catalogue: Iterable[Effect],
    values: Mapping[str, float] | None = None,
) -> tuple[ChangedMap, tuple[str, ...]]:
    """Return a fit's map with the changes by its effects, and the names of these effects.

    Parameters
    ----------
    box_m : (2, 3) of the body
    catalogue : where the effects are looked up; one that is not in it changes nothing
    values : of the effects' parameters by name; None are the fit's
    """
    low, high = (tuple(corner) for corner in box_m.tolist())
    state, names = BodyState((low, high), poisson_ratio=0.0), []  # no part of the modulus
    for effect, given in _of_body(fit, catalogue, values):
        before = state.modulus_changes
        state = effect.body(state, **given)
        names += [effect.name] if state.modulus_changes != before else []
    return ChangedMap(fit.map, state), tuple(names)


def beside_map(fit: FitResult, box_m: np.ndarray, catalogue: Iterable[Effect]) -> tuple[str, ...]:
    """Return the names of a fit's effects that change the body's stiffness, and not its map.

    A skin, fibres, and another Poisson's ratio: the map is then not all of the body.
    """
    low, high = (tuple(corner) for corner in box_m.tolist())
    state = BodyState((low, high), poisson_ratio=0.0)
    made = ((e.name, e.body(state, **given)) for e, given in _of_body(fit, catalogue))
    return tuple(name for name, after in made if _material(after) != _material(state))


def _material(state: BodyState) -> tuple[float, ...]:
    return state.skin_factor, state.fibre_share, state.poisson_ratio


def _of_body(
    fit: FitResult, catalogue: Iterable[Effect], values: Mapping[str, float] | None = None
) -> Iterator[tuple[Any, dict[str, float]]]:
    """Effects of a fit that change the body, with the values of their parameters."""
    for effect in catalogue:
        named = {p.name: f"{effect.name}.{p.name}" for p in effect.parameters}
        if changes_body(effect) and set(named.values()) <= set(fit.parameters):
            known = values or {name: fit.parameters[name].value for name in named.values()}
            yield effect, {p: known[name] for p, name in named.items()}
