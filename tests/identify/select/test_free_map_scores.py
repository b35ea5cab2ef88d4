"""Score tests beside every map of a prior: uniform under noise, alive under an effect."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.stats import kstest

from fem import Contacts, PalpationModel, block_mesh
from identify.body import BodyMechanics
from identify.catalogue import CATALOGUE
from identify.design.seen_pattern import seen_patterns, signal_m
from identify.design.settings import DETECTION
from identify.effects import Readings
from identify.fit import FitResult
from identify.map import FreeMap, Grid, MaternField
from identify.map.parameters import ParameterSpace
from identify.measurement.chain import OperatingPoint
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.optimize.gauss_newton import covariance
from identify.select.explanation import ended_by_presses
from identify.select.model_error import few_presses, within_laws
from identify.select.patterns import effect_patterns
from identify.select.score_test import fitted_basis, unavailable
from identify.select.settings import SELECTION
from identify.select.step import Step, hides_lead, replaces_map
from models import Scan

SIZE_M, NOISE = (0.06, 0.06, 0.03), Noise(2e-5, 2e-3)
FORCES_N = np.linspace(0.1, 0.8, 8)
EFFECTS = ("contact_offset", "force_bias", "strain_stiffening", "touch_threshold", "surface_tilt")
SEEDS = range(100)
SHARE = 0.05  # of the prior: compliances a tenth off the map, many times the noise of a press


@pytest.fixture(scope="module")
def model() -> MeasurementModel:
    """A ball on 25 places of a small body, beside every map of a prior."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0.01, 0.05, 5)] * 2))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    down = np.tile([0, 0, -1.0], (x.size, 1))
    contacts = Contacts(points, down, np.full(x.size, 0.003), "hertz")
    body = PalpationModel(block_mesh(SIZE_M, (5, 5, 3)), 0.45, contacts)
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.006)
    press = np.repeat(np.arange(25), len(FORCES_N))
    rows = len(press)
    scan = Scan(
        press=press, time_s=np.full(rows, np.nan), phase=np.full(rows, "load"),
        force_n=np.tile(FORCES_N, 25), displacement_m=np.tile(FORCES_N, 25) * 1e-3,
        point_m=points[press], direction=down[press], probe_radius_m=np.full(rows, 0.005),
    )  # fmt: skip
    field = FreeMap(
        grid, np.log(8e3) + MaternField(grid, 0.02, 0.3).draws(np.random.default_rng(1), 1)[0]
    )
    unit = 1e4 * body.evaluate(1e4).compliance
    plain = MeasurementModel(
        Readings.of(scan), scan.displacement_m, NOISE, BodyMechanics.of(body),
        ParameterSpace(field, (), ()), unit_compliance=unit,
    )  # fmt: skip
    by_field = plain.body(np.empty(0)).by_field()
    of_s = MaternField(grid, 0.02, 0.3, 2.0).product(by_field) @ by_field.T
    uncertain = MapUncertainty(of_s, np.full(25, 0.01**2), np.zeros(25), np.ones(25))
    return replace(plain, map_uncertainty=uncertain)


def scan_of(model: MeasurementModel, seed: int, **effect: dict[str, float]) -> MeasurementModel:
    """Readings of a map drawn from the prior, its error and the noise of both columns."""
    rng, uncertain, r = np.random.default_rng(seed), model.map_uncertainty, model.readings
    assert uncertain is not None
    whole = uncertain.of_field + np.diag(uncertain.own)
    moved = SHARE * np.linalg.cholesky(whole) @ rng.standard_normal(25)
    c = model.body(np.empty(0)).compliance * np.exp(moved)
    assert model.unit_compliance is not None
    effects = [CATALOGUE[name] for name in effect]
    chain = replace(model.chain, effects=effects)
    travel = chain.predict(OperatingPoint(c, model.unit_compliance / c, r.force_n, effect))
    readings = replace(r, force_n=r.force_n + rng.normal(0, NOISE.force_n, len(r.press)))
    travel = travel + rng.normal(0, NOISE.displacement_m, len(travel))
    small = replace(uncertain, of_field=SHARE**2 * uncertain.of_field, own=SHARE**2 * uncertain.own)
    return replace(model, readings=readings, displacement_m=travel, map_uncertainty=small)


