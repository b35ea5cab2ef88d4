"""The wrist sensor reports the contact alone; first touch is found without bias."""

import numpy as np
import pytest

from models.errors import InputError
from sim.robot.laboratory import build_laboratory
from sim.scan.press_log import depth_at_zero_force
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
