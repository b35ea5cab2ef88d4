"""The laws of the effects against closed forms, differential equations and inverse laws."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy import integrate
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from identify.body.state import BodyState
from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.play import play_offset
from identify.catalogue.viscoelasticity import lagging
from identify.effects.base import Pressing
from identify.effects.conformance.example_scan import trial
from identify.effects.conformance.worked_example import Inputs
from identify.effects.monotone import bent
from identify.effects.sphere import ball_travel, depth_over_hertz
from tests.fem.reference.hayes import layer_operator, sphere_on_layer

BOX = ((0.0, 0.0, 0.0), (0.096, 0.096, 0.048))


def readings(**given):
    return Inputs(given).readings()


def pressing(m, compliance=0.01, modulus=5000.0, radius=5e-3, nu=0.4, profile="flat"):
    return Pressing(np.full(m, compliance), np.full(m, modulus), np.full(m, radius), nu, profile)


# ---- response ----------------------------------------------------------------------------


def test_creep_solves_its_differential_equation_on_uneven_steps():
    time = np.array([0.2, 0.25, 0.6, 1.7, 1.9, 3.0])
    travel = np.array([0.4, 0.5, 1.2, 1.2, 0.7, 0.1]) * 1e-3
    own = readings(time_s=tuple(time), force_n=(0.2, 0.25, 0.3, 0.3, 0.2, 0.0))
    touch = own.touch_time_s[0]
    knots, values = np.append(touch, time), np.append(0.0, travel)

    def by_time(t, z):
        return (np.interp(t, knots, values) - z) / 0.7

    exact = [0.0]
    for start, end in pairwise(knots):
        step = solve_ivp(by_time, (start, end), [exact[-1]], rtol=1e-10, atol=1e-15)
        exact.append(step.y[0, -1])
    assert_allclose(lagging(own, travel, 0.7), exact[1:], rtol=1e-7)


def test_creep_forgets_between_presses_and_takes_rows_at_equal_times():
    own = readings(press=(0, 0, 1, 1), time_s=(1.0, 2.0, 3.0, 4.0), force_n=(0.1, 0.2, 0.1, 0.2))
    z = lagging(own, np.array([1.0, 2.0, 1.0, 2.0]), 0.5)
    assert_allclose(z[2:], z[:2], rtol=1e-12)
    twice = readings(time_s=(1.0, 2.0, 2.0), force_n=(0.1, 0.2, 0.2))
    z = lagging(twice, np.array([1.0, 2.0, 2.0]), 0.5)
    assert z[2] == z[1]


def test_a_loop_closes_at_both_ends_whatever_its_width():
    own = readings(
        phase=("load", "load", "hold", "unload", "unload"), force_n=(0.15, 0.3, 0.3, 0.3, 0.0)
    )
    travel = 0.01 * own.force_n
    looped = CATALOGUE["hysteresis"].response(own, own.force_n, travel, h=0.2)
    assert_allclose(looped, travel, rtol=1e-14)


def test_loops_of_presses_to_different_forces_close_at_their_own():
    own = readings(press=(0, 0, 1, 1), phase=("load", "unload") * 2, force_n=(0.3, 0.3, 0.1, 0.1))
    travel = 0.01 * own.force_n
    looped = CATALOGUE["hysteresis"].response(own, own.force_n, travel, h=0.2)
    assert_allclose(looped, travel, rtol=1e-14)


def test_a_play_is_its_recursion_and_noise_at_the_turn_does_not_shift_the_hold():
    steps = np.r_[np.linspace(0.1, 1, 10), np.ones(10), np.linspace(0.9, 0.0, 10)]
    phase = ("load",) * 10 + ("hold",) * 10 + ("unload",) * 10
    own = readings(force_n=tuple(0.3 * steps), phase=phase)
    rng = np.random.default_rng(0)
    noise = 0.02 * rng.standard_normal((200, 30))
    for width in (0.03, 0.15, 0.4):
        state, told = 0.0, []
        for u in steps:
            state = min(max(state, u - width), u + width)
            told.append(state)
        offset = play_offset(own, steps, width)
        assert_allclose(offset, np.array(told) - steps, atol=1e-15)
        read = np.mean([play_offset(own, steps + n, width) for n in noise], axis=0)
        assert_allclose(read[10:20], offset[10:20], atol=1e-3)


def test_several_plays_are_those_plays_with_their_shares():
    own = readings(force_n=(0.1, 0.3, 0.2, 0.0), phase=("load", "load", "unload", "unload"))
    travel, shares = np.array([1.0, 3.0, 2.0, 0.0]) * 1e-3, (0.1, 0.05, 0.2, 0.3)
    effect = CATALOGUE["several_plays"]
    names = [p.name for p in effect.parameters]
    whole = effect.response(own, own.force_n, travel, **dict(zip(names, shares, strict=True)))
    one = CATALOGUE["play"]
    widths = (0.02, 0.06, 0.15, 0.4)
    parts = [one.response(own, own.force_n, travel, share=s, width=w) - travel
             for s, w in zip(shares, widths, strict=True)]  # fmt: skip
    assert_allclose(whole, travel + sum(parts), rtol=1e-12)


def test_creep_is_proportional_to_the_travel_and_so_the_same_everywhere():
    own = trial()
    creep = CATALOGUE["viscoelasticity"]
    values = {"g": 0.2, "tau_s": 0.6}
    once = creep.response(own.readings, own.readings.force_n, own.travel_m, **values)
    thrice = creep.response(own.readings, own.readings.force_n, 3 * own.travel_m, **values)
    assert_allclose(thrice, 3 * once, rtol=1e-12)


def test_candidates_of_the_time_constant_span_the_scan():
    own = trial()
    grid = [c["tau_s"] for c in CATALOGUE["viscoelasticity"].grid(own.readings, own.state)]
    assert grid[0] <= own.readings.sampling_step_s
    assert grid[-1] >= 3 * own.readings.press_length_s


# ---- contact -----------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["flat", "hertz"])
@pytest.mark.parametrize("contact_radius", [2e-3, 5e-3])
def test_a_ball_on_a_half_space_is_sneddons_whatever_contact_the_model_assumed(
    profile, contact_radius
):
    ball, modulus, nu = 4e-3, 9000.0, 0.4
    exact = [sphere_on_layer(share * ball, ball, modulus, nu) for share in (0.3, 0.6, 0.95)]
    force = np.array([contact.force_n for contact in exact])
    own = readings(force_n=tuple(force), radius_m=ball)
    plane = modulus / (1 - nu**2)
    # Johnson 3.36 and 3.42a: rigid punch 1/(2 E* a); Hertz pressure, force over mean travel, 0.6
    share = 0.5 if profile == "flat" else 0.6
    compliance = share / (plane * contact_radius)
    given = pressing(3, compliance, modulus, contact_radius, nu, profile)
    travel = CATALOGUE["spherical_tip"].contact(own, given, force, compliance * force, share=1.0)
    expected = [contact.travel_m for contact in exact]
    assert_allclose(travel[-1], expected[-1], rtol=2e-5)  # the line through no force: s/F squared/6
    steeper = ((force / force[-1]) ** -2 * 1e-4 / 6)[:-1]
    assert (np.abs(travel[:-1] / expected[:-1] - 1) < 1.2 * steeper).all()


@pytest.mark.parametrize("bent_per_m", [0.0, 25.0, -40.0])
def test_a_ball_on_a_curved_half_space_is_sneddons(bent_per_m):
    ball, modulus, nu, fixed = 6e-3, 9000.0, 0.4, 4e-3
    plane = modulus / (1 - nu**2)
    a = ball * np.array([0.3, 0.6, 0.95])
    # Sneddon: travel g(a), force 2 E* int (g(a) - g); the curved surface adds c r^2/2 to the gap
    angle = np.arctanh(a / ball)
    travel = a * angle + bent_per_m * a**2
    force = plane * ((a**2 + ball**2) * angle - a * ball + 4 / 3 * bent_per_m * a**3)
    own = readings(force_n=tuple(force), radius_m=ball)
    given = pressing(3, 0.6 / (plane * fixed), modulus, fixed, nu, "hertz")
    given = replace(given, curvature_per_m=np.full(3, bent_per_m), growth=np.full(3, -1.0))
    found = ball_travel(own, given, force).travel_m
    steeper = (force / force[-1]) ** -2 * 1e-4 / 6  # the line through no force
    assert (np.abs(found / travel - 1) < 1.2 * steeper + 1e-9).all()


@pytest.mark.parametrize(("thickness", "most"), [(0.01, 5e-4), (0.004, 6e-3), (0.002, 0.014)])
def test_a_ball_on_a_layer_is_the_exact_contacts(thickness, most):
    ball, modulus, nu = 3.16e-3, 1e4, 0.45
    plane, fixed = modulus / (1 - nu**2), 0.6 * ball

    def compliance(a):  # of a Hertz pressure, a sum of flat ones
        s, weight, operator = layer_operator(a, thickness, nu)
        density = 1.5 * (a**2 - s**2) / a**3
        return float((weight * density) @ (operator @ density)) / plane

    wider, narrower = (compliance(fixed * np.exp(step)) for step in (1e-3, -1e-3))
    growth = np.log(wider / narrower) / 2e-3
    exact = [sphere_on_layer(share * ball, ball, modulus, nu, thickness) for share in (0.5, 0.8)]
    force = np.array([contact.force_n for contact in exact])
    own = readings(force_n=tuple(force), radius_m=ball)
    given = pressing(2, compliance(fixed), modulus, fixed, nu, "hertz")
    found = ball_travel(own, replace(given, growth=np.full(2, growth)), force).travel_m
    off = found / [contact.travel_m for contact in exact] - 1
    line = (force / force[-1]) ** -2 * 1e-4 / 6
    assert (np.abs(off + line) < most).all()
    without = ball_travel(own, given, force).travel_m
    assert abs(without[-1] / exact[-1].travel_m - 1) > 4 * most


def test_a_ball_beyond_its_equator_and_one_in_a_hollow_of_its_size_go_on():
    force = np.linspace(-0.01, 40.0, 3000)
    own = replace(readings(force_n=tuple(force), radius_m=3e-3), force_n=force)
    given = pressing(len(force), 0.02, 5000.0, 2e-3, 0.45, "hertz")
    given = replace(given, curvature_per_m=np.full(len(force), -1 / 3e-3))
    travel = ball_travel(own, given, force).travel_m
    assert (np.diff(travel) > 0).all()
    assert travel[force > 0].min() > 0


def test_a_ball_hardly_pressed_is_hertz_and_one_beyond_its_equator_goes_on():
    assert_allclose(depth_over_hertz(np.array([0.0, 1e-9, 1e-6])), 1, rtol=1e-5)
    loads = np.linspace(0.01, 20, 4000)
    depth = depth_over_hertz(loads) * (0.75 * loads) ** (2 / 3)
    slope = np.diff(depth) / np.diff(loads)
    assert (np.diff(slope) < 1e-9).all()
    assert slope[-1] == pytest.approx(0.5, rel=1e-6)


def test_a_ball_is_smooth_through_no_force():
    force = np.linspace(-0.01, 0.01, 201)
    own = replace(readings(force_n=tuple(force)), force_n=np.append(force[:-1], 0.3))
    ball = CATALOGUE["spherical_tip"]
    travel = ball.contact(own, pressing(201), force, 0.01 * force, share=1.0)
    assert_allclose(travel, -travel[::-1], atol=1e-15)
    slope = np.diff(travel) / np.diff(force)
    assert slope.min() > 0
    assert np.abs(np.diff(slope)).max() < 0.05 * slope.max()


def test_large_strain_and_stiffening_invert_their_laws_and_begin_alike():
    travel, a = np.linspace(0, 8e-3, 9), 5e-3
    own = readings(force_n=tuple(100 * travel))
    given = pressing(9, radius=a)
    strain, fung = CATALOGUE["finite_strain"], CATALOGUE["strain_stiffening"]
    d = strain.contact(own, given, own.force_n, travel, s=0.3)
    assert_allclose(d * (1 + 0.3 * d / a * (1 + d / a)), travel, rtol=1e-12)
    d = fung.contact(own, given, own.force_n, travel, b=0.6)
    assert_allclose(a / 0.6 * np.expm1(0.6 * d / a), travel, rtol=1e-12)
    slight = [
        effect.contact(own, given, own.force_n, 1e-3 * travel, **{name: size}) - 1e-3 * travel
        for effect, name, size in ((strain, "s", 0.1), (strain, "s", -0.1), (fung, "b", 0.2))
    ]
    assert_allclose(slight[0], slight[2], rtol=2e-3, atol=1e-15)
    assert_allclose(slight[0], -slight[1], rtol=2e-3, atol=1e-15)


# Travel over the linear one at these depths over a, neo-Hookean, nu = 0.49, a/h = 0.1, rigid flat
# tip; recomputed in `test_fem_finite_strain_geometry`
DEPTH, STICKING, SLIDING = (0.1, 0.2, 0.4), (1.0065, 1.0139, 1.0306), (1.0075, 1.0175, 1.0425)


@pytest.mark.parametrize(("s", "ratio"), [(-0.056, STICKING), (-0.074, SLIDING)])
def test_large_strain_has_the_form_that_finite_elements_gave(s, ratio):
    travel = 5e-3 * np.array(DEPTH)
    own = readings(force_n=tuple(100 * travel))
    given = pressing(3, radius=5e-3)
    d = CATALOGUE["finite_strain"].contact(own, given, own.force_n, travel, s=s)
    assert_allclose(d / travel, ratio, atol=1.2e-3)


@pytest.mark.parametrize(
    ("height", "modulus", "upper"),
    [(0.048, None, 0.0), (0.048, 6e3, 0.0), (0.012, 6e3, 2.0), (0.048, 2e3, 2.0)],
)
def test_large_strain_hardens_thin_bodies_and_deep_presses_only(height, modulus, upper):
    own = readings(force_n=(0.1, 0.3), radius_m=5e-3)  # 0.3 N: 4.2 mm in 6 kPa, 13 mm in 2 kPa
    state = BodyState(((0.0, 0.0, 0.0), (0.1, 0.1, height)), 0.4, background_pa=modulus)
    (s,) = CATALOGUE["finite_strain"].bounded(own, state)
    assert (s.lower, s.upper) == (-0.5, upper)
    hard = readings(press=(0, 1, 2), force_n=(0.3, 0.3, 9.0), radius_m=5e-3)  # one on a hard spot
    assert CATALOGUE["finite_strain"].bounded(hard, state) == (s,)


def test_a_force_bias_beyond_the_force_of_first_touch_is_doubted():
    """A body that is touched does not pull at the tip."""
    own = readings(press=(0, 0, 1, 1, 2, 2), force_n=(0.08, 0.5, 0.085, 0.6, 0.09, 0.4))
    bias = CATALOGUE["force_bias"]
    assert bias.doubt({"bias_n": 0.085}, own) is None
    assert bias.doubt({"bias_n": -0.2}, own) is None
    assert "begin at 85 mN" in (bias.doubt({"bias_n": 0.11}, own) or "")


@pytest.mark.parametrize(
    ("name", "parameter"), [("finite_strain", "s"), ("strain_stiffening", "b")]
)
def test_noise_at_no_force_stays_finite_at_the_bounds(name, parameter):
    effect = CATALOGUE[name]
    travel = np.array([-2e-3, -1e-5, 0.0, 1e-9, 1e-5, 0.02])
    for bound in (effect.parameters[0].lower, effect.parameters[0].upper):
        own = readings(force_n=tuple(travel * 50))
        out = effect.contact(own, pressing(6), own.force_n, travel, **{parameter: bound})
        assert np.all(np.isfinite(out))
        assert np.all(np.diff(out) > 0)


def test_stiffening_is_smooth_through_no_force():
    travel = np.linspace(-1e-4, 1e-4, 201)
    own = readings(force_n=tuple(100 * travel))
    out = CATALOGUE["strain_stiffening"].contact(own, pressing(201), own.force_n, travel, b=5.0)
    bend = np.diff(out, 2) / np.diff(travel)[0] ** 2  # -b / a at no force
    assert_allclose(bend[98:101], -5.0 / 5e-3, rtol=0.01)


def test_a_stiffening_of_even_rises_is_fungs_law():
    travel = np.linspace(0, 8e-3, 50)
    own = replace(readings(force_n=tuple(50 * travel)), deepest=1.6)
    b = 2.0
    rises = {f"rise_{k}": 1.6 * b * area for k, area in enumerate((1 / 6, 1 / 3, 1 / 3, 1 / 6), 1)}
    free = CATALOGUE["free_stiffening"].contact(own, pressing(50), own.force_n, travel, **rises)
    fung = CATALOGUE["strain_stiffening"].contact(own, pressing(50), own.force_n, travel, b=b)
    assert_allclose(free, fung, rtol=1e-5)


@given(
    rises=st.lists(st.floats(0, 10), min_size=4, max_size=4),
    stiffer=st.booleans(),
)
def test_a_rise_is_the_integral_of_its_hats_and_the_law_bends_one_way(rises, stiffer):
    hats = np.interp(np.linspace(0, 1, 30001), (0, 1 / 3, 2 / 3, 1),
                     np.array(rises) * (6, 3, 3, 6))  # fmt: skip
    fine = np.linspace(0, 1, 30001)
    rise = integrate.cumulative_trapezoid(hats, fine, initial=0)
    slope = 1 / (1 + rise) if stiffer else 1 + rise
    level = np.linspace(0, 1, 31)
    wanted = integrate.cumulative_trapezoid(slope, fine, initial=0)[::1000]
    found = bent(level, rises, stiffer)
    assert_allclose(found, wanted, rtol=2e-4, atol=1e-6)
    steps = np.diff(bent(np.linspace(-0.5, 1.5, 81), rises, stiffer))
    assert np.all(steps > 0)
    turns = np.diff(steps) * (-1 if stiffer else 1)
    assert np.all(turns > -1e-4 * steps.max())


# ---- instrument --------------------------------------------------------------------------


def fitted_loss(true, read):
    """Smallest rms error in N of the saturation's law within its bounds, loss chosen best."""
    own = readings(force_n=tuple(read))
    effect = CATALOGUE["force_saturation"]

    def error(log_sharpness):
        shape = {"sharpness": np.exp(log_sharpness)}
        unit = effect.force(own, own.force_n, loss=1.0, **shape) - own.force_n
        loss = max(unit @ (true - read) / (unit @ unit), 0.0)
        back = effect.force(own, own.force_n, loss=loss, **shape)
        return np.sqrt(np.mean((back - true) ** 2))

    sharpness = effect.parameters[1]
    bounds = np.log([sharpness.lower, sharpness.upper])
    return minimize_scalar(error, bounds=bounds, method="bounded").fun


