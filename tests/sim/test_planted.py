"""The bench and what it hides: histories followed by hand, sizes as asked, noise as said."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, block_mesh
from fem.palpation.rigid_punch import shape_gain
from models.errors import InputError
from models.press_program import PressProgram, grid_program
from models.scan_file import read_scan
from sim.bench.amplitude_search import amplitude_for, size_of
from sim.bench.planted_scan import BETWEEN_SCANS_S, further_scan, planted_scan
from sim.bench.press import press, record
from sim.body.block_compliance import block_compliance
from sim.body.true_body import HiddenBody
from sim.body.true_map import Inclusion, TruthMap
from sim.planted.bench import Bench
from sim.planted.catalogue import HIDDEN, INSIDERS
from sim.planted.effect import HiddenEffect
from tests.fem.reference.hayes import sphere_on_layer
from tests.paths import LAB

COARSE = (5, 5, 3)
TWO_RADII = (0.004, 0.007)


@pytest.fixture(scope="module")
def bench():
    program = grid_program(per_side=3, radii_m=TWO_RADII, seed=4)
    # Every press at its own pace: what mixes presses up is then seen
    paces = 1 + 0.1 * np.arange(len(program))
    program = replace(program, ramp_s=program.ramp_s * paces, hold_s=program.hold_s * paces[::-1])
    return Bench(program, HiddenBody(), divisions=COARSE)


def values_of(bench, effect, amplitude=None):
    drawn = effect.draw(bench, np.random.default_rng(10))  # of a skin 2.4 mm thick
    return {**drawn, effect.amplitude: effect.typical if amplitude is None else amplitude}


def test_a_press_ramps_holds_and_unloads_at_its_own_pace(bench):
    force, time = press(bench).force_n, bench.within_s[:, bench.sampled]
    program, j = bench.program, 5
    ramp, hold = program.ramp_s[j], program.hold_s[j]
    assert_allclose(time[j, :8], ramp * np.arange(1, 9) / 8)
    assert_allclose(time[j, 8:16], ramp + hold * np.arange(1, 9) / 8)
    assert_allclose(time[j, 16:], ramp + hold + np.arange(1, 7) / 6)
    peak = program.force_n[j]
    expected = peak * np.concatenate([np.arange(1, 9) / 8, np.ones(8), np.arange(5, -1, -1) / 6])
    assert_allclose(force[j], expected, atol=1e-12 * peak)
    assert (np.diff(bench.time_s[:, bench.sampled].ravel()) > 0).all()


@pytest.mark.slow
def test_a_hidden_skin_is_felt_as_by_an_independent_solver():
    folder = LAB / "case_f"
    truth = json.loads((folder / "truth.json").read_text())
    body, chosen = truth["body"], slice(None, None, 5)
    (ball,) = body["inclusions"]
    centre = (ball["x_m"], ball["y_m"], ball["z_m"])
    inside = TruthMap(
        body["background_pa"], (Inclusion(ball["weight_pa"], centre, ball["radius_m"]),)
    )
    skin = body["skin_layer"]
    hidden = HiddenBody(
        truth=inside,
        skin_thickness_m=skin["thickness_m"],
        skin_factor=skin["modulus_factor"],
    )
    scan = read_scan(folder / "scan.csv")
    _, first = np.unique(scan.press, return_index=True)
    points = scan.point_m[first][chosen, :2]
    found = block_compliance(hidden, points, np.full(len(points), 0.005))
    error = found / np.array(truth["compliance_m_per_n"])[chosen] - 1
    assert np.sqrt(np.mean(error**2)) < 0.004
    assert abs(error).max() < 0.006


def test_without_effects_the_travel_is_compliance_times_force(bench):
    pressed = press(bench)
    expected = bench.compliance()[:, None] * pressed.force_n
    assert_allclose(pressed.displacement_m, expected, rtol=1e-14)


@pytest.mark.parametrize("effect", HIDDEN, ids=lambda effect: effect.name)
def test_an_effect_of_amplitude_zero_is_not_there(bench, effect):
    plain = press(bench)
    planted = press(bench, [(effect, values_of(bench, effect, 0.0))])
    # A skin of factor 1 still has cells of its own: the meshes then differ, not the body
    rtol = 0.02 if effect.name == "skin_layer" else 1e-12
    assert_allclose(planted.force_n, plain.force_n, atol=1e-15)
    assert_allclose(planted.displacement_m, plain.displacement_m, rtol=rtol, atol=1e-15)


CHEAP = [e for e in HIDDEN if e.body is HiddenEffect.body]


def test_a_truth_that_did_not_keep_the_largest_force_has_that_of_its_presses(bench):
    effect = HIDDEN["form_yielding_sensor"]
    values = values_of(bench, effect)
    old = {name: value for name, value in values.items() if name != "largest_n"}
    assert len(old) < len(values)
    assert_allclose(press(bench, [(effect, old)]).force_n, press(bench, [(effect, values)]).force_n)


@pytest.mark.parametrize("effect", CHEAP, ids=lambda effect: effect.name)
def test_further_and_harder_presses_change_nothing_that_was_read_before(bench, effect):
    program = bench.program
    harder = replace(program, force_n=2 * program.force_n)
    later = replace(bench, program=program.then(harder, BETWEEN_SCANS_S))
    planted = [(effect, values_of(bench, effect))]
    before, after = press(bench, planted), press(later, planted)
    for name in ("force_n", "displacement_m"):
        read = getattr(before, name)
        off = np.abs(getattr(after, name)[: len(program)] - read).max()
        assert off < 1e-6 * np.abs(read).max(), name


@pytest.mark.parametrize("effect", CHEAP, ids=lambda effect: effect.name)
@pytest.mark.parametrize("size", [0.01, 0.06])
def test_an_effect_gets_the_size_that_was_asked_for(bench, effect, size):
    drawn = effect.draw(bench, np.random.default_rng(8))
    planted, reached = amplitude_for(bench, effect, drawn, size)
    plain = press(bench, [(effect, {**drawn, effect.amplitude: 0.0})])
    assert size_of(press(bench, [planted]), plain) == pytest.approx(reached, rel=1e-9)
    # Rounding to whole steps cannot be tuned finely; a few presses cannot make up a large share
    loose = {"outside_coarse_encoder": 0.05}
    if effect.name == "rigid_tip" and planted[1]["share"] == 1:
        assert 0 < reached < size  # a tip cannot be held more upright than upright
        return
    assert reached == pytest.approx(size, rel=loose.get(effect.name, 0.011))


def test_creep_follows_the_closed_form_on_a_ramp_and_in_the_hold(bench):
    share, tau = 0.2, 0.7
    effect = HIDDEN["viscoelasticity"]
    values = {"share": share, "time_constant_s": tau}
    added = press(bench, [(effect, values)]).displacement_m - press(bench).displacement_m
    j, t = 2, bench.within_s[2, bench.sampled]
    ramp = bench.program.ramp_s[j]
    peak = bench.compliance()[j] * bench.program.force_n[j]

    def after(s):
        return np.where(s > 0, s - tau * (1 - np.exp(-np.maximum(s, 0) / tau)), 0) * peak / ramp

    held = t <= ramp + bench.program.hold_s[j] + 1e-9
    assert_allclose(added[j, held], share * (after(t) - after(t - ramp))[held], rtol=2e-6)


def test_a_late_force_channel_reads_what_was_a_delay_ago(bench):
    delay = 0.05
    planted = press(bench, [(HIDDEN["time_lag"], {"lag_s": delay})])
    ramp, peak = bench.program.ramp_s, bench.program.force_n
    expected = peak * (ramp - delay) / ramp  # at the end of the ramp
    assert_allclose(planted.force_n[:, 7], expected, rtol=1e-12)


@pytest.mark.parametrize("share", [0.35, 0.7, 0.9999])
def test_a_sphere_on_a_thick_soft_block_follows_sneddon(share):
    radius, modulus, nu = 0.004, 6000.0, 0.49
    exact = sphere_on_layer(share * radius, radius, modulus, nu)
    force = exact.force_n
    program = PressProgram(*(np.array([v]) for v in (0.15, 0.15, radius, force, 1, 2, 1, 0)))
    from sim.body.true_map import TruthMap
    from sim.planted.contact import sphere_travel

    body = HiddenBody((0.3, 0.3, 0.15), nu, TruthMap(modulus, ()))
    travel = sphere_travel(Bench(program, body, divisions=(8, 8, 4)))[0].max()
    # The block is a little stiffer than a half-space: about 1.3 a/h
    assert travel == pytest.approx(exact.travel_m, rel=0.03)


def test_an_upright_tip_is_stiffer_at_edges_and_flanks_as_the_quick_formula_has_it():
    body, radius = HiddenBody(), 0.010
    places = [(0.012, 0.048), (0.012, 0.012), (0.036, 0.046), (0.040, 0.058), (0.08, 0.03)]
    points = np.array(places)
    press = (body, points, np.full(len(points), radius))
    level, free = (
        block_compliance(*press, divisions=(10, 10, 5), upright=u) for u in (True, False)
    )
    lost = 1 - level / free
    contacts = Contacts(np.column_stack([points, np.full(5, 0.048)]), (0, 0, -1), radius)
    model = PalpationModel(block_mesh(body.size_m, (10, 10, 5)), body.poisson_ratio, contacts)
    response = model.evaluate(body.modulus(model.points_m))
    quick = shape_gain(response, body.modulus(contacts.points_m)) / response.compliance
    assert_allclose(lost, quick, rtol=0.06, atol=0.003)
    assert (lost[:3] > 0.05).all()
    assert (lost[3:] < 0.02).all()


def test_a_surface_is_high_where_it_is_said_to_be(bench):
    """Heights by hand, from each press's way from the middle and from the walls."""
    half = np.array(bench.body.size_m[:2]) / 2
    x, y = ((bench.points_m - half) / half.max()).T
    flat = np.zeros((len(x), 3))

    def added(name, **values):
        force, travel = HIDDEN[name].sensor(bench, flat, flat, {"height_m": 1e-4, **values})
        assert_allclose(force, 0)
        assert_allclose(travel, np.tile(travel[:, :1], 3))
        return travel[:, 0] / 1e-4

    assert_allclose(added("curved_surface", angle_rad=0.7, ratio=1.0), x**2 + y**2)
    assert_allclose(added("curved_surface", angle_rad=np.pi / 2, ratio=0.0), y**2, atol=1e-12)
    assert_allclose(added("uneven_surface", c_20=2.0, c_01=-1.0), 3 * x**2 - 1 - y)
    away = np.hypot(x - 0.2, y + 0.1) / 0.6
    assert_allclose(
        added("surface_bump", x=0.2, y=-0.1, radius=0.6),
        np.where(away < 1, np.cos(np.pi * away / 2) ** 2, 0),
        atol=1e-12,
    )
    assert_allclose(
        added("form_hill_of_the_surface", x=0.2, y=-0.1, width=0.5),
        np.exp(-2 * ((x - 0.2) ** 2 + (y + 0.1) ** 2)),
    )
    wave = added("form_wavy_surface", angle_rad=0.0, length=2.0, phase_rad=0.3)
    assert_allclose(wave, np.sin(np.pi * x + 0.3))
    rim = added("form_raised_rim", width=0.5)  # travel ends early where the body is higher
    assert_allclose(rim, -np.exp(-2 * (1 - np.maximum(abs(x), abs(y)))))


