"""The presses by themselves: the law that was planted is named, and none where there is none.

The curves are those of the exact contact of a paraboloid on a bonded layer
(`tests.fem.reference.hayes`), another modulus under each press, with first touch declared late; the
search knows no layer's contact.
"""

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from fem import Contacts
from identify.body.state import BodyState
from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.fit import contact_law_sets
from identify.fit.contact_law import _best, _near, contact_law
from identify.fit.contact_law_sets import split_sets
from identify.fit.free_compliance import FreeCompliance, _at_bound, _in_logarithms
from identify.fit.free_compliance_fit import straightened
from identify.fit.settings import CONTACT_LAW, FREE_COMPLIANCE
from identify.measurement.chain import OperatingPoint
from identify.measurement.noise import Noise
from tests.fem.reference.hayes import punch_factor, sphere_on_layer

BALL, THICKNESS, NU = 3e-3, 0.025, 0.45
DEPTH_M, LEVELS, PRESSES = 1.5e-3, 10, 24
NOISE = Noise(2e-6, 2.5e-3)


BENDING = [
    CATALOGUE[name]
    for name in (
        "spherical_tip", "strain_stiffening", "contact_offset", "touch_threshold", "force_bias",
        "force_saturation", "surface_tilt", "hysteresis",
    )
]  # fmt: skip
"""Effects that bend a press's curve, each by another law."""


@cache
def layer() -> tuple[np.ndarray, np.ndarray]:
    """Force and travel of the ball on a layer of 1 Pa, at rising contact radii."""
    radii = BALL * np.linspace(0.05, 0.97, 25)
    met = [sphere_on_layer(a, BALL, 1.0, NU, THICKNESS) for a in radii]
    return tuple(np.r_[0.0, [getattr(m, n) for m in met]] for n in ("force_n", "travel_m"))


def moduli(seed: int) -> np.ndarray:
    """Young's moduli (j,): a soft body with a hard place."""
    rng = np.random.default_rng(seed)
    return 2e4 * np.exp(rng.normal(0, 0.15, PRESSES)) * np.where(np.arange(PRESSES) < 4, 4.0, 1.0)


def presses(displacement: np.ndarray, force: np.ndarray, seed: int) -> FreeCompliance:
    """Noisy readings (j, levels) under what a study with a flat tip takes for its contact."""
    rng = np.random.default_rng(100 + seed)
    count = displacement.shape[1]
    x, y = np.meshgrid(np.linspace(0.01, 0.08, 6), np.linspace(0.01, 0.05, 4))
    point = np.column_stack([x.ravel(), y.ravel(), np.full(PRESSES, THICKNESS)])
    size = displacement.size
    readings = Readings(
        press=np.repeat(np.arange(PRESSES), count),
        order=np.arange(PRESSES),
        time_s=None,
        phase=np.full(size, "load"),
        point_m=np.repeat(point, count, axis=0),
        direction=np.tile([0.0, 0.0, -1.0], (size, 1)),
        force_n=force.ravel() + NOISE.force_n * rng.standard_normal(size),
        radius_m=np.full(size, BALL),
    )
    unit = (1 - NU**2) / (2 * BALL * punch_factor(BALL / THICKNESS, NU))
    noisy = displacement.ravel() + NOISE.displacement_m * rng.standard_normal(size)
    box = ((0.0, 0.0, 0.0), (0.09, 0.06, THICKNESS))
    return FreeCompliance(
        readings, noisy, NOISE, Contacts(readings.point_m[readings.first],
        np.array([0.0, 0.0, -1.0]), BALL), NU, np.full(PRESSES, unit), BodyState(box, NU),
    )  # fmt: skip


def ball(seed: int, threshold_n: float = 0.0, offset_m: float = 0.0) -> FreeCompliance:
    """A ball's presses; travel counts from a force, and from an offset."""
    force_1, travel_1 = layer()
    e = moduli(seed)[:, None]
    # Nearly straight in F^(2/3), so that few points do
    touch = np.interp((threshold_n / e) ** (2 / 3), force_1 ** (2 / 3), travel_1) + offset_m
    reported = np.linspace(0, DEPTH_M, LEVELS)[None, :] + 0 * e
    force = e * np.interp(reported + touch, travel_1, force_1 ** (2 / 3)) ** 1.5
    return presses(reported, force, seed)