def test_saturation_undoes_a_tanh_and_a_quadratic_loss():
    true = np.linspace(0.01, 0.3, 30)
    for read in (0.5 * np.tanh(true / 0.5), true * (1 - 0.4 * true)):
        assert np.sqrt(np.mean((read - true) ** 2)) > 10e-3
        assert fitted_loss(true, read) < 0.5e-3  # a tenth of a good sensor's noise


def test_saturation_undoes_clipping_where_few_readings_are_clipped():
    true = np.append(np.arange(1, 9) / 8 * 0.3, np.full(8, 0.3))
    read = np.minimum(true, 0.28)
    assert fitted_loss(true, read) < 1e-3


def slow_press(soft_s: float, channel):
    """Readings of one press through a force channel, and the true force at each.

    A ramp of 1 s, a hold of 2 s and the way back; the ramps begin and end within `soft_s`.
    """
    dense = np.arange(-1000, 4101) * 1e-3
    ends = [0, soft_s, 1 - soft_s, 1, 3, 3 + soft_s, 4 - soft_s, 4]
    rate = np.interp(dense, ends, [0, 1, 1, 0, 0, -1, -1, 0])
    if not soft_s:
        rate = 1.0 * (dense > 0) - (dense >= 1) - (dense >= 3) + (dense >= 4)
    course = 0.3 * np.cumsum(rate) * 1e-3 / (1 - soft_s)
    time = np.r_[np.arange(1, 9) / 8, 1 + np.arange(1, 9) / 4, 3 + np.arange(1, 7) / 6]
    own = readings(
        time_s=tuple(time), force_n=tuple(np.interp(time, dense, channel(dense, course))),
        phase=("load",) * 8 + ("hold",) * 8 + ("unload",) * 6,
    )  # fmt: skip
    return own, np.interp(time, dense, course)


