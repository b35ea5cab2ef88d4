"""The wrist sensor reports the contact alone; first touch is found without bias."""

import numpy as np
import pytest

from models.errors import InputError
from sim.robot.laboratory import build_laboratory
from sim.scan.first_touch import _creeping_start, depth_at_zero_force, first_touch
from sim.scan.touch_laws import Ball
from tests.long import long
from tests.sim.scripted_motion import TipPose, run_script

SLANT = (0.0, 0.287, -0.958)


@pytest.fixture(scope="module")
def tracking():
    axis = tuple(np.array(SLANT) / np.linalg.norm(SLANT))
    script = [
        TipPose((0.45, 0.1, 0.2), duration_s=0.8),
        TipPose((0.5, -0.1, 0.12), axis, 1.2),
        TipPose((0.4, 0.0, 0.3), duration_s=1.5),
    ]
    return script, run_script(script, build_laboratory())


def test_the_arm_tracks_a_scripted_motion(tracking):
    script, result = tracking
    assert result.largest_error_m < 5e-5
    ends = np.cumsum([round(pose.duration_s / 0.002) for pose in script]) - 1
    for pose, end in zip(script, ends, strict=True):
        assert np.linalg.norm(result.wanted_m[end] - pose.point_m) < 1e-7
        assert np.linalg.norm(result.tip_m[end] - pose.point_m) < 5e-5


def test_weight_and_inertia_of_the_probe_do_not_show_in_the_contact_force(tracking):
    assert tracking[1].largest_force_n < 1e-9


def test_a_script_that_is_too_fast_or_too_far_is_refused():
    laboratory = build_laboratory()
    with pytest.raises(InputError, match=r"Pose 0 .* needs .* s; its duration is 0.1 s"):
        run_script([TipPose((0.45, 0.3, 0.2), duration_s=0.1)], laboratory)
    with pytest.raises(InputError, match=r"Pose 0 .* is out of reach"):
        run_script([TipPose((1.45, 0.3, 0.2))], laboratory)


@pytest.mark.parametrize("stiffness", [60.0, 1000.0, 50_000.0])
def test_first_touch_is_found_without_bias_on_soft_and_hard_bodies(stiffness):
    rng = np.random.default_rng(3)
    force = np.tile(np.linspace(0.02, 0.25, 500), 2)
    found = []
    for _ in range(200):
        depth = 0.0012 + force / stiffness + 2e-5 * rng.standard_normal(force.size)
        measured = force + 5e-3 * rng.standard_normal(force.size)
        found.append(depth_at_zero_force(depth, measured, 2e-5, 5e-3) - 0.0012)
    spread = np.std(found)
    assert spread < 1.5e-5
    assert abs(np.mean(found)) < 4 * spread / np.sqrt(len(found))


STEP_S, SPEED = 0.002, 1.5e-3


def press(law, peak_n, rng, force_noise, depth_noise):
    """Readings of a press on a body with a law F(x): approach, dwell, load, hold, unload."""
    fine = np.linspace(0, 0.04, 100_001)
    forces = law(fine)
    touched = np.interp(0.025, forces, fine) + 2 * STEP_S * SPEED
    way = np.concatenate([np.arange(-5e-4, touched, SPEED * STEP_S), np.full(30, touched)])
    first = np.interp(touched, fine, forces)
    load = np.linspace(first, peak_n, 500)
    unload = np.linspace(peak_n, 0.06 * peak_n, 500)
    wanted = np.concatenate([np.zeros(len(way)), load, np.full(500, peak_n), unload])
    force = wanted.copy()
    force[: len(way)] = np.interp(way, fine, forces) * (way > 0)
    depth = np.concatenate([way, np.interp(force[len(way) :], forces, fine)])
    part = np.repeat([0, 1, 2, 3], [len(way), 500, 500, 500])
    depth = depth + depth_noise * rng.standard_normal(depth.size)
    force = force + force_noise * rng.standard_normal(force.size)
    return depth + 0.0012, force, wanted, part, STEP_S


