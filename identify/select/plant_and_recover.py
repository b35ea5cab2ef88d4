"""Plant-and-recover check of an effect: with a body of finite elements.

The scan is the conformance kit's, pressed on a block of finite elements with one hard spot, of
which only the background is sought. Truth and model are the same here, on purpose: the score must
see the effect, and a refit from its linear estimate must recover the planted values. The part
hidden by a whole map is another question (`palpmap limits`).
"""

from dataclasses import replace
from functools import cache

import numpy as np

from fem import Contacts, PalpationModel, block_mesh
from identify.body.correction import Correction
from identify.body.discretization_error import TipPressure
from identify.body.mechanics import BodyMechanics
from identify.effects.base import Effect, Values, changes_body
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.example_scan import ExampleScan, trial
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.select.candidates import fit_with
from identify.select.score_test import Score, fitted_basis, score_effect

NOT_PLANTED = "not planted: "  # start of a finding without a check
_DIVISIONS = (5, 5, 3)
_MAP = GaussianMap(6000.0, (Inclusion(9000.0, 0.040, 0.060, 0.030, 0.015),))
_NOISE = Noise(1e-5, 2e-3)


def plant_and_recover(effect: Effect, case: ExampleScan) -> str:
    """Plant the effect in a known map, score it and refit; for `conformance.check_effect`.

    Raises
    ------
    Fault
        The score does not see the effect, or the refit does not recover it.
    """
    plain = _fit(case, effect, None)
    score = score_effect(plain, effect, fitted_basis(plain.at))
    if score.untestable:
        return NOT_PLANTED + score.untestable
    values = _values(effect, plain, score, case.settings.planted_sigmas)
    if values is None:
        return NOT_PLANTED + "within its bounds this scan does not show it beside the map"
    fit = _fit(case, effect, values)
    score = score_effect(fit, effect, fitted_basis(fit.at))
    said = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
    if score.p_value > case.settings.score_p:
        raise Fault(f"planted {said}: the score does not see it, p = {score.p_value:.2g}")
    found = fit_with(fit, effect, score)
    if found is None:
        raise Fault(f"planted {said}: no refit is possible from {dict(score.values)}")
    for p in effect.amplitudes:
        name = f"{effect.name}.{p.name}"
        off, deviation = found.values[name] - values[p.name], found.std[name]
        part = case.settings.recovered_share * abs(values[p.name] - (p.null or 0))
        if not abs(off) <= max(case.settings.recovered_sigmas * deviation, part):
            raise Fault(
                f"planted {said}: {p.name} came back as {found.values[name]:.3g} "
                f"+- {deviation:.2g} {p.unit}"
            )
    back = ", ".join(f"{found.values[f'{effect.name}.{n}']:.3g}" for n in values)
    return f"{said}; found {back}"


@cache
def _mechanics() -> BodyMechanics:
    readings, state = trial().readings, trial().state
    first = readings.first
    contacts = Contacts(
        readings.point_m[first], readings.direction[first], readings.radius_m[first]
    )
    mesh = block_mesh(tuple(np.array(state.box_m)[1].tolist()), _DIVISIONS)

    def at(nu: float) -> PalpationModel:
        return PalpationModel(mesh, nu, contacts)

    # errors of mesh and pressure for effects to scale, by the places of the presses
    far = np.linalg.norm(contacts.points_m - contacts.points_m.mean(axis=0), axis=1)
    far /= far.max()
    errors = Correction(model_error=0.02 * far, tip=TipPressure(0.1 * far**2))
    return BodyMechanics(at(state.poisson_ratio), None, at, errors)


def _fit(case: ExampleScan, effect: Effect, values: Values | None) -> FitResult:
    """Fit the map alone to a scan with the effect planted (without for None)."""
    rng = np.random.default_rng(0)
    readings, mechanics = case.readings, _mechanics()
    space = parameter_space(_MAP, np.array(case.state.box_m), ["background_pa"])
    state = mechanics.state().changed(background_pa=_MAP.background_pa)
    if values and changes_body(effect):
        state = effect.body(state, **values)
    body = mechanics.evaluate(_MAP, state)
    coarse = mechanics.coarse.contacts
    chain = Chain(
        readings, [effect] if values else [], coarse.radius_m, coarse.profile,
        mechanics.poisson_ratio,
    )  # fmt: skip
    own = {effect.name: values or {}}
    travel = chain.predict(
        OperatingPoint(body.compliance, body.local_modulus, readings.force_n, own)
    )
    noisy = readings.force_n + _NOISE.force_n * rng.standard_normal(len(travel))
    model = MeasurementModel(
        replace(readings, force_n=noisy),
        travel + _NOISE.displacement_m * rng.standard_normal(len(travel)),
        _NOISE,
        mechanics,
        space,
    )
    return fit_jointly(model, _MAP, rounds=0)


def _values(
    effect: Effect, plain: FitResult, score: Score, sigmas: float
) -> dict[str, float] | None:
    """Return amplitudes of so many standard errors, at the shape of these errors."""
    readings, state = plain.model.readings, plain.at.state
    values = {p.name: score.values[p.name] for p in effect.shapes}
    room = 0.0
    for p, error in zip(
        (q for q in effect.bounded(readings, state) if q.null is not None),
        score.errors,
        strict=True,
    ):
        assert p.null is not None
        size = sigmas * error * p.typical
        up, down = min(size, p.upper - p.null), min(size, p.null - p.lower)
        values[p.name] = p.null + up if up >= down else p.null - down
        room = max(room, max(up, down) / max(error * p.typical, 1e-300))
    return values if room >= sigmas / 2 else None