@pytest.mark.parametrize("lag", [0.03, -0.03])
@pytest.mark.parametrize("soft_s", [0.0, 0.1])
def test_a_lag_is_undone_where_ramps_end_sharply_and_where_they_end_softly(soft_s, lag):
    own, true = slow_press(soft_s, lambda t, f: np.interp(t - lag, t, f))
    found = CATALOGUE["time_lag"].force(own, own.force_n, lag_s=lag)
    assert np.abs(own.force_n - true).max() > 0.008
    assert_allclose(found, true, atol=0.0025)


def low_pass(force_n, tau_s):
    kept = np.exp(-1e-3 / tau_s)
    return lfilter([1 - kept], [1, -kept], force_n)


@pytest.mark.parametrize(
    ("channel", "share"),
    [
        (lambda t, f: low_pass(f, 0.1), 1.0),
        (lambda t, f: low_pass(low_pass(f, 0.05), 0.05), 0.75),  # the second moments are equal
        (lambda t, f: np.convolve(f, np.full(201, 1 / 201))[: len(f)], 0.6),
    ],
    ids=["first order", "two stages", "mean"],
)
@pytest.mark.parametrize("soft_s", [0.0, 0.1])
def test_a_filter_is_undone_better_than_by_a_lag(channel, share, soft_s):
    own, true = slow_press(soft_s, channel)

    def error(name, lag_s, **values):
        found = CATALOGUE[name].force(own, own.force_n, lag_s=lag_s, **values)
        return np.sqrt(np.mean((found - true) ** 2))

    of_lag = min(error("time_lag", lag) for lag in np.linspace(0.08, 0.11, 31))
    of_filter = error("filtered_force", 0.1, share=share)
    assert np.sqrt(np.mean((own.force_n - true) ** 2)) > 0.02
    assert of_filter < 0.0015
    assert of_filter < 0.7 * of_lag