def test_the_same_seed_makes_the_same_scan_and_another_one_another(bench):
    pressed = press(bench)
    first, second, other = (record(bench, pressed, seed) for seed in (1, 1, 2))
    assert_allclose(first.force_n, second.force_n, rtol=0)
    assert not np.allclose(first.force_n, other.force_n, rtol=1e-6)
    noise = np.concatenate([r.displacement_m - pressed.displacement_m.ravel()
                            for r in (first, other)])  # fmt: skip
    assert noise.std() == pytest.approx(2e-5, rel=4 / np.sqrt(2 * len(noise)))


def test_a_planted_scan_says_what_is_in_it():
    scan, truth = planted_scan(
        ("viscoelasticity", "force_bias"),
        (0.05, 0.01),
        seed=3,
        radii=TWO_RADII,
        per_side=2,
        divisions=COARSE,
    )
    assert [e["name"] for e in truth["effects"]] == ["viscoelasticity", "force_bias"]
    assert [e["size"] for e in truth["effects"]] == pytest.approx([0.05, 0.01], rel=0.011)
    assert set(scan.contact_radii) == set(TWO_RADII) == set(truth["radii_m"])
    assert len(truth["compliance_m_per_n"]) == len(scan.press_ids) == 4


def test_an_unknown_effect_is_refused_with_the_nearest_name():
    with pytest.raises(InputError, match="did you mean 'force_drift'"):
        planted_scan("force_drifd", per_side=2, divisions=COARSE)


