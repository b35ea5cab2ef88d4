"""The model of a fit, made anew from the fit's record."""

from __future__ import annotations

import numpy as np

from fem import PalpationModel
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect
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