@pytest.mark.parametrize("name", ["preconditioning", "free_preconditioning"])
def test_softening_by_order_at_an_even_pace_may_be_a_sensor_s(name):
    own = trial().readings
    values = {"p": 0.1, "k0": 10.0, "rise_1": 0.02, "rise_2": 0.03, "rise_3": 0.01}
    rested = replace(own, time_s=own.timed_s + np.where(own.press > 8, 60.0, 0.0))
    said = [CATALOGUE[name].evidence(values, r) for r in (own, rested)]
    assert "Order and time are nearly one" in said[0]
    assert said[0].startswith(said[1])
    assert len(said[1]) < len(said[0])


def test_breathing_in_step_with_the_presses_is_no_candidate():
    own = trial().readings
    regular = 4.5 * own.press + (own.time_s - own.time_s[own.first][own.press])
    even = replace(own, time_s=regular)
    state = trial().state
    breathing = CATALOGUE["breathing"]
    frequency = np.array([c["frequency_hz"] for c in breathing.grid(even, state)])
    resolution = 1 / even.elapsed_s[-1]
    multiples = np.arange(1, 9) / 4.5
    assert np.abs(frequency[:, None] - multiples).min() > 0.5 * resolution
    assert np.abs(frequency - 0.25).min() < resolution
    # Pauses at random keep step with nothing.
    every = (2.0 - frequency.min()) / (resolution / 4)
    free = breathing.grid(own, state)
    assert len(frequency) < 0.92 * every
    assert len(free) > 0.95 * (2.0 - free[0]["frequency_hz"]) * 4 * own.elapsed_s[-1]


