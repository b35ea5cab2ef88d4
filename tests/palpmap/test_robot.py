"""A scripted robot: presses, paths and sweeps one after the other."""

import json

import numpy as np
import pytest

import palpmap as pm

SIZE = (0.08, 0.08, 0.04)
SHORT = pm.ScanSettings(ramp_s=0.4, hold_s=0.4, unload_s=0.4, pause_s=(0.1, 0.1))


def robot(**more):
    body = pm.Block(SIZE, poisson_ratio=0.45, origin_m=(0.1, 0.0, 0.0))
    return pm.Robot(body, map=pm.GaussianMap(8000.0), arm=SHORT, **more)


@pytest.fixture(scope="module")
def arm():
    return robot()


@pytest.mark.slow
def test_clock_and_posture_go_on_from_call_to_call(arm):
    first = arm.press([0.13, 0.03, 0.04], force_n=0.2)
    pm.assert_force_kept(first)
    assert first.made == 1
    went, posture = arm.time_s, arm.q
    assert went > 1.5
    second = arm.press([[0.15, 0.03, 0.04], [0.15, 0.035, 0.04]], force_n=[0.1, 0.2])
    assert second.scan.time_s[0] > went
    assert np.abs(second.series.q[0] - posture).max() < 0.01
    assert arm.scan.press_ids.tolist() == [0, 1, 2]
    np.testing.assert_allclose(arm.scan.contact_points[0], [0.13, 0.03, 0.04], atol=1e-9)


def test_a_press_off_the_body_or_out_of_reach_is_refused_by_its_number(arm):
    with pytest.raises(pm.InputError, match=r"point 0 .* off the body's surface"):
        arm.press([0.13, 0.03, 0.05])
    with pytest.raises(pm.InputError, match="there is no body at"):
        arm.surface([0.5, 0.5])
    tilted = [np.sin(0.7), 0.0, -np.cos(0.7)]
    with pytest.raises(pm.InputError, match=r"at \(130.0, 30.0, 40.0\) mm.* friction cone"):
        arm.press([0.13, 0.03, 0.04], tilted)


POINT = (0.13, 0.03, 0.04)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda arm: arm.press(POINT[:2]), "points_m: found (0.13, 0.03), expected 3 finite numb"),
        (lambda arm: arm.press([]), "points_m: found [], expected 3 finite numbers, or rows of 3"),
        (lambda arm: arm.press((0.13, np.nan, 0.04)), "points_m: found (0.13, nan, 0.04), expec"),
        (lambda arm: arm.press(POINT, force_n="soft"), "force_n: found 'soft', expected one numb"),
        (lambda arm: arm.press([POINT] * 2, force_n=[0.1] * 3), "or one number for each of the 2"),
        (lambda arm: arm.press([POINT] * 2, [[0, 0, -1]] * 3), "directions: found [[0, 0, -1], "),
        (lambda arm: arm.press(POINT, on_unreachable="go"), "found 'go', expected 'raise' or 's"),
        (lambda arm: arm.follow([POINT[:2]]), "points_m: found [(0.13, 0.03)], expected 3 finite"),
        (lambda arm: arm.follow([POINT] * 2, speed_m_per_s=-0.1), "speed_m_per_s: found -0.1, ex"),
        (lambda arm: arm.surface(POINT), "xy_m: found (0.13, 0.03, 0.04), expected 2 finite numb"),
        (lambda arm: pm.Robot(arm), "body: found <palpmap.robot.Robot"),
        (lambda arm: pm.Robot(map=8000.0), "map: found 8000.0, expected a GaussianMap"),
    ],
)
def test_what_the_robot_cannot_take_is_refused_in_a_sentence(ask, said, arm):
    with pytest.raises(pm.InputError) as caught:
        ask(arm)
    assert said in str(caught.value)


def test_a_path_through_the_air_is_clear_and_one_into_the_table_meets_it(arm):
    clear = arm.follow([[0.12, 0.04, 0.08], [0.16, 0.06, 0.08]], speed_m_per_s=0.1)
    pm.assert_path_clear(clear)
    np.testing.assert_allclose(clear.tip_m[-1], [0.16, 0.06, 0.08], atol=1e-3)
    above, below = [0.05, 0.04, 0.03], [0.05, 0.04, -0.01]
    met = arm.follow([[0.05, 0.04, 0.08], above, below], speed_m_per_s=0.05)
    assert met.events[-1].kind == "force"
    assert met.tip_m[:, 2].min() > -1e-3
    with pytest.raises(AssertionError, match="the tip meets something"):
        pm.assert_path_clear(met)
    target = np.array([2.0, 0.0, 0.1])
    with pytest.raises(pm.InputError, match="mm is out of reach") as refused:
        arm.follow([target])
    place = 1e-3 * np.array(json.loads(str(refused.value).partition("pose at ")[2].split(" mm")[0]))
    along = (place - met.tip_m[-1]) / (target - met.tip_m[-1])  # on the way there, in one frame
    np.testing.assert_allclose(along, along[0], atol=2e-3)


@pytest.mark.slow
def test_a_sweep_keeps_its_force_and_feels_the_map():
    arm = robot()
    path, normals = arm.surface(np.column_stack([np.linspace(0.12, 0.16, 5), np.full(5, 0.04)]))
    swept = arm.follow(path, normals, force_n=0.2, speed_m_per_s=0.02)
    pm.assert_force_kept(swept)
    sliding = swept.wanted_n > 0.199
    assert np.abs(swept.force_n[sliding][200:].mean() - 0.2) < 2e-3
    np.testing.assert_allclose(swept.tip_m[-1, :2], path[-1, :2], atol=3e-4)
    # C = (1 - nu^2)/(2 E a) on a half-space; the bonded layer is a fifth stiffer
    depth = 0.04 - swept.tip_m[-1, 2]
    assert 0.7 < depth / (0.2 * (1 - 0.45**2) / (2 * 8000 * 0.005)) < 1.0
    with pytest.raises(AssertionError, match="force is off"):
        pm.assert_force_kept(swept, tolerance=1e-9)


def test_a_scan_of_any_body_by_a_cover_and_tips():
    scan = pm.scan(
        pm.Block(SIZE, poisson_ratio=0.45), presses=3, tips="flat:3,ball:8",
        map=pm.GaussianMap(8000.0), arm=SHORT,
    )  # fmt: skip
    assert len(scan.press_ids) == 3
    assert sorted(set(scan.contact_radii.tolist())) == [0.003, 0.008]
