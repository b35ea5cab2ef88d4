"""From a study to the measurement model that diagnosis works on: map, body and the study's effects.

The map is searched as `palpmap fit` does, without effects; the study's effects are then fitted
jointly with it, from the values that the study gives or from the linear estimate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fem import PalpationModel
from identify.body_mechanics import BodyMechanics
from identify.effects.catalogue import CATALOGUE
from identify.effects.effect import Effect
from identify.effects.user_effect import load_effect
from identify.explain import fit_with
from identify.fit_record import Fit, FitIteration
from identify.gaussian_map import GaussianMap
from identify.joint_fit import JointFit, fit_jointly
from identify.measurement_model import MeasurementModel
from identify.parameter_space import parameter_space
from identify.readings import Readings
from identify.score import fitted_basis, score_effect
from models.errors import InputError
from models.scan import Scan, read_scan
from palpmap.body_model import BodyModel, build_body_model
from palpmap.map_fit import fit_study
from palpmap.placement import Placement, place_scan
from palpmap.study import Study

Say = Callable[[str], None]


@dataclass(frozen=True)
class Problem:
    """A scan, its body's models, the map without effects, and the model with the study's effects.

    `catalogue` holds the built-in effects and the user's own.
    """

    study: Study
    placement: Placement
    body: BodyModel
    fit: Fit
    model: MeasurementModel
    start: GaussianMap
    catalogue: tuple[Effect, ...]

    @property
    def scan(self) -> Scan:
        """The scan in the body's frame."""
        return self.placement.scan


def pose(
    study: Study,
    own: Sequence[Effect] = (),
    say: Say = lambda text: None,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> Problem:
    """Build the models of a study and fit its map and its effects.

    Parameters
    ----------
    own : effects of the user
    say : called with what is being done
    on_iteration : called with each step of the map's fit
    """
    catalogue = catalogue_with(own)
    placement = place_scan(read_scan(study.scan, study.study.units_checked), study)
    say("meshing the body")
    body = build_body_model(study, placement.scan.used())
    say("fitting the map")
    fit = fit_study(study, placement, body, callback=on_iteration, rough=True)
    model, start = fit_effects(study, placement.scan, body, fit, own, say)
    return Problem(study, placement, body, fit, model, start, catalogue)


def fit_effects(
    study: Study,
    scan: Scan,
    body: BodyModel,
    fit: Fit,
    own: Sequence[Effect] = (),
    say: Say = lambda text: None,
) -> tuple[MeasurementModel, GaussianMap]:
    """Return the model with a study's effects near their estimates, and the map beside them."""
    model, start = measurement_model(scan, body, fit), fit.map
    for entry in study.effects:
        effect = named(catalogue_with(own), entry.name)
        say(f"fitting {effect.name}")
        joint = _with_effect(model, start, effect, entry.initial)
        model, start = joint.model, joint.map
    return model, start


def catalogue_with(own: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the built-in effects and the user's own."""
    return (*CATALOGUE, *own)


def named(catalogue: Sequence[Effect], name: str) -> Effect:
    """Return the effect of a name, the user's own included."""
    for effect in catalogue:
        if effect.name == name:
            return effect
    names = ", ".join(effect.name for effect in catalogue)
    raise InputError(f"no effect is called '{name}'; there are: {names}")


def measurement_model(scan: Scan, body: BodyModel, fit: Fit) -> MeasurementModel:
    """Return the model without effects, carried to the finer body at the fitted map."""
    coarse = body.coarse
    box = np.array([coarse.mesh.nodes.min(axis=0), coarse.mesh.nodes.max(axis=0)])

    def at_poisson_ratio(nu: float) -> PalpationModel:
        return PalpationModel(coarse.mesh, nu, coarse.contacts, support=coarse.support)

    mechanics = BodyMechanics(coarse, body.fine, at_poisson_ratio)
    rows = scan.used()
    free = [name for name, estimate in fit.parameters.items() if estimate.free]
    return MeasurementModel(
        Readings.of(scan),
        rows.displacement_m,
        fit.noise,
        mechanics.corrected(fit.map, mechanics.state()),
        parameter_space(fit.map, box, [n for n in free if n in fit.map.names]),
    )


def _with_effect(
    model: MeasurementModel, start: GaussianMap, effect: Effect, initial: dict[str, float]
) -> JointFit:
    reason = effect.untestable(model.readings)
    if reason is not None:
        raise InputError(f"the effect '{effect.name}' cannot be fitted to this scan: {reason}")
    if initial:
        missing = [p.name for p in effect.parameters if p.name not in initial]
        unknown = [n for n in initial if n not in {p.name for p in effect.parameters}]
        if missing or unknown:
            names = ", ".join(p.name for p in effect.parameters)
            raise InputError(
                f"effect '{effect.name}', key initial: expected values of {names}; "
                f"{'missing ' + missing[0] if missing else 'unknown ' + unknown[0]}"
            )
        return fit_jointly(model.with_effect(effect, initial, model.mechanics.state()), start)
    without = fit_jointly(model, start, rounds=0)
    score = score_effect(without, effect, fitted_basis(without.at))
    if score.untestable is not None:
        raise InputError(
            f"the effect '{effect.name}' cannot be fitted to this scan: {score.untestable}"
        )
    joint = fit_with(without, effect, score)
    if joint is None:
        raise InputError(
            f"the effect '{effect.name}' leads to an impossible body; give it other values under "
            "initial"
        )
    return joint


def own_effects(study: Study, files: Sequence[Path]) -> list[Effect]:
    """Return the user's effects that a command or a study names; their files are executed.

    Those of the command come first.
    """
    named = [entry.file for entry in study.effects if entry.file is not None]
    return [load_effect(path) for path in dict.fromkeys(p.resolve() for p in [*files, *named])]