def test_breathing_counts_from_the_first_reading_so_that_clocks_do_not_matter():
    early, late = trial(start_s=0.0), trial(start_s=1.7e9)
    values = {"sine_m": 1e-4, "cosine_m": 5e-5, "frequency_hz": 0.3}
    breathing = CATALOGUE["breathing"]
    # times of 1.7e9 s are rounded to 2e-7 s
    assert_allclose(early.out(breathing, values), late.out(breathing, values), atol=1e-9)


# ---- body --------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(0.096, 0.096, 0.048), (0.4, 0.3, 0.02), (0.03, 0.03, 0.06)])
def test_candidate_inclusions_lie_in_the_body_below_the_presses(size):
    x, y = (np.linspace(0.2, 0.8, 5) * side for side in size[:2])
    points = [(a, b, size[2]) for a in x for b in y]
    own = readings(press=tuple(range(25)), point_m=tuple(points))
    state = BodyState(((0.0, 0.0, 0.0), size), 0.49)
    grid = CATALOGUE["extra_inclusion"].grid(own, state)
    assert 2 <= len(grid) <= 300
    for candidate in grid:
        assert x[0] <= candidate["x_m"] <= x[-1]
        assert y[0] <= candidate["y_m"] <= y[-1]
        assert 0 < candidate["z_m"] < size[2]