def deviate(model: MeasurementModel, name: str) -> float:
    """Score of an effect of one amplitude, in standard errors."""
    at = model.around(model.body(np.empty(0)), np.empty(0))
    column = effect_patterns(model, at, CATALOGUE[name], most=1).columns[0, :, 0]
    return float(column @ at.residual / np.linalg.norm(column))


@pytest.mark.slow
def test_scores_are_normal_under_noise_and_any_map_of_the_prior(model):
    body = model.body(np.empty(0))
    scores = {name: [] for name in EFFECTS}
    chi2 = []
    for seed in SEEDS:
        drawn = scan_of(model, seed)
        at = drawn.around(body, np.empty(0))
        chi2.append(at.chi2)
        for name in EFFECTS:
            column = effect_patterns(drawn, at, CATALOGUE[name], most=1).columns[0, :, 0]
            scores[name].append(column @ at.residual / np.linalg.norm(column))
    rows = len(model.readings.press)
    assert abs(np.mean(chi2) / rows - 1) < 4 * np.sqrt(2 / rows / len(SEEDS))
    for name, found in scores.items():
        assert kstest(found, "norm").pvalue > 0.002, name


def test_an_effect_is_seen_beside_every_map(model):
    shifted = scan_of(model, 3, touch_threshold={"threshold_n": 0.08})
    assert abs(deviate(shifted, "touch_threshold")) > 5
    blind = replace(shifted, map_uncertainty=replace(
        shifted.map_uncertainty, of_field=1e6 * shifted.map_uncertainty.of_field
    ))  # fmt: skip
    assert abs(deviate(blind, "touch_threshold")) > 4  # its curve, which no map has


@pytest.mark.parametrize("name", ["contact_offset", "tool_compliance"])
def test_a_detection_limit_is_the_size_of_the_effect_not_of_what_a_free_map_leaves_of_it(
    model, name
):
    """An offset is as large as its change of every reading; a compliance goes with force."""
    drawn = scan_of(model, 4)
    at, effect = drawn.around(drawn.body(np.empty(0)), np.empty(0)), CATALOGUE[name]
    fitted, normal = fitted_basis(at), np.linalg.pinv(at.jacobian)
    (seen,) = seen_patterns(drawn, at, effect, fitted, normal, DETECTION)
    size = abs(float(seen.sizes[0])) * effect.parameters[0].typical
    force_n = 1.0 if name == "contact_offset" else at.latent_force_n
    assert seen.share * signal_m(at) == pytest.approx(size * np.sqrt(np.mean(force_n**2)), rel=0.02)
    change_m = size * force_n * np.ones(len(at.residual))
    assert np.linalg.norm(at.whitened(change_m, drawn.readings.press)) == pytest.approx(1, rel=0.02)


def test_a_form_of_the_map_is_no_effect_beside_a_free_map(model):
    for name in ("extra_inclusion", "stiffness_gradient", "side_gradient"):
        assert "free map" in (unavailable(CATALOGUE[name], model) or "")
    assert unavailable(CATALOGUE["poisson_ratio"], model) is None


def test_the_interval_of_an_effect_counts_the_map(model):
    """Beside a wider prior of the map an offset is known no better, and never exactly."""
    with_offset = model.with_effect(
        CATALOGUE["contact_offset"], {"offset_m": 0.0}, model.mechanics.state()
    )
    at = with_offset.around(with_offset.body(np.zeros(1)), np.zeros(1))
    uncertain = model.map_uncertainty
    narrow = replace(
        with_offset,
        map_uncertainty=replace(
            uncertain, of_field=1e-8 * uncertain.of_field, own=1e-8 * uncertain.own
        ),
    )
    sure = narrow.around(at.body, np.zeros(1))
    assert covariance(at.jacobian)[0, 0] > 1.2 * covariance(sure.jacobian)[0, 0]