def test_all_effects_of_the_catalogue_can_be_planted():
    from identify.catalogue.catalogue import CATALOGUE

    # A threshold of first touch shows only under a ball: the laboratory's tips are flat
    assert set(INSIDERS) == {effect.name for effect in CATALOGUE} - {"touch_threshold"}


SHORT = PressProgram(
    x_m=[0.02, 0.05, 0.07], y_m=[0.04, 0.04, 0.06], radius_m=[0.005, 0.005, 0.005],
    force_n=[0.2, 0.3, 0.3], ramp_s=[0.5, 1.0, 1.0], hold_s=[1.0, 1.0, 1.5],
    unload_s=[0.5, 0.5, 1.0], pause_s=[0.3, 0.2, 0.6],
)  # fmt: skip
FURTHER = replace(SHORT, x_m=SHORT.y_m, radius_m=np.array([0.004, 0.005, 0.008]))


@pytest.mark.parametrize(
    "name",
    ["preconditioning", "force_drift", "sensitivity_drift", "displacement_drift", "breathing",
     "form_cooling", "skin_layer"],
)  # fmt: skip
def test_a_further_scan_is_the_second_half_of_one_long_scan(name):
    silent = (0.0, 0.0)
    _, answer = planted_scan(name, 0.05, 8, program=SHORT, noise=silent, divisions=COARSE)
    again, longer = further_scan(answer, FURTHER)
    long = SHORT.then(FURTHER, BETWEEN_SCANS_S)
    values = answer["effects"][0]["values"]
    whole, _ = planted_scan(
        name, 0.05, 8, program=long, noise=silent, values=values, divisions=COARSE
    )
    rest = whole.rows(whole.press >= 3)
    assert again.press_ids.tolist() == [3, 4, 5]
    assert_allclose(again.time_s, rest.time_s, rtol=1e-12)
    assert_allclose(again.force_n, rest.force_n, rtol=1e-12)
    assert_allclose(again.displacement_m, rest.displacement_m, rtol=1e-9)
    assert longer["effects"] == answer["effects"]
    assert len(longer["compliance_m_per_n"]) == len(longer["program"]["x_m"]) == 6


def test_further_scans_have_noise_of_their_own_and_go_on_from_each_other():
    first, answer = planted_scan(None, seed=8, program=SHORT, divisions=COARSE)
    second, after = further_scan(answer, SHORT)
    same, _ = further_scan(answer, SHORT)
    third, _ = further_scan(after, SHORT)
    assert (second.force_n == same.force_n).all()
    pairs = [(first, second), (first, third), (second, third)]
    for one, other in pairs:
        noise = one.force_n - other.force_n
        assert np.std(noise) == pytest.approx(np.sqrt(2) * 5e-3, rel=0.35)
    assert third.press_ids.tolist() == [6, 7, 8]
    assert third.time_s[0] > second.time_s[-1] + BETWEEN_SCANS_S


def test_a_further_press_beside_the_block_is_refused():
    _, answer = planted_scan(None, seed=8, program=SHORT, divisions=COARSE)
    beside = replace(SHORT, x_m=np.array([0.02, 0.093, 0.07]))
    with pytest.raises(InputError, match="Press 1 of the program: x is 93 mm; a tip of 5 mm needs"):
        further_scan(answer, beside)
    del answer["program"]
    with pytest.raises(InputError, match="made by an older palpmap"):
        further_scan(answer, SHORT)