def test_a_base_is_sought_where_it_gives_way_as_the_body_held_sideways_does():
    state = BodyState(BOX, 0.25).changed(background_pa=5000.0)
    found = CATALOGUE["base_compliance"].levels(state)
    assert found[0] == pytest.approx(0.048 / 6000)  # held sideways, 1.2 times as stiff


def test_candidate_inclusions_stand_closer_than_their_radius():
    side = np.linspace(0.012, 0.084, 9)
    points = tuple((a, b, 0.048) for a in side for b in side)
    own = readings(press=tuple(range(81)), point_m=points)
    grid = CATALOGUE["extra_inclusion"].grid(own, BodyState(BOX, 0.49))
    for axis in ("x_m", "y_m"):
        places = np.unique([candidate[axis] for candidate in grid])
        assert np.diff(places).max() < grid[0]["radius_m"]
        assert_allclose([places[0], places[-1]], [0.012, 0.084])


def test_candidate_inclusions_follow_the_pressed_part_of_a_large_body():
    places = 0.1 + 0.01 * np.arange(-4, 5)
    points = tuple((a, b, 0.1) for a in places for b in places)
    own = readings(press=tuple(range(81)), point_m=points)
    effect, large = CATALOGUE["extra_inclusion"], ((0.0, 0.0, 0.0), (0.2, 0.2, 0.1))
    small = effect.grid(readings(), BodyState(BOX, 0.49))  # of a body 48 mm high
    grid = effect.grid(own, BodyState(large, 0.49))
    assert grid[0]["radius_m"] == pytest.approx(small[0]["radius_m"])
    depths = {round(0.1 - candidate["z_m"], 6) for candidate in grid}
    assert depths == {round(0.048 - candidate["z_m"], 6) for candidate in small}