def flat(seed: int, change=lambda d, f: (d, f)) -> FreeCompliance:
    """A flat tip's presses, straight lines, and what is done to travel and force (j, levels)."""
    e = moduli(seed)[:, None]
    share = np.linspace(0.1, 1, LEVELS)[None, :]
    stiffness = e * 2 * BALL * punch_factor(BALL / THICKNESS, NU) / (1 - NU**2)
    return presses(*change(DEPTH_M * share + 0 * e, DEPTH_M * share * stiffness), seed)


@pytest.fixture(scope="module")
def late_ball():
    """A ball's presses whose touch is declared at a force, and their law."""
    own = ball(0, threshold_n=0.05)
    return own, contact_law(own, CATALOGUE)


def test_without_a_few_presses_the_law_is_found_among_the_sets_that_led(late_ball):
    own, law = late_ball
    fewer = own.some(np.arange(3, PRESSES))
    every, leading = [], []
    whole = contact_law(fewer, CATALOGUE, (), every.append)
    again = contact_law(fewer, CATALOGUE, (), leading.append, tried=law.leading)
    assert again.names == whole.names == law.names
    assert again.found.misfit == pytest.approx(whole.found.misfit, abs=0.1)
    assert len(leading) < len(every) / 3


def test_the_search_tells_how_many_sets_there_are_to_try(late_ball):
    own, law = late_ball
    said = []
    contact_law(own.some(np.arange(3, PRESSES)), CATALOGUE, (), said.append, tried=law.leading)
    counts = [tuple(map(int, re.findall(r"\((\d+) of (\d+)\)$", text)[0])) for text in said]
    most = counts[0][1]
    assert len(law.leading) - 3 < most <= len(law.leading)  # some take more presses
    assert counts[:most] == [(k + 1, most) for k in range(most)]
    assert all(number <= most for number, most in counts)


def test_splits_far_from_the_law_are_not_fitted_to_the_end(late_ball, monkeypatch):
    own, law = late_ball
    fitted = []
    fit_set = contact_law_sets.fit_set

    def counted(presses, plain, parts):
        fitted.append(presses.settings is FREE_COMPLIANCE)
        return fit_set(presses, plain, parts)

    monkeypatch.setattr(contact_law_sets, "fit_set", counted)
    names = ("free_stiffening", "touch_threshold")
    found = own.fit([own.begun(CATALOGUE[name], {}) for name in names], law.plain.compliance)
    split_sets(own, law.plain, found, CATALOGUE, lambda text: None, CONTACT_LAW)
    assert len(fitted) > 5
    assert sum(fitted) < len(fitted) / 2


def test_a_ball_whose_touch_is_declared_at_a_force_is_found_under_a_flat_name(late_ball):
    _, law = late_ball
    assert law.plain.chi2_per_dof > CONTACT_LAW.bent
    assert "spherical_tip" in law.names
    assert len(law.names) == 2
    late = next(name for name in law.names if name != "spherical_tip")
    group = [late, *(name for name, _ in law.candidates(late))]
    assert "touch_threshold" in group
    fit = law.fits["spherical_tip", "touch_threshold"]
    assert fit.values["touch_threshold"]["threshold_n"] == pytest.approx(0.05, rel=0.1)
    assert fit.values["spherical_tip"]["share"] == pytest.approx(1, abs=0.15)
    assert law.share > 0.9
    assert law.found.rms_n < 0.3 * law.plain.rms_n


def test_the_law_of_some_presses_is_fitted_to_all_of_them(late_ball):
    own, law = late_ball
    some, said = replace(CONTACT_LAW, searched=12), []
    found = contact_law(own, CATALOGUE, (), said.append, some)
    assert found.names == law.names
    assert found.found.misfit == pytest.approx(law.found.misfit, rel=CONTACT_LAW.equal)
    assert len(found.found.compliance) == PRESSES
    late = next(name for name in law.names if name != "spherical_tip")
    assert [n for n, _ in found.candidates(late)] == [n for n, _ in law.candidates(late)]
    assert sum(text.startswith("fitting all presses") for text in said) <= 3 * some.refitted


