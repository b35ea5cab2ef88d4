"""From a study to the measurement model that diagnosis works on: map, body and the study's effects.

The map is searched as `palpmap fit` does, without effects; the study's effects are then fitted
jointly with it, from the values that the study gives or from the linear estimate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from identify.body.body_model import BodyModel
from identify.body.mechanics import BodyMechanics
from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.user_effect import load_effect
from identify.effects.base import Effect, Values
from identify.effects.readings import Readings
from identify.fit.contact_law import ContactLaw
from identify.fit.free_compliance_start import (
    curved_again,
    free_compliance,
    law_of,
    straight,
    typical_error,
    typical_error_m,
)
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.fit.search import FitIteration
from identify.fit.settings import PRECISE
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import scan_noise
from identify.optimize.result import InadmissibleError
from identify.select.candidates import fit_with
from identify.select.first_step import follow
from identify.select.forward_selection import FirstStep
from identify.select.score_test import fitted_basis, score_effect
from models.errors import InputError
from models.scan import Scan
from models.scan_file import read_scan
from models.thin import thinned
from palpmap.study.body_model import build_body_model
from palpmap.study.checks import refuse_effect, refuse_unfit
from palpmap.study.map_fit import fit_study
from palpmap.study.placement import Placement, place_scan
from palpmap.study.study import Study

Say = Callable[[str], None]

# Chi-square per degree of freedom from which on a map has an error of its own, where a block stands
# in for a body of another shape; elsewhere that of a gross misfit
_OTHER_SHAPE = 1.5
_ERROR_ROUNDS = 2
_WEAKER = (1.0, 0.3, 0.1, 0.03)  # parts of the inclusions' weights


@dataclass(frozen=True)
class Problem:
    """A scan, its body's models, the map without effects, and the model with the study's effects.

    `catalogue` holds the built-in effects and the user's own, `law` what the presses show by
    themselves (None where that was not asked), `left_out` how many presses too many the scan has,
    `measured` the whole scan as read, in its own frame.
    """

    study: Study
    placement: Placement
    body: BodyModel
    fit: FitResult
    model: MeasurementModel
    start: GaussianMap
    catalogue: tuple[Effect, ...]
    law: ContactLaw | None = None
    left_out: int = 0
    measured: Scan | None = None

    @property
    def scan(self) -> Scan:
        """The scan in the body's frame."""
        return self.placement.scan

    @property
    def first_step(self) -> FirstStep | None:
        """What the loop tries first: the effects that the presses show by themselves."""
        if self.law is None or not self.law.names:
            return None
        law = self.law
        return lambda rung, say: follow(law, rung, self.start, say)


def pose(
    study: Study,
    own: Sequence[Effect] = (),
    say: Say = lambda text: None,
    on_iteration: Callable[[FitIteration], None] | None = None,
    leave_out: Sequence[int] = (),
    measured: Scan | None = None,
) -> Problem:
    """Build the models of a study and fit its map and its effects.

    Parameters
    ----------
    own : effects of the user
    say : called with what is being done
    on_iteration : called with each step of the map's fit
    leave_out : ids of presses that are not to count
    measured : the study's scan, if it was read before
    """
    catalogue = catalogue_with(own)
    measured = measured or read_scan(study.scan, study.study.units_checked)
    scan = measured
    if leave_out:
        scan = scan.rows(~np.isin(scan.press, leave_out))
    placement = place_scan(thinned(scan), study)
    refuse_unfit(placement, study)
    say("meshing the body")
    body = build_body_model(study, placement.scan.used())
    law, fit, error = rough_fit(study, placement, body, catalogue, say, on_iteration)
    starts = law.plain.values if law else {}
    model, start = fit_effects(study, placement.scan, body, fit, own, say, starts, error)
    left = len(scan.press_ids) - len(placement.scan.press_ids)
    return Problem(
        study, placement, body, fit, model, start, catalogue, law, left, measured
    )  # fmt: skip


