"""Where a scan stands on the study's body, and which presses are refused."""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from fem.errors import MeshError
from models.errors import InputError
from models.scan import Scan
from palpmap.study.placement import place_scan
from palpmap.study.study import About, Body, Probe, Study

TIP = 0.005
SIZE = (0.10, 0.08, 0.04)


def study(**body) -> Study:
    given = {"shape": "block", "size_m": SIZE, "poisson_ratio": 0.4} | body
    return Study(
        study=About(name="test", scan=Path("scan.csv")),
        body=Body(**given),
        probe=Probe(tip="flat", radius_m=TIP),
    )


def scan_at(points, directions=(0.0, 0.0, -1.0), radius=TIP) -> Scan:
    """Two samples a press, at the given points."""
    points = np.repeat(np.atleast_2d(points), 2, axis=0)
    m = len(points)
    directions = np.broadcast_to(np.atleast_2d(directions), (m // 2, 3))
    return Scan(
        press=np.repeat(np.arange(m // 2), 2),
        time_s=np.arange(m),
        phase=["load"] * m,
        point_m=points,
        direction=np.repeat(directions, 2, axis=0),
        force_n=np.ones(m),
        displacement_m=np.full(m, 1e-3),
        probe_radius_m=np.full(m, radius),
        tip_pose=np.column_stack([points, np.tile([1.0, 0, 0, 0], (m, 1))]),
    )


def test_a_scan_is_moved_into_the_frame_of_the_body():
    placed = place_scan(scan_at([-0.46, 0.23, 0.14]), study(origin_m=(-0.5, 0.2, 0.1)))
    np.testing.assert_allclose(placed.scan.contact_points, [[0.04, 0.03, 0.04]], atol=1e-15)
    np.testing.assert_allclose(placed.scan.tip_pose[0, :3], [0.04, 0.03, 0.04], atol=1e-15)
    np.testing.assert_allclose(
        placed.scan.contact_points + placed.origin_m, [[-0.46, 0.23, 0.14]], atol=1e-15
    )
    assert not placed.projected


def test_a_block_may_stand_in_for_a_curved_body():
    tilt = np.radians([20.0, 30.0])
    directions = np.column_stack([np.sin(tilt), [0, 0], -np.cos(tilt)])
    scan = scan_at([[0.04, 0.03, 0.044], [0.06, 0.03, 0.033]], directions)
    placed = place_scan(scan, study(project_points=True))
    np.testing.assert_array_equal(placed.scan.contact_points[:, 2], 0.04)
    np.testing.assert_array_equal(placed.scan.contact_points[:, :2], scan.contact_points[:, :2])
    np.testing.assert_array_equal(placed.scan.contact_directions, [[0, 0, -1]] * 2)
    np.testing.assert_allclose(placed.distance_m, [0.004, 0.007], rtol=1e-9)
    np.testing.assert_allclose(placed.angle_deg, [20, 30], rtol=1e-9)
    assert placed.projected
    assert placed.onto_another_shape  # 7 mm, and the tip has 5


def test_presses_that_are_moved_by_less_than_the_tip_stay_on_their_shape():
    scan = scan_at([[0.04, 0.03, 0.044], [0.06, 0.03, 0.037]], [[0, 0, -1.0]] * 2)
    assert not place_scan(scan, study(project_points=True)).onto_another_shape


@pytest.mark.parametrize(
    ("point", "direction", "sentence"),
    [
        ([0.05, 0.04, 0.042], [0, 0, -1], r"row 3 \(press 1\), column z_m: .*2 mm off the body's"),
        ([0.05, 0.04, 0.038], [0, 0, -1], r"column z_m: .*project_points = true"),
        ([0.003, 0.04, 0.04], [0, 0, -1], r"column x_m: found 0.003 m, expected 0.005 to 0.095 m"),
        ([0.05, 0.077, 0.04], [0, 0, -1], r"column y_m: found 0.077 m, expected 0.005 to 0.075 m"),
        ([0.05, 0.04, 0.04], [0, 0, 1], r"180.0 degrees .*out of the body, .*change the sign"),
        ([0.05, 0.04, 0.04], [0.96, 0, -0.28], r"73.7 degrees from .*expected less than 60"),
    ],
)
def test_a_press_off_a_block_is_refused(point, direction, sentence):
    scan = scan_at([[0.05, 0.04, 0.04], point], [[0, 0, -1], direction])
    with pytest.raises(InputError, match=r"scan.csv, row 3 \(press 1\), column .*") as caught:
        place_scan(scan, study())
    assert caught.match(sentence)


def test_the_place_of_a_refused_press_is_said_in_the_frame_of_the_scan():
    with pytest.raises(InputError, match=r"found -0.499 m, expected -0.495 to -0.405 m"):
        place_scan(scan_at([-0.499, 0.03, 0.04]), study(origin_m=(-0.5, 0, 0)))


def test_a_tip_of_another_size_than_the_study_says_is_refused():
    with pytest.raises(InputError, match=r"probe_radius_m: found 0.003 m, expected 0.005 m"):
        place_scan(scan_at([0.05, 0.04, 0.04], radius=0.003), study())


def ball(tmp_path, radius=0.04) -> Study:
    """A ball with its middle at the origin, from a file."""
    file = tmp_path / "ball.stl"
    pyvista.Icosphere(radius=radius, nsub=4).save(file)
    return study(shape="surface", size_m=None, file=file)


def test_presses_on_a_surface_from_a_file_are_placed(tmp_path):
    outward = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.8, -0.6]])
    placed = place_scan(scan_at(0.04 * outward, -outward), ball(tmp_path))
    assert placed.distance_m.max() < 1e-4
    assert placed.angle_deg.max() < 5


@pytest.mark.parametrize(
    ("height", "direction", "sentence"),
    [
        (0.043, -1, r"row 1 \(press 0\), column x_m, y_m, z_m: .* off the body's surface"),
        (0.037, -1, r"off the body's surface .*check body.file"),
        (0.04, 1, r"out of the body"),
    ],
)
def test_a_press_off_a_surface_is_refused(height, direction, sentence, tmp_path):
    with pytest.raises(InputError, match=sentence):
        place_scan(scan_at([0, 0, height], [0, 0, direction]), ball(tmp_path))


def test_a_surface_file_in_millimetres_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"ball.stl: .*millimet"):
        place_scan(scan_at([0, 0, 0.04]), ball(tmp_path, radius=40.0))