def test_bounds_of_an_inclusion_follow_body_and_background():
    state = BodyState(BOX, 0.49, background_pa=8000.0)
    weight, x, _, z, _ = CATALOGUE["extra_inclusion"].bounded(readings(), state)
    assert (weight.lower, weight.typical) == (-7600.0, 8000.0)
    assert (x.lower, x.upper, z.upper) == (0.0, 0.096, 0.048)


@pytest.mark.parametrize(("nu", "room"), [(0.49, 0.0099), (0.3, 0.1999)])
def test_poissons_ratio_stays_within_what_the_finite_elements_take(nu, room):
    (change,) = CATALOGUE["poisson_ratio"].bounded(readings(), BodyState(BOX, nu))
    assert_allclose([change.lower, change.upper], [-nu, room], atol=1e-12)


def test_body_effects_add_up_and_leave_the_state_as_it_was():
    plain = BodyState(BOX, 0.49)
    state = plain
    for name, values in (
        ("extra_inclusion", {"weight_pa": 1e3, "x_m": 0, "y_m": 0, "z_m": 0, "radius_m": 0.01}),
        ("extra_inclusion", {"weight_pa": 2e3, "x_m": 0, "y_m": 0, "z_m": 0, "radius_m": 0.01}),
        ("stiffness_gradient", {"gradient": 0.5}),
        ("stiffness_gradient", {"gradient": 1.0}),
        ("base_compliance", {"normal_m_per_pa": 1e-7}),
    ):
        state = CATALOGUE[name].body(state, **values)
    corner = np.zeros((1, 3))
    assert_allclose(state.added_pa(corner), 3000.0)
    assert_allclose(state.factor(corner), 0.75 * 0.5)
    assert state.base_normal_m_per_pa == 1e-7
    assert plain == BodyState(BOX, 0.49)


# ---- readings ----------------------------------------------------------------------------


def test_the_peak_force_is_that_of_the_hold_and_else_the_largest():
    own = readings(
        press=(0, 0, 0, 1, 1), phase=("load", "hold", "hold", "load", "load"),
        force_n=(0.35, 0.29, 0.31, 0.1, 0.2),
    )  # fmt: skip
    assert_allclose(own.peak_force_n, [0.3, 0.3, 0.3, 0.2, 0.2])
    assert own.largest_force_n == pytest.approx(0.3)


def test_layers_hold_each_reading_once_and_in_order():
    own = readings(press=(0, 0, 0, 1, 2, 2))
    assert [rows.tolist() for rows in own.layers] == [[0, 3, 4], [1, 5], [2]]


def test_first_touch_is_where_the_ramp_starts():
    own = readings(
        press=(0, 0, 0, 1, 1, 1), time_s=(1.5, 2.0, 2.5, 9.0, 9.5, 10.0),
        force_n=(0.04, 0.12, 0.20, 0.3, 0.31, 0.32),
    )  # fmt: skip
    # The second press starts from 0.3 N: no earlier than a sampling step before.
    assert_allclose(own.touch_time_s, [1.25, 8.5])