def law_of_study(
    study: Study,
    placement: Placement,
    body: BodyModel,
    catalogue: Sequence[Effect],
    say: Say = lambda text: None,
) -> ContactLaw | None:
    """Return what the presses by themselves call for beside the study's effects, see `law_of`."""
    scan = placement.scan
    noise = scan_noise(scan.used(), study.noise.displacement_m, study.noise.force_n)
    presses = free_compliance(scan, body, noise)
    effects = [(named(catalogue, entry.name), entry.initial) for entry in study.effects]
    had = [presses.begun(e, initial) for e, initial in effects if presses.shows(e)]
    return law_of(presses, had, catalogue, say)


def rough_fit(
    study: Study,
    placement: Placement,
    body: BodyModel,
    catalogue: Sequence[Effect],
    say: Say = lambda text: None,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> tuple[ContactLaw | None, FitResult, float]:
    """Fit the map roughly, where need be to the readings without what the presses show alone.

    Where even then the map is far from the presses, its error outweighs the noise: the few presses
    that the noise makes the surest (hard places) would have the map to themselves. The fit then
    counts it as noise of the displacement, for all presses alike; returned (third) is what the map
    is usually off by in a press's compliance, relative, else 0.
    """
    scan = placement.scan
    noise = scan_noise(scan.used(), study.noise.displacement_m, study.noise.force_n)
    law = law_of_study(study, placement, body, catalogue, say)
    say("fitting the map")
    if law is None:
        return None, fit_study(study, placement, body, callback=on_iteration, rough=True), 0.0
    placed = replace(placement, scan=straight(scan, law.found))
    fit = fit_study(study, placed, body, callback=on_iteration, rough=True, noise=noise)
    gross = PRECISE.is_gross(fit.chi2_per_dof)
    if placement.onto_another_shape:
        gross = fit.chi2_per_dof > _OTHER_SHAPE
    for _ in range(_ERROR_ROUNDS if gross else 0):
        say("fitting the map, with an error of its own")
        error_m = typical_error_m(fit, placed.scan)
        own = replace(noise, displacement_m=float(np.hypot(noise.displacement_m, error_m)))
        fit = fit_study(study, placed, body, callback=on_iteration, rough=True, noise=own)
    error = typical_error(fit, law.found) if gross else 0.0
    return law, curved_again(replace(fit, noise=noise), scan), error


def fit_effects(
    study: Study,
    scan: Scan,
    body: BodyModel,
    fit: FitResult,
    own: Sequence[Effect] = (),
    say: Say = lambda text: None,
    starts: Mapping[str, Values] = MappingProxyType({}),
    press_error: float = 0.0,
) -> tuple[MeasurementModel, GaussianMap]:
    """Return the model with a study's effects near their estimates, and the map beside them.

    `starts` are values of effects for which the study gives none, `press_error` is the model's.
    """
    model = replace(measurement_model(scan, body, fit), press_error=press_error)
    start = possible_map(model, fit.map)
    if start is not fit.map:
        corrected = model.mechanics.corrected(start, model.mechanics.state())
        model = replace(model, mechanics=corrected)
    for entry in study.effects:
        effect = named(catalogue_with(own), entry.name)
        say(f"fitting {effect.name}")
        initial = entry.initial or dict(starts.get(effect.name, {}))
        joint = _with_effect(model, start, effect, initial)
        model, start = joint.model, joint.map
    return model, start


def possible_map(model: MeasurementModel, found: GaussianMap) -> GaussianMap:
    """Return the map, or one with weaker inclusions where the model cannot evaluate it.

    Presses that slipped may draw a map to inclusions that are finer than its mesh.
    """
    for share in _WEAKER:
        weaker = tuple(replace(i, weight_pa=share * i.weight_pa) for i in found.inclusions)
        stiffness = found if share == 1 else GaussianMap(found.background_pa, weaker)
        try:
            model.linearise(model.start(stiffness))
        except InadmissibleError:
            continue
        return stiffness
    return found  # the fit will say what is wrong with it


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


def measurement_model(scan: Scan, body: BodyModel, fit: FitResult) -> MeasurementModel:
    """Return the model without effects, carried to the finer body at the fitted map."""
    coarse = body.coarse
    box = coarse.mesh.box_m
    mechanics = BodyMechanics.of(coarse, body.fine)
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
) -> FitResult:
    refuse_effect(effect, model.readings, initial)
    if initial:
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
