"""Start of the selection: from an experiment to a model of map, body and given effects.

The map is searched without effects; the experiment's effects are then fitted jointly with it, from
the given values or from the linear estimate.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np

from fem import SolverError
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect, Values
from identify.effects.initial import lacking_in
from identify.effects.readings import Readings
from identify.effects.units import digits
from identify.fit.contact_law import ContactLaw
from identify.fit.contact_law_sets import Set
from identify.fit.free_compliance_start import (
    curved_again,
    free_compliance,
    law_of,
    straight,
    typical_error,
    typical_error_m,
)
from identify.fit.free_map.parametric_evidence import parametric_evidence
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.fit.search import FitIteration
from identify.fit.settings import CONTACT_LAW, ContactLawSettings
from identify.fit.start_map import fit_map
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space
from identify.measurement.experiment import BodyModel, PlacedExperiment
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.select.candidates import fit_with
from identify.select.score_test import fitted_basis, score_effect
from identify.select.settings import START, StartSettings
from models import Catalogue, InputError, Scan


@dataclass(frozen=True)
class StartFit:
    """Start of the selection.

    Attributes
    ----------
    experiment : scan, body, noise
    catalogue : candidates
    fit : the map alone
    model : with the experiment's effects
    start : map beside these effects
    law : contact law of the presses alone, None where it was not needed
    """

    experiment: PlacedExperiment
    catalogue: Catalogue[Effect]
    fit: FitResult
    model: MeasurementModel
    start: GaussianMap
    law: ContactLaw | None = None

    @cached_property
    def joint(self) -> FitResult:
        """The map fitted jointly with the experiment's effects."""
        if self.fit.field is not None:  # it was
            return self.fit
        return fit_jointly(self.model, self.start)

    def leading_sets(self, presses: Sequence[int]) -> tuple[Set, ...]:
        """Return the sets that a law without a few presses (ids) is sought among, empty for all."""
        most = CONTACT_LAW.few * len(self.scan.press_ids)
        return self.law.leading if self.law and len(presses) <= most else ()

    @property
    def scan(self) -> Scan:
        """The scan in the body's frame."""
        return self.experiment.scan

    @property
    def body(self) -> BodyModel:
        """Finite element models of the body."""
        return self.experiment.body


def start_fit(
    experiment: PlacedExperiment,
    catalogue: Catalogue[Effect],
    on_iteration: Callable[[FitIteration], None] | None = None,
    settings: StartSettings = START,
    tried: Sequence[Set] = (),
) -> StartFit:
    """Fit the map of an experiment and its effects.

    Parameters
    ----------
    catalogue : effects of a contact law, and candidates of the selection
    on_iteration : called with each step of the map's fit
    tried : sets of effects of a contact law, see `contact_law`
    """
    if experiment.map.field is not None:
        law = contact_law_of(experiment, catalogue, settings.contact_law, tried)
        experiment.say("fitting the map")
        more = law is not None and bool(
            law.names or law.partial
        )  # the first step will fit it with these
        fit = fit_map(experiment, callback=on_iteration, rough=more, settings=settings.fit)
        return StartFit(experiment, catalogue, fit, fit.model, fit.map, law)
    law, fit, error = rough_fit(experiment, catalogue, on_iteration, settings, tried)
    starts = law.plain.values if law else {}
    model, start = fit_effects(experiment, fit, starts, error, settings)
    return StartFit(experiment, catalogue, fit, model, start, law)


@dataclass(frozen=True)
class KindOfMap:
    """The kind of map for which a scan gives more evidence: `free`, or inclusions.

    Attributes
    ----------
    free : whether it is the free one
    fit : the free fit
    says : the decision, in words
    """

    free: bool
    fit: FitResult
    says: str