COURSES = {
    "line": (lambda x: 60 * x, 0.25),
    "cubic": (lambda x: 60 * x + 1e7 * x**3, 0.25),
    "Fung": (lambda x: 0.2 * np.expm1(300 * x), 0.3),
    "ball": (lambda x: 954 * x**1.5, 0.3),
    "ball on a layer": (lambda x: 954 * x**1.5 * (1 + 2.46 * np.sqrt(x) + 6.4 * x), 0.3),
}


@pytest.mark.parametrize("course", list(COURSES))
def test_first_touch_is_right_for_any_law_where_a_straight_line_is_far_off(course):
    law, peak = COURSES[course]
    exact = press(law, peak, np.random.default_rng(0), 0.0, 0.0)
    assert abs(first_touch(*exact, 0.0, 0.0).depth_m - 0.0012) < 6e-6
    moving = np.isin(exact[3], (1, 3))
    straight = depth_at_zero_force(exact[0][moving], exact[1][moving], 0.0, 0.0) - 0.0012
    assert course == "line" or straight > 3e-4
    rng = np.random.default_rng(5)
    found = [first_touch(*press(law, peak, rng, 5e-3, 2e-5), 2e-5, 5e-3) for _ in range(8)]
    off = np.array([touch.depth_m for touch in found]) - 0.0012
    assert abs(off.mean()) < 0.02e-3
    assert off.std() < 0.05e-3
    stated = np.array([touch.sd_m for touch in found])
    assert 0.3 < np.sqrt(np.mean((off / stated) ** 2)) < 2


@pytest.mark.parametrize("steps", [15, *long(-15)])
def test_first_touch_is_right_where_the_channels_are_not_of_one_instant(steps):
    rng, found = np.random.default_rng(7), []
    for _ in range(12):
        depth, force, *rest = press(COURSES["cubic"][0], 0.25, rng, 5e-3, 2e-5)
        at = np.arange(len(force)) - steps
        found.append(first_touch(depth, force[at.clip(0, len(at) - 1)], *rest, 2e-5, 5e-3))
    off, stated = np.transpose(found) - [[0.0012], [0.0]]
    assert abs(off.mean()) < 8e-6  # 30 ms are 45 um at the speed of the approach
    assert 0.5 < np.sqrt(np.mean((off / stated) ** 2)) < 1.5


def test_a_tip_that_sinks_without_any_force_has_no_law_of_creep():
    part = np.repeat([1, 2, 3], 250)
    fallen, nothing = np.linspace(0, 0.02, 750), np.zeros(750)
    touch, holds = _creeping_start(fallen, nothing, part, STEP_S, 10, 2e-5, 5e-3)
    assert np.isfinite(touch).all()
    assert not holds


def test_touch_of_a_ball_is_no_later_on_a_thin_body_than_on_a_thick_one():
    rng, radius, thickness = np.random.default_rng(6), 0.008, 0.02

    def law(x):  # Dimitriadis et al. (2002): bonded, incompressible
        a = np.sqrt(radius * x) / thickness
        series = 1 + 1.133 * a + 1.283 * a**2 + 0.769 * a**3 + 0.0975 * a**4
        return 16 / 9 * 7000 * np.sqrt(radius) * x**1.5 * series

    readings = [press(law, 0.2, rng, 5e-3, 2e-5) for _ in range(16)]

    def off(ball):
        return np.array([first_touch(*one, 2e-5, 5e-3, ball) for one in readings]) - [0.0012, 0.0]

    known, thick = off(Ball(radius, thickness)), off(Ball(radius, 1.0))
    assert abs(known[:, 0].mean()) < 3 * known[:, 0].std() / 4
    assert (thick - known)[:, 0].mean() > 3e-6
    assert 0.6 < known[:, 0].std() / known[:, 1].mean() < 1.5
