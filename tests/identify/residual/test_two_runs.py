"""Two fits of one body: maps that agree within their errors, and one that was changed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue import CATALOGUE
from identify.fit import Estimate
from identify.map import FreeMap, GaussianMap, Grid, Inclusion
from identify.residual import run_difference
from identify.residual.two_runs import log_modulus_sd
from palpmap.report.difference_report import statement_of, title_of
from tests.identify.residual.test_prediction import SIZE_M, TRUTH, fitted, fitted_model, scan_of

BOX = np.array([(0.0, 0.0, 0.0), SIZE_M])


@pytest.fixture(scope="module")
def fits():
    return [
        fitted(scan_of(fitted_model(), TRUTH, np.random.default_rng(seed))) for seed in (10, 11)
    ]


def test_two_scans_of_one_body_agree_within_their_errors(fits):
    found = run_difference(*fits, BOX, BOX, CATALOGUE)
    assert not found.maps_differ
    assert np.abs(found.standard_errors).max() < 4
    assert not found.changed


def test_the_standard_error_is_that_of_the_parameters(fits):
    at = np.array([[0.001, 0.001, 0.001]])  # where no inclusion is: the background alone
    background = fits[0].std["background_pa"] / fits[0].values["background_pa"]
    birge = np.sqrt(max(fits[0].chi2_per_dof, 1.0))
    assert log_modulus_sd(fits[0], at, BOX, CATALOGUE)[0] == pytest.approx(
        background * birge, rel=0.01
    )


def test_a_harder_inclusion_is_found_at_its_place(fits):
    harder = GaussianMap(8e3, (Inclusion(15e3, 0.03, 0.035, 0.02, 0.009),))
    other = fitted(scan_of(fitted_model(), harder, np.random.default_rng(12)))
    found = run_difference(fits[0], other, BOX, BOX, CATALOGUE)
    assert found.maps_differ
    place = found.grid.points_m[found.largest]
    assert np.linalg.norm(place - [0.03, 0.035, 0.02]) < 0.012
    assert found.log_ratio[found.largest] > 0.1


def test_an_effect_of_one_run_alone_and_another_value_are_named(fits):
    drag = Estimate(0.01, 0.001, "N", 0.008, 0.012, free=True)
    one = replace(fits[0], estimates={**fits[0].parameters, "force_bias.bias_n": drag})
    other = replace(drag, value=0.02)
    two = replace(fits[1], estimates={**fits[1].parameters, "force_bias.bias_n": other})
    names = [c.name for c in run_difference(one, two, BOX, BOX, CATALOGUE).changed]
    assert names == ["force_bias.bias_n"]
    said = statement_of(run_difference(one, two, BOX, BOX, CATALOGUE), np.zeros(3))
    assert said.endswith("Effects with other values: force_bias.")
    found = run_difference(one, fits[1], BOX, BOX, CATALOGUE)
    said = statement_of(found, np.zeros(3))
    assert "In one run alone: force_bias; the maps were found beside different models" in said
    (alone,) = found.changed
    assert (alone.one, alone.other, alone.standard_errors) == (0.01, None, None)


def test_a_free_map_differs_neither_from_itself_nor_by_what_one_of_many_places_is_off(fits):
    grid = Grid.over(BOX, 0.01)
    level = np.full(len(grid.points_m), np.log(8e3))
    off = level.copy()
    off[np.argmin(np.linalg.norm(grid.points_m - BOX.mean(axis=0), axis=1))] += 3.0 * 0.1
    one, other = (free_fit(fits[0], FreeMap(grid, field)) for field in (level, off))
    assert run_difference(one, one, BOX, BOX, CATALOGUE).p_value > 0.9
    found = run_difference(one, other, BOX, BOX, CATALOGUE)
    assert found.independent == 34
    assert not found.maps_differ  # by two of its errors
    assert run_difference(one, fits[1], BOX, BOX, CATALOGUE).changes == ()  # no names in common


def free_fit(of, found: FreeMap):
    field: Any = SimpleNamespace(log_sd=np.full(len(found.log_pa), 0.1), effective=34.2)
    mean = {"mean_pa": Estimate(8e3, 100.0, "Pa", 7.8e3, 8.2e3, free=True)}
    return replace(of, map=found, field=field, covariance_names=(), estimates=mean, chi2_per_dof=1)


def test_bodies_in_different_frames_are_refused(fits):
    with pytest.raises(ValueError, match="share no place"):
        run_difference(*fits, BOX, BOX + 1.0, CATALOGUE)


def with_effect(fit, covariance=1e-4, **values: float):
    """A fit with an effect `skin_layer__stiffening=...`, its first parameter of known variance."""
    named = {name.replace("__", "."): value for name, value in values.items()}
    sd = np.sqrt(covariance)
    first, *rest = (
        (name, Estimate(value, sd * (not at), "1", value - 2 * sd, value + 2 * sd, free=not at))
        for at, (name, value) in enumerate(named.items())
    )
    k = len(fit.covariance_names)
    grown = np.zeros((k + 1, k + 1))
    grown[:k, :k], grown[k, k] = fit.covariance, covariance
    return replace(
        fit, estimates={**fit.parameters, **dict([first, *rest])}, covariance=grown,
        covariance_names=(*fit.covariance_names, first[0]),
    )  # fmt: skip


def test_maps_are_compared_as_their_effects_change_them(fits):
    """A body that is a quarter harder above than below, and one without a gradient."""
    graded = with_effect(fits[0], stiffness_gradient__gradient=0.25)
    found = run_difference(fits[0], graded, BOX, BOX, CATALOGUE)
    assert found.in_maps == ("stiffness_gradient",)
    assert (found.maps_differ, found.beside_maps) == (True, ())
    z = found.grid.points_m[:, 2] / SIZE_M[2]
    assert found.log_ratio == pytest.approx(np.log(1 + 0.25 * (z - 0.5)))
    assert found.bodies_differ


def test_the_error_of_an_effect_that_changes_the_map_is_part_of_the_maps_error(fits):
    vague = with_effect(fits[0], covariance=1.0, stiffness_gradient__gradient=0.25)
    top = np.array([[0.001, 0.001, SIZE_M[2]]])
    sd = log_modulus_sd(vague, top, BOX, CATALOGUE)[0]
    birge = np.sqrt(max(fits[0].chi2_per_dof, 1.0))
    plain = log_modulus_sd(fits[0], top, BOX, CATALOGUE)[0]
    assert sd == pytest.approx(np.hypot(0.5 / 1.125 * birge, plain), rel=2e-3)
    assert not run_difference(fits[0], vague, BOX, BOX, CATALOGUE).maps_differ


def test_a_skin_is_in_no_map_and_the_bodies_differ_by_it(fits):
    skin = {"skin_layer__stiffening": 4.0, "skin_layer__thickness_m": 0.001}
    hard, soft = (
        with_effect(fits[0], **{**skin, "skin_layer__stiffening": s}) for s in (4.0, 0.02)
    )
    found = run_difference(fits[0], hard, BOX, BOX, CATALOGUE)
    assert (found.maps_differ, found.bodies_differ) == (False, True)
    assert found.beside_maps == ("skin_layer",)
    assert title_of(found).startswith("The maps agree, but not the effects")
    assert "the runs differ in: skin_layer." in statement_of(found, np.zeros(3))
    assert not run_difference(hard, hard, BOX, BOX, CATALOGUE).bodies_differ
    assert not run_difference(fits[0], soft, BOX, BOX, CATALOGUE).bodies_differ  # of two errors
