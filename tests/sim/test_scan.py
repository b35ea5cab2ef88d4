"""A third of the default scan: accuracy, noise, and what it hands over."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from models.errors import InputError
from models.scan_file import read_scan, write_scan
from sim.body.soft_body import SoftBody
from sim.body.true_map import TruthMap
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.laboratory import Placement, build_laboratory
from sim.scan.whole_scan import run_scan
from tests.sim.grids import grid_plan

SIZE = (0.096, 0.096, 0.048)
PRESSES = 27


def few(count, **fields):
    plan = grid_plan()
    return ScanPlan(plan.points_m[30 : 30 + count], plan.directions[30 : 30 + count], **fields)


def body_for(plan, divisions=(8, 8, 4)):
    arguments = (plan.tip_radius_m, plan.points_m, plan.directions)
    return SoftBody(SIZE, TruthMap(), 0.49, *arguments, divisions=divisions)


@pytest.fixture(scope="module")
def default():
    whole = grid_plan()
    plan = ScanPlan(whole.points_m[::3], whole.directions[::3])
    body = body_for(plan)
    frames = []
    return plan, body, run_scan(plan, body, on_frame=frames.append), frames


def truth(run, name):
    return np.concatenate([getattr(press, name) for press in run.presses])


def test_all_presses_reach_their_force_at_their_point(default):
    run = default[2]
    assert len(run.statistics) == PRESSES
    for press in run.statistics:
        assert abs(press.force_error) < 0.01
        assert press.overshoot < 0.05
        assert press.contact_error_m < 2e-4
        assert press.settle_s < 0.2


def test_settled_pairs_agree_with_the_finite_element_law_within_a_thousandth(default):
    _, body, run, _ = default
    assert max(press.coupling_error for press in run.statistics) < 1e-3
    assert min(press.fem_calls for press in run.statistics) > 20
    hold = run.scan.phase == "hold"
    compliance = np.array([body.displacement(j, 1.0) for j in range(PRESSES)])[run.scan.press]
    law = compliance * truth(run, "true_force_n")
    assert_allclose(truth(run, "true_displacement_m")[hold], law[hold], rtol=1e-3)


def test_depth_stays_below_a_tenth_of_the_height(default):
    assert truth(default[2], "true_displacement_m").max() < 0.1 * SIZE[2]


def test_the_columns_have_the_declared_noise(default):
    run = default[2]
    force = run.scan.force_n - truth(run, "true_force_n")
    travel = run.scan.displacement_m - truth(run, "true_displacement_m")
    rows = len(run.scan)
    assert force.std() == pytest.approx(5e-3, rel=4 / np.sqrt(2 * rows))
    assert abs(force.mean()) < 4 * 5e-3 / np.sqrt(rows)
    # a touch point that is off by 5 um a press adds 3 % to the spread
    assert travel.std() == pytest.approx(2e-5, rel=0.03 + 4 / np.sqrt(2 * rows))
    offsets = [press.touch_error_m for press in run.statistics]
    assert abs(travel.mean()) < 4 * np.hypot(
        2e-5 / np.sqrt(rows), np.std(offsets) / np.sqrt(PRESSES)
    )
    assert np.std(offsets) < 1e-5
    sideways = run.scan.force_vector_n[:, :2]
    assert_allclose(sideways.std(axis=0), 5e-3, rtol=4 / np.sqrt(2 * rows))


def test_noise_of_neighbouring_samples_is_independent(default):
    run = default[2]
    hold = run.scan.phase == "hold"
    for name, value in (("true_force_n", "force_n"), ("true_displacement_m", "displacement_m")):
        noise = (getattr(run.scan, value) - truth(run, name))[hold].reshape(PRESSES, -1)
        noise = noise - noise.mean(axis=1, keepdims=True)
        product = (noise[:, 1:] * noise[:, :-1]).mean() / noise.var()
        # taking the mean of 8 out correlates by -1/7; the spread of 287 products is about 0.06
        assert abs(product + 1 / 7) < 0.24


def test_the_scan_has_the_rows_of_the_press_profile(default):
    plan, _, run, _ = default
    scan = run.scan
    assert_allclose(scan.contact_points, plan.points_m)
    assert_allclose(scan.contact_radii, 0.005)
    phases = scan.phase.reshape(PRESSES, 22)
    assert (phases == ["load"] * 8 + ["hold"] * 8 + ["unload"] * 6).all()
    times = scan.time_s.reshape(PRESSES, 22)
    assert (np.diff(scan.time_s) > 0).all()
    assert_allclose(np.diff(times[:, :8]), 0.125, atol=0.002)
    assert_allclose(np.diff(times[:, 8:16]), 0.25, atol=0.002)
    assert np.ptp(np.diff(times[:, 0])) > 0.2  # pauses differ


def test_the_measured_tip_pose_says_what_the_displacement_says(default):
    _plan, _, run, _ = default
    scan = run.scan
    depth = np.einsum("mi,mi->m", scan.tip_pose[:, :3] - scan.point_m, scan.direction)
    zero = np.array([press.touch_error_m for press in run.statistics])[scan.press_index]
    assert_allclose(scan.displacement_m, depth - zero, atol=1e-12)
    assert_allclose(np.linalg.norm(scan.tip_pose[:, 3:], axis=1), 1, atol=1e-12)
    w, x, y, z = scan.tip_pose[:, 3:].T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    assert_allclose(axis, scan.direction, atol=1e-3)


def test_the_table_passes_the_checks_of_a_file(default, tmp_path):
    write_scan(default[2].scan, tmp_path / "scan.csv")
    read = read_scan(tmp_path / "scan.csv")
    assert_allclose(read.force_n, default[2].scan.force_n)


def test_the_arm_stays_within_its_torques(default):
    assert 0 < default[2].peak_torque < 1


def test_the_series_hold_every_step(default):
    series = default[2].series
    assert_allclose(np.diff(series.time_s), 0.002, atol=1e-9)
    touching = np.isfinite(series.displacement_m)
    assert touching.sum() == pytest.approx(PRESSES * 2000, rel=0.01)
    noise = (series.displacement_m - series.true_depth_m)[touching]
    assert noise.std() == pytest.approx(2e-5, rel=0.05)


def test_frames_come_at_their_rate_and_show_the_arm_and_the_force(default):
    plan, _, _run, frames = default
    times = np.array([frame.time_s for frame in frames])
    assert_allclose(np.diff(times), 0.04, atol=1e-9)
    held = [frame for frame in frames if frame.phase == "hold"]
    assert {frame.press for frame in held} == set(range(PRESSES))
    force = np.mean([frame.force_vector_n for frame in held], axis=0)
    assert_allclose(force, [0, 0, -0.25], atol=1e-3)
    for frame in held[::200]:
        assert frame.positions_m.shape == (len(build_laboratory().links), 3)
        assert_allclose(np.linalg.norm(frame.quaternions, axis=1), 1)
        point = plan.body_in_world.points_to_world(plan.points_m[frame.press])
        assert np.linalg.norm((frame.tip_m - point)[:2]) < 2e-4
        assert frame.displacement_m == pytest.approx(point[2] - frame.tip_m[2], abs=1e-9)


def test_the_same_seed_gives_the_same_scan_and_another_seed_another():
    plan = few(2)
    body = body_for(plan, (4, 4, 2))
    first, again, other = (run_scan(plan, body, ScanSettings(seed=seed)).scan for seed in (4, 4, 5))
    assert (first.force_n == again.force_n).all()
    assert (first.displacement_m == again.displacement_m).all()
    assert (first.time_s[22:] != other.time_s[22:]).any()
    assert (first.force_n != other.force_n).all()


def test_a_scan_that_is_broken_off_has_delivered_the_presses_it_finished():
    plan, delivered = few(4), []

    def stop_after_two(result):
        delivered.append(result)
        if len(delivered) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_scan(plan, body_for(plan, (4, 4, 2)), on_press=stop_after_two)
    assert [result.statistics.press for result in delivered] == [0, 1]
    assert all(len(result.scan) == 22 for result in delivered)


def test_a_tilted_and_moved_body_is_scanned_in_its_own_frame():
    tilt = np.radians(15) / 2
    place = Placement((0.43, -0.02, 0.08), (np.cos(tilt), 0.0, np.sin(tilt), 0.0))
    plan = few(2, body_in_world=place)
    body = body_for(plan, (4, 4, 2))
    run = run_scan(plan, body, ScanSettings(force_noise_n=0, displacement_noise_m=0))
    scan = run.scan
    assert_allclose(scan.force_vector_n, scan.force_n[:, None] * scan.direction, atol=1e-4)
    assert_allclose(scan.tip_pose[:, :2], scan.point_m[:, :2], atol=1e-4)
    law = [body.displacement(j, f) for j, f in zip(scan.press_index, scan.force_n, strict=True)]
    assert_allclose(scan.displacement_m, law, atol=3e-6)
    assert all(press.contact_error_m < 1e-6 for press in run.statistics)


def test_a_set_force_near_the_touch_force_is_refused():
    plan = few(1, force_n=0.04)
    with pytest.raises(InputError, match=r"touch force of 0.025 N is more than half"):
        run_scan(plan, body_for(plan, (4, 4, 2)))