def test_structure_within_the_accuracy_of_contact_laws_ends_the_selection():
    """Beside a free map, and where the presses called for the laws: both limits, each alone."""
    shown, other = (SimpleNamespace(shown_by_presses=s) for s in (True, False))

    def within(chi2: float, accepted: list, first: float = 20000, field: object = 1) -> bool:
        fits = [SimpleNamespace(chi2=c, dof=1000, chi2_per_dof=c / 1000, field=field)
                for c in (first, chi2)]  # fmt: skip
        return within_laws(*fits, accepted, SELECTION)

    assert within(1150, [shown, other])
    assert not within(1250, [shown])  # a hundredth of what they explain is 188
    assert not within(1500, [shown], first=90000)  # 1.22 times the noise
    assert not within(1150, [other])
    assert not within(1150, [shown], field=None)


def test_few_presses_that_no_law_explains_are_known():
    """Of 20 presses two hold the excess; not where all do, nor without a law of the presses."""
    shown = [SimpleNamespace(shown_by_presses=True, partial=False)]
    press = np.repeat(np.arange(20), 10)

    def found(residual: np.ndarray, accepted: list = shown) -> list[int]:
        readings = SimpleNamespace(press=press, presses=20)
        fit = SimpleNamespace(
            model=SimpleNamespace(readings=readings), at=SimpleNamespace(residual=residual),
            field=1, chi2=float(residual @ residual), dof=200,
            chi2_per_dof=float(residual @ residual) / 200,
        )  # fmt: skip
        few = np.flatnonzero(few_presses(fit, accepted, SELECTION)).tolist()
        assert bool(few) == bool(ended_by_presses(fit, fit, accepted, SELECTION))
        return few

    residual = np.where(np.isin(press, (3, 11)), 5.0, 1.0)
    assert found(residual) == [3, 11]
    assert found(residual, []) == []
    assert found(np.where(press < 6, 5.0, 1.0)) == []  # a third are no few
    assert found(np.where(press == 3, 2.5, 1.4)) == []  # most of the excess lies elsewhere


def test_nothing_is_sought_in_the_error_of_laws():
    """A residual of 1.05 times the noise in every press, of which laws explained nearly all."""
    shown = [SimpleNamespace(shown_by_presses=True, partial=False)]
    readings = SimpleNamespace(press=np.repeat(np.arange(20), 10), presses=20)
    at = SimpleNamespace(residual=np.full(200, 1.05))
    fit = SimpleNamespace(
        model=SimpleNamespace(readings=readings), at=at, field=1, chi2=220.5, dof=200,
        chi2_per_dof=1.1,
    )  # fmt: skip
    first = SimpleNamespace(chi2=20000.0, dof=200)
    assert "laws of contact" in ended_by_presses(first, fit, shown, SELECTION)
    assert not ended_by_presses(first, fit, shown, SELECTION, noise=True)


def test_nothing_is_sought_beside_the_law_of_some_presses():
    partial = [SimpleNamespace(shown_by_presses=False, partial=True)]
    fit = SimpleNamespace(
        field=1, model=SimpleNamespace(readings=SimpleNamespace(press=[0], presses=1))
    )
    assert "structure in many" in ended_by_presses(fit, fit, partial, SELECTION)


def test_an_effect_that_takes_the_place_of_the_compliances_is_no_gain():
    def fit(chi2: float, error: float | None) -> FitResult:
        field = None if error is None else SimpleNamespace(ordinary_error=error)
        return cast(FitResult, SimpleNamespace(chi2=chi2, field=field))

    before = fit(24981.0, 0.066)
    assert replaces_map(before, fit(25526.0, 1.2))
    assert not replaces_map(before, fit(24980.0, 1.2))  # it explains
    assert not replaces_map(before, fit(25526.0, 0.01))  # the map follows the presses closer
    assert not replaces_map(fit(24981.0, None), fit(25526.0, None))


def test_a_step_that_takes_the_lead_away_and_not_what_follows_it_is_known():
    def step(chi2: float, law: object) -> Step:
        comparison = SimpleNamespace(law=law, is_noise=False)
        fit = SimpleNamespace(chi2=chi2, dof=1000)
        return cast(Step, SimpleNamespace(fit=fit, comparison=comparison))

    before = step(2000.0, SimpleNamespace(share=0.9))
    assert hides_lead(before, step(1800.0, None), SELECTION)
    assert not hides_lead(before, step(1500.0, None), SELECTION)  # it takes half of what follows
    assert not hides_lead(before, step(1800.0, before.comparison.law), SELECTION)
