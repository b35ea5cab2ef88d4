"""Points, normals and lines on the surface of a body, and presses that cover it."""

import numpy as np
import pytest

from models.errors import InputError
from sim.motion.body_surface import BodySurface
from sim.motion.clearance import Clearance
from sim.motion.planner import plan_motion
from sim.motion.scan_plan import ScanPlan, program_plan
from sim.robot.laboratory import Placement, build_laboratory


def dome(radius=0.04, rings=12):
    """A half ball on its base, of flat triangles."""
    level = np.linspace(0, np.pi / 2, rings + 1)
    angle = 2 * np.pi * np.arange(4 * rings) / (4 * rings)
    points = [[0.0, 0.0, 1.0]]
    for polar in level[1:]:
        points += [
            [np.sin(polar) * np.cos(a), np.sin(polar) * np.sin(a), np.cos(polar)] for a in angle
        ]
    points.append([0.0, 0.0, 0.0])
    n, faces = len(angle), []
    for k in range(n):
        after = (k + 1) % n
        faces.append((0, 1 + k, 1 + after))
        for ring in range(rings - 1):
            a, b = 1 + ring * n, 1 + (ring + 1) * n
            faces += [(a + k, b + k, b + after), (a + k, b + after, a + after)]
        last = 1 + (rings - 1) * n
        faces.append((len(points) - 1, last + after, last + k))
    points = radius * np.array(points)
    points[np.abs(points[:, 2]) < 1e-12, 2] = 0.0
    return BodySurface(points, np.array(faces))


def test_a_cover_is_even_stands_on_the_surface_and_presses_along_the_normals():
    body = dome()
    footing = body.cover(25, 0.004)
    assert footing.borne.all()
    radius = np.linalg.norm(footing.points_m, axis=1)
    np.testing.assert_allclose(radius, 0.04, rtol=0.01)
    outwards = footing.points_m / radius[:, None]
    assert np.einsum("ji,ji->j", outwards, footing.normals).min() > np.cos(np.radians(3))
    assert footing.normals[:, 2].min() > 0.49
    apart = np.linalg.norm(footing.points_m[:, None] - footing.points_m, axis=2)
    nearest = np.where(apart > 0, apart, np.inf).min(axis=1)
    # half of the ball to 60 degrees is a cap of 2 pi r^2 (1 - cos 60) = pi r^2
    even = np.sqrt(2 / np.sqrt(3) * np.pi * 0.04**2 / 25)
    assert 0.6 * even < nearest.min() < nearest.max() < 1.3 * even
    steps = np.linalg.norm(np.diff(footing.points_m, axis=0), axis=1)
    assert np.median(steps) < 1.5 * even


def test_a_tip_at_an_edge_is_not_borne_and_a_cover_without_room_is_refused():
    block = BodySurface.block((0.02, 0.02, 0.01))
    points = np.array([[0.01, 0.01, 0.01], [0.018, 0.01, 0.01]])
    footing = block.footing(points, 0.005)
    assert footing.borne.tolist() == [True, False]
    with pytest.raises(InputError, match="no room for 200 presses"):
        block.cover(200, 0.009)


def test_lines_tops_and_insides_are_those_of_the_shape():
    body = dome()
    point = np.array([0.0, 0.04 * np.sin(0.5), 0.04 * np.cos(0.5)])
    through = body.thickness_m(body.closest(point[None])[0][0], -point / 0.04)
    assert through == pytest.approx(0.04, rel=0.01)
    top = body.top(np.array([[0.01, 0.02], [0.05, 0.0]]))
    assert top[0, 2] == pytest.approx(np.sqrt(0.04**2 - 0.0005), rel=0.01)
    assert np.isnan(top[1, 2])
    assert body.contains(np.array([[0.0, 0.0, 0.03], [0.03, 0.03, 0.02]])).tolist() == [True, False]


def program_of(**columns):
    from models.press_program import PressProgram

    one = np.ones(1)
    return PressProgram(
        **{
            "x_m": 0.02 * one, "y_m": 0 * one, "radius_m": 0.004 * one, "force_n": 0.2 * one,
            "ramp_s": one, "hold_s": one, "unload_s": one, "pause_s": one, **columns,
        }
    )  # fmt: skip


def test_a_program_leaves_height_and_direction_to_the_surface_or_states_them():
    body = dome()
    plan = program_plan(program_of(), body)
    np.testing.assert_allclose(plan.points_m[0], [0.02, 0, 0.03464], atol=4e-4)
    np.testing.assert_allclose(plan.directions[0], [-0.5, 0, -0.866], atol=0.03)
    down = {"nx": np.zeros(1), "ny": np.zeros(1), "nz": -np.ones(1)}
    plan = program_plan(program_of(z_m=np.array([0.0345]), **down), body)
    np.testing.assert_allclose(plan.directions[0], [0, 0, -1])
    with pytest.raises(InputError, match=r"mm off the body's surface, expected at most 1 mm"):
        program_plan(program_of(z_m=np.array([0.05])), body)
    with pytest.raises(InputError, match="give a unit vector into the body"):
        program_of(nx=np.zeros(1), ny=np.zeros(1), nz=np.full(1, -2.0))


def test_a_push_out_of_the_friction_cone_is_refused_and_the_others_are_planned():
    body = dome()
    place = Placement((0.45, 0.0, 0.0))
    points = body.top(np.array([[0.018, 0.0], [0.0, 0.01], [0.025, 0.0]]))
    directions = np.tile([0.0, 0.0, -1.0], (3, 1))
    directions[1] = -body.footing(points[1:2], 0.004).normals[0]
    plan = ScanPlan(points, directions, tip_radius_m=0.004, surface=body, body_in_world=place)
    motion = plan_motion(plan, build_laboratory(0.004))
    assert len(motion.presses) == 2
    assert [refusal.press for refusal in motion.refused] == [2]
    assert "leaves the friction cone: it is 3" in str(motion.refused[0])
    assert plan.only(np.array([0, 1])).ids.tolist() == [0, 1]
    with pytest.raises(InputError, match="Press 2 at"):
        motion.require_all()


def test_distances_are_those_to_the_true_shape_and_to_the_arm_itself():
    laboratory = build_laboratory()
    low = Clearance(laboratory, dome(0.02), Placement((0.45, 0.0, 0.0)))
    tip = np.array([0.0, 0.25, 0.0, -2.35, 0.0, 2.6, 0.785])
    distance, part, obstacle = low.nearest(tip, within_m=0.3)
    from sim.robot.inverse_kinematics import TipKinematics

    position = TipKinematics(laboratory.arm).pose(tip)[0]
    assert (part, obstacle) == ("probe_tip", "soft_body")
    # to the nearest rim of the tip's face, not to a box around the dome
    direct = np.linalg.norm(position - [0.45, 0, 0]) - 0.02
    assert direct - 0.0055 < distance < direct
    folded = laboratory.home.copy()
    folded[3], folded[5] = -3.05, 0.0
    assert low.nearest(folded)[0] < 0.002
    assert "link" in low.nearest(folded)[2]