@pytest.mark.slow
def test_a_ball_whose_touch_is_declared_late_by_a_length_is_found():
    law = contact_law(ball(1, offset_m=4e-4), CATALOGUE)
    assert law.plain.chi2_per_dof > CONTACT_LAW.bent
    assert law.names == ("spherical_tip", "contact_offset")
    found = law.found.values
    assert found["contact_offset"]["offset_m"] == pytest.approx(-4e-4, rel=0.15)
    assert law.share > 0.9


def test_the_compliances_beside_the_law_follow_the_planted_moduli(late_ball):
    own, law = late_ball
    product = np.log(law.found.compliance * moduli(0))
    assert np.std(product) < 0.03
    assert np.std(np.log(law.plain.compliance * moduli(0))) > 3 * np.std(product)
    line = straightened(law.found, own.readings)
    slope = np.bincount(own.readings.press, line * own.readings.force_n)
    slope /= np.bincount(own.readings.press, own.readings.force_n**2)
    np.testing.assert_allclose(slope, law.found.compliance, rtol=0.05)


def test_straight_lines_call_for_no_law():
    own = flat(3)
    law = contact_law(own, CATALOGUE)
    assert law.names == ()
    assert own.fit(()).chi2_per_dof == pytest.approx(1, abs=0.3)


@pytest.mark.slow
def test_a_few_bad_presses_name_nothing():
    def slip(d, f):
        f = f.copy()
        f[::10, 6:] *= 0.7
        return d, f

    own = flat(5, slip)
    law = contact_law(own, CATALOGUE)
    assert own.fit(()).chi2_per_dof > CONTACT_LAW.bent
    assert law.names == ()


@pytest.mark.slow
def test_what_differs_from_press_to_press_at_random_names_nothing():
    def rough(d, f):
        return d + np.random.default_rng(6).normal(0, 3e-4, (PRESSES, 1)), f

    own = flat(6, rough)
    law = contact_law(own, BENDING)
    assert own.fit(()).chi2_per_dof > CONTACT_LAW.bent
    assert law.names == ()


def test_one_effect_alone_is_found_alone():
    law = contact_law(flat(7, lambda d, f: (d - 3e-4, f)), CATALOGUE)
    assert law.names == ("contact_offset",)
    assert law.found.values["contact_offset"]["offset_m"] == pytest.approx(-3e-4, rel=0.05)
    assert law.candidates("contact_offset") == []


def soft_tissue(missed: int) -> FreeCompliance:
    """A ball's presses on soft, stiffening tissue; the first few met none."""
    rng, own, law = np.random.default_rng(0), flat(0), {
        "strain_stiffening": {"b": 1.0},
        "touch_threshold": {"threshold_n": 0.015},
    }  # fmt: skip
    radius, noise = 0.6 * BALL, Noise(3e-6, 7e-3)
    place = Contacts(own.contacts.points_m, own.contacts.directions, radius, "hertz")
    unit = np.full(PRESSES, 0.6 * (1 - NU**2) / (1.15 * radius))
    own = replace(own, noise=noise, contacts=place, unit_compliance=unit)
    modulus = 2.5e4 * np.exp(rng.normal(0, 0.6, PRESSES))
    force = np.linspace(0.02, 0.3, LEVELS) * np.exp(rng.normal(0, 0.5, (PRESSES, 1)))
    chain = own.chain([CATALOGUE[name] for name in law])
    travel = chain.predict(OperatingPoint(unit / modulus, modulus, force.ravel(), law))
    read = force.ravel() + noise.force_n * rng.standard_normal(force.size)
    none = own.readings.press < missed
    read[none] = 0.02 * np.abs(rng.standard_normal(none.sum()))
    travel[none] = np.tile(np.linspace(1e-4, 2e-3, LEVELS), missed)
    travel += noise.displacement_m * rng.standard_normal(force.size)
    return replace(own, displacement_m=travel, readings=replace(own.readings, force_n=read))


@pytest.mark.parametrize("missed", [0, 3])
def test_presses_that_met_nothing_do_not_end_the_search_for_the_law_of_the_others(missed):
    own = soft_tissue(missed)
    touch = own.begun(CATALOGUE["touch_threshold"], {})
    found = own.fit([own.begun(CATALOGUE["strain_stiffening"], {}), touch])
    assert found.values["strain_stiffening"]["b"] == pytest.approx(1.0, abs=0.15)
    assert found.values["touch_threshold"]["threshold_n"] == pytest.approx(0.015, abs=0.003)
    assert found.misfit < 0.5 * own.fit([touch]).misfit