def kind_of_map(
    experiment: PlacedExperiment,
    other: PlacedExperiment,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> KindOfMap:
    """Decide between inclusions, of a number by the information criterion, and a free map.

    On the same mesh, both beside the experiment's effects, each press with an error of its own.

    Parameters
    ----------
    other : the experiment with inclusions and the models for these, on which they are sought: that
        of a free map is finer, and takes ten times as long
    """
    experiment.say("fitting a free map")
    free = fit_map(experiment, callback=on_iteration)
    other.say("fitting inclusions")
    inclusions = with_effects(other) if other.effects else fit_map(other)
    experiment.say("fitting inclusions on the mesh of the free map")
    inclusions = _on_models(inclusions, experiment)
    assert free.field is not None
    at, uncertain = inclusions.solution, free.model.map_uncertainty
    assert at is not None
    assert uncertain is not None
    more = free.field.log_evidence - parametric_evidence(at.model, at.at.body, at.u, uncertain.felt)
    number = len(inclusions.map.inclusions)
    few = "one inclusion" if number == 1 else f"{number or 'no'} inclusions"
    above = f"its log evidence is {digits(abs(more))} above that of"
    says = f"a free map, {above} {few}" if more > 0 else f"{few}, {above} a free map"
    return KindOfMap(more > 0, free, f"the kind of map by evidence: {says}")


def _on_models(fit: FitResult, experiment: PlacedExperiment) -> FitResult:
    """Return inclusions and effects fitted again on the models of another experiment."""
    model, start = measurement_model(experiment.scan, experiment.body, fit)
    return fit_jointly(replace(model, effects=fit.model.effects), start)


def contact_law_of(
    experiment: PlacedExperiment,
    catalogue: Catalogue[Effect],
    settings: ContactLawSettings = CONTACT_LAW,
    tried: Sequence[Set] = (),
) -> ContactLaw | None:
    """Return the contact law of the presses alone beside the experiment's effects (`law_of`).

    Raises
    ------
    InputError
        The scan cannot show an effect of the study, or its values are not those that it has.
    """
    for effect, initial in experiment.effects:
        refuse_effect(effect, Readings.of(experiment.scan), initial)
    presses = free_compliance(experiment.scan, experiment.body, experiment.noise)
    stated = [presses.begun(e, initial) for e, initial in experiment.effects if presses.shows(e)]
    return law_of(presses, stated, catalogue, experiment.say, settings, tried)


def rough_fit(
    experiment: PlacedExperiment,
    catalogue: Catalogue[Effect],
    on_iteration: Callable[[FitIteration], None] | None = None,
    settings: StartSettings = START,
    tried: Sequence[Set] = (),
) -> tuple[ContactLaw | None, FitResult, float]:
    """Fit an initial map; a nonlinear contact law of the presses is subtracted first.

    A map that is still far from the presses has an error above the noise: the few presses that the
    noise makes the surest (hard places) would have the map to themselves. The fit then counts this
    error as noise of the displacement, for all presses alike. Returned third is the map's typical
    relative error of a press's compliance, else 0.
    """
    scan, noise, say = experiment.scan, experiment.noise, experiment.say
    law = contact_law_of(experiment, catalogue, settings.contact_law, tried)
    say("fitting the map")
    rough = partial(fit_map, callback=on_iteration, rough=True, settings=settings.fit)
    if law is None:
        return None, rough(experiment), 0.0
    placed = replace(experiment, scan=straight(scan, law.found))
    fit = rough(placed)
    gross = settings.fit.is_gross(fit.chi2_per_dof)
    if experiment.onto_another_shape:
        gross = fit.chi2_per_dof > settings.other_shape
    for _ in range(settings.error_rounds if gross else 0):
        say("fitting the map, with an error of its own")
        error_m = typical_error_m(fit, placed.scan)
        wider = replace(noise, displacement_m=float(np.hypot(noise.displacement_m, error_m)))
        fit = rough(replace(placed, noise=wider))
    error = typical_error(fit, law.found) if gross else 0.0
    return law, curved_again(replace(fit, noise=noise), scan), error


def fit_effects(
    experiment: PlacedExperiment,
    fit: FitResult,
    starts: Mapping[str, Values] = MappingProxyType({}),
    press_error: float = 0.0,
    settings: StartSettings = START,
) -> tuple[MeasurementModel, GaussianMap]:
    """Return the model with the effects near their estimates, and the map beside them.

    `starts` are values of effects without given ones, `press_error` is the model's.
    """
    model, start = measurement_model(experiment.scan, experiment.body, fit, settings)
    model = replace(model, press_error=press_error)
    for effect, initial in experiment.effects:
        experiment.say(f"fitting {effect.name}")
        joint = _with_effect(model, start, effect, initial or dict(starts.get(effect.name, {})))
        model, start = joint.model, joint.map
    return model, start


def with_effects(
    experiment: PlacedExperiment, on_iteration: Callable[[FitIteration], None] | None = None
) -> FitResult:
    """Fit a map of inclusions jointly with the experiment's effects.

    The map starts from readings without these effects, as the presses alone show them: beside a
    missing effect it may end far away. `on_iteration` is called with each step of that map's fit,
    and with the joint estimate, which ends the history.
    """
    start = start_fit(experiment, Catalogue(()), on_iteration)
    joint, before = start.joint, start.fit.history
    values = dict(zip(joint.map.names, joint.map.values.tolist(), strict=True))
    number = before[-1].iteration + 1 if before else 0
    end = FitIteration(number, values, joint.chi2, joint.chi2_per_dof, joint.rms_m)
    if on_iteration:
        on_iteration(end)
    return replace(joint, history=(*before, end))


def measurement_model(
    scan: Scan, body: BodyModel, fit: FitResult, settings: StartSettings = START
) -> tuple[MeasurementModel, GaussianMap]:
    """Return the model without effects, corrected to the finer body at a map, and that map.

    It is the fitted one, or one with weaker inclusions where a mesh does not resolve it.
    """
    coarse = body.coarse
    mechanics = BodyMechanics.of(coarse, body.fine)
    if fit.field is None:
        mechanics = mechanics.following_growth()
    if fit.solution is not None:
        mechanics = mechanics.sharing(fit.model.mechanics)
    free = [name for name in fit.covariance_names if name in fit.map.names]
    space = parameter_space(fit.map, coarse.mesh.box_m, free, coarse.probed_m)
    model = MeasurementModel(
        Readings.of(scan), scan.used().displacement_m, fit.noise, mechanics, space
    )
    return possible(model, fit.map, settings)


def possible(
    model: MeasurementModel, found: GaussianMap, settings: StartSettings = START
) -> tuple[MeasurementModel, GaussianMap]:
    """Return a model corrected at a map that both meshes resolve, and that map.

    Presses that slipped may draw a map to inclusions that are finer than a mesh.

    Raises
    ------
    InadmissibleError, SolverError
        Where no weaker inclusions help either.
    """

    def corrected_at(share: float) -> tuple[MeasurementModel, GaussianMap]:
        stiffness = found
        if share < 1:
            weaker = tuple(replace(i, weight_pa=share * i.weight_pa) for i in found.inclusions)
            stiffness = GaussianMap(found.background_pa, weaker)
        mechanics = model.mechanics.corrected(stiffness, model.mechanics.state())
        there = replace(model, mechanics=mechanics)
        there.linearise(there.start(stiffness))
        return there, stiffness

    shares = (1.0, *settings.weaker) if found.inclusions else (1.0,)
    for share in shares[:-1]:
        with suppress(InadmissibleError, SolverError):
            return corrected_at(share)
    return corrected_at(shares[-1])


def refuse_effect(effect: Effect, readings: Readings, initial: Values) -> None:
    """Refuse an effect that a scan cannot show, and values to start from that it does not have."""
    reason = effect.untestable(readings)
    if reason is not None:
        raise InputError(f"the effect '{effect.name}' cannot be fitted to this scan: {reason}")
    if lacking := lacking_in(effect, initial):
        raise InputError(f"effect '{effect.name}': expected {lacking}")


def _with_effect(
    model: MeasurementModel, start: GaussianMap, effect: Effect, initial: Values
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