def test_compliances_beside_an_effect_do_not_depend_on_where_they_start():
    # Six presses whose contact hardly grows stiffer, as an ill-shaped body has them
    own, growth = soft_tissue(3), np.full(PRESSES, -1.05)
    growth[3:9] = -0.4
    unit = np.where(growth > -1, 1.15 / 1.8, 1.0) * own.unit_compliance
    own = replace(own, growth=growth, unit_compliance=unit)
    values = {"strain_stiffening": {"b": 1.2}, "touch_threshold": {"threshold_n": 0.012}}
    parts = [own.part(CATALOGUE[name], start) for name, start in values.items()]
    u = np.concatenate([part.to_scaled() for part in parts])
    chain, misfits = own.chain([part.effect for part in parts]), []
    for far in (1.0, np.e):
        start = np.log(far * own.fit(()).compliance)
        _, judged, *_ = own._eliminate(chain, parts, u, values, start)
        felt = own.felt[own.readings.press]
        misfits.append(np.sum((judged.residual_m / judged.sigma_m)[felt] ** 2))
    assert misfits[1] == pytest.approx(misfits[0], rel=0.01)


def test_one_step_in_logarithms_finds_the_compliance_of_a_power_law():
    power, far = 1.7, np.array([-6.0, -0.3, 0.0, 2.0])  # ln C from the one sought
    # Over the derivative by ln C, which is the power times the modelled travel
    measured, modelled = np.exp(-power * far) / power, np.full(4, 1 / power)
    np.testing.assert_allclose(_in_logarithms(measured - modelled, measured), -far)
    beyond = _in_logarithms(np.array([-1.5, 0.5]), np.array([-0.5, 0.2]))  # one has no logarithm
    np.testing.assert_allclose(beyond, [-1.5, 0.5])


@pytest.mark.parametrize("also", [(), pytest.param(("free_stiffening",), marks=pytest.mark.slow)])
def test_a_law_that_differs_from_place_to_place_is_that_of_some_presses_alone(also):
    """Each place stiffens by its own b: one law takes most of the misfit, and is none of them.

    A curve of any shape follows the differences, and is no better a name.
    """
    own = soft_tissue(0)
    effects = [CATALOGUE[name] for name in ("strain_stiffening", "touch_threshold")]
    chain, r = own.chain(effects), own.readings
    b = np.exp(np.random.default_rng(3).normal(0.5, 0.8, PRESSES))
    modulus = 0.6 * (1 - NU**2) / (1.15 * 0.6 * BALL) / own.fit(()).compliance
    travel = np.concatenate([
        chain.predict(OperatingPoint(own.unit_compliance / modulus, modulus, r.force_n, {
            "strain_stiffening": {"b": float(b[j])}, "touch_threshold": {"threshold_n": 0.015},
        }))[r.press == j]
        for j in range(PRESSES)
    ])  # fmt: skip
    noise = Noise(3e-6, 5e-4)
    catalogue = [*effects, *(CATALOGUE[name] for name in also)]
    law = contact_law(replace(own, displacement_m=travel, noise=noise), catalogue)
    assert law.names == ()
    assert law.partial is not None
    assert set(law.partial.names) == {"strain_stiffening", "touch_threshold"}
    assert law.partial.noise_share < CONTACT_LAW.noise_share
    assert law.partial.misfit < 0.5 * law.plain.misfit


def _law(names, misfit, noise_share, unknowns):
    parts = [SimpleNamespace(effect=CATALOGUE[name]) for name in names]
    return SimpleNamespace(
        parts=parts, names=names, misfit=float(misfit), noise_share=noise_share, unknowns=unknowns,
        dof=900, felt=np.ones(60, bool), residual=np.zeros(1000),
    )  # fmt: skip


def _chosen(own):
    """Return the names of the best law, and of those that are refitted to all presses."""
    plain, fits = _law((), 7800, 0.0, 0), {n: _law(n, *numbers) for n, numbers in own.items()}
    found = _best(plain, fits, CONTACT_LAW)
    return tuple(p.effect.name for p in found.parts), _near(plain, fits, CONTACT_LAW)


@pytest.mark.parametrize(
    ("misfit", "noise_share", "best"),
    [(905, 0.95, "strain_stiffening"),  # 0.4 % of the excess behind, in nearly as many presses
     (990, 0.95, "free_stiffening"), (905, 0.85, "free_stiffening")],
)  # fmt: skip
def test_a_free_form_must_take_more_than_laws_are_right_to(misfit, noise_share, best):
    own = {
        ("strain_stiffening", "touch_threshold"): (misfit, noise_share, 2),
        ("free_stiffening", "touch_threshold"): (875, 0.98, 5),
        ("touch_threshold",): (1350, 0.78, 1),
    }
    assert _chosen(own)[0] == (best, "touch_threshold")


def test_an_end_that_is_physics_is_no_bound_of_the_search():
    """A filter may be all of a lag; a lag as long as may be sought was not found."""
    part = SimpleNamespace(
        effect=CATALOGUE["filtered_force"], parameters=CATALOGUE["filtered_force"].parameters
    )
    for lag_s, held in ((0.1, ()), (0.5, ("filtered_force.lag_s",))):
        values = {"filtered_force": {"lag_s": lag_s, "share": 1.0}}
        assert _at_bound([part], values) == held  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("misfit", "best"), [(1020, "time_lag"), (1040, "filtered_force")])
def test_a_simpler_form_that_leaves_structure_gives_way_to_one_that_leaves_noise(misfit, best):
    """Both lie within what laws are right to; noise of 900 degrees of freedom ends at 1027."""
    own = {("time_lag",): (misfit, 0.95, 1), ("filtered_force",): (990, 0.98, 2)}
    assert _chosen(own)[0] == (best,)


@pytest.mark.parametrize(
    ("misfit", "noise_share", "of_free", "best"),
    [(1600, 0.95, 1100, "spherical_tip"),  # 7 % of the excess behind, in nearly as many presses
     (1900, 0.95, 1100, "free_stiffening"), (1600, 0.9, 1100, "free_stiffening"),
     (1400, 0.95, 875, "free_stiffening")],  # that leaves noise, so that laws do not err
)  # fmt: skip
def test_a_textbook_law_of_another_cause_stands_before_a_free_form(
    misfit, noise_share, of_free, best
):
    own = {
        ("spherical_tip", "touch_threshold"): (misfit, noise_share, 2),
        ("free_stiffening", "touch_threshold"): (of_free, 0.98, 5),
        ("touch_threshold",): (2500, 0.78, 1),
    }
    found, refitted = _chosen(own)
    assert found[0] == best
    assert found in refitted


def test_the_range_of_a_touch_is_that_of_laws_that_explain_nearly_as_much(late_ball):
    """A law of the contact that loses a twentieth counts, one that loses a half does not."""
    _, law = late_ball
    (name,) = {"touch_threshold"} & set(law.names)
    found, excess = law.found, law.plain.misfit - law.plain.dof
    values = found.values | {name: {"threshold_n": 0.06}}
    stiffer = CATALOGUE["strain_stiffening"]
    more = (*found.parts, replace(found.parts[0], effect=stiffer))

    def beside(lost: float):
        fits = {"misfit": found.misfit + lost * excess}
        other = type("Fit", (), {"values": values, "parts": more, "names": (), **fits})
        return replace(law, fits={(*law.names, stiffer.name): other}).range_of(name)

    shift = 0.06 - found.values[name]["threshold_n"]
    assert beside(0.05)["threshold_n"] == pytest.approx((0.0, shift))
    assert beside(0.5)["threshold_n"] == (0.0, 0.0)


def test_noise_of_a_press_of_no_resistance_stays_noise_under_a_stiffening():
    """Its compliance is anything: the travel of a force below 0 may not grow with its square."""
    stiffening, radius = CATALOGUE["strain_stiffening"], 5e-3
    travel = np.linspace(-10, 2, 4001) * radius
    pressing = SimpleNamespace(radius_m=np.full(travel.shape, radius))
    found = stiffening.contact(None, pressing, None, travel, b=2.0)
    slope = np.diff(found) / np.diff(travel)
    assert slope[0] == pytest.approx(2.0)
    assert np.abs(np.diff(slope)).max() < 0.01  # without a kink, also at no travel
    assert found[travel > 0] == pytest.approx(
        radius / 2 * np.log1p(2 * travel[travel > 0] / radius)
    )
