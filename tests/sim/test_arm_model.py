"""The arm's two models say the same, and what the published tables say."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from pathlib import Path

import mujoco
import numba
import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from models.arm import ARMS, mesh_folder, read_arm
from models.errors import InputError
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.laboratory import build_laboratory
from sim.robot.pinocchio_model import pinocchio_model
from sim.robot.rigid_chain import inverse_dynamics, rigid_chain, tip_poses, tool_force
from sim.scan.whole_scan import run_scan
from tests.sim.grids import grid_plan
from tests.sim.springs import Spring

TOLERANCE = 1e-9
PROBE_LENGTH_M = 0.145
DENAVIT_HARTENBERG = np.array(
    [
        # a (m), d (m), alpha (rad)
        [0.0, 0.333, 0.0],
        [0.0, 0.0, -np.pi / 2],
        [0.0, 0.316, np.pi / 2],
        [0.0825, 0.0, np.pi / 2],
        [-0.0825, 0.384, -np.pi / 2],
        [0.0, 0.0, np.pi / 2],
        [0.088, 0.0, np.pi / 2],
        [0.0, 0.107, 0.0],
    ]
)
"""Of the Panda in Craig's convention, seven joints and the flange; source: Franka Control Interface
documentation, "Denavit-Hartenberg parameters" of the Franka Emika Robot (Panda)."""

OTHERS = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            mesh_folder("example-robot-data") is None,
            reason='the package example-robot-data is not installed: pip install "palpmap[arms]"',
        ),
    )
    for name in ("ur5", "xarm7")
]


@numba.njit
def probe_force(chain, q, v, a):
    inverse_dynamics(chain, q, v, np.zeros_like(a), np.zeros_like(a))
    return tool_force(chain, v, a)


@pytest.fixture(scope="module")
def laboratory():
    return build_laboratory()


@pytest.fixture(scope="module")
def configurations(laboratory):
    rng = np.random.default_rng(7)
    arm = laboratory.arm
    q = rng.uniform(arm.lowerPositionLimit, arm.upperPositionLimit, (100, 7))
    return [(angles, rng.normal(size=7)) for angles in q]


def sliding_arm():
    """Pinocchio model of four joints with skew axes, one of which slides; the last has the tip."""
    model, rng = pin.Model(), np.random.default_rng(3)
    for j in range(4):
        axis = rng.normal(size=3)
        kind = pin.JointModelPrismaticUnaligned if j == 1 else pin.JointModelRevoluteUnaligned
        model.addJoint(j, kind(axis / np.linalg.norm(axis)), pin.SE3.Random(), f"j{j}")
        model.appendBodyToJoint(j + 1, pin.Inertia.Random(), pin.SE3.Random())
    model.addFrame(pin.Frame("tcp", 4, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME), False)
    model.armature = rng.uniform(size=4)
    return model


@pytest.mark.parametrize("slides", [False, True])
def test_the_compiled_dynamics_are_pinocchios(laboratory, slides):
    arm, tool = (sliding_arm(),) * 2 if slides else (laboratory.arm, laboratory.tool)
    chain, data, rng = rigid_chain(arm, tool), arm.createData(), np.random.default_rng(5)
    own = tool.createData()
    torque, place, turn = np.zeros(arm.nv), np.zeros((1, 3)), np.zeros((1, 3, 3))
    for _ in range(20):
        q, v, a = rng.normal(size=(3, arm.nv))
        inverse_dynamics(chain, q, v, a, torque)
        assert_allclose(torque, pin.rnea(arm, data, q, v, a), atol=1e-12)
        tip_poses(chain, q[None], place, turn)
        pin.framesForwardKinematics(arm, data, q)
        tip = data.oMf[arm.getFrameId("tcp")]
        assert_allclose(place[0], tip.translation, atol=1e-13)
        assert_allclose(turn[0], tip.rotation, atol=1e-13)
        pin.rnea(tool, own, q, v, a)
        assert_allclose(probe_force(chain, q, v, a), own.f[arm.nv].linear, atol=1e-12)


def test_machine_code_of_the_loop_is_renewed_when_any_of_its_files_changes():
    kept = inverse_dynamics._cache._cache_file._source_stamp
    assert {Path(file).stem for file, _, _ in kept} >= {"control_loop", "look", "rigid_chain"}


def test_the_model_without_shapes_is_the_same_arm(laboratory):
    whole, bare = laboratory.model, laboratory.physics
    assert bare.ngeom == 3 < whole.ngeom
    for name in ("body_mass", "body_inertia", "body_ipos", "dof_invweight0", "body_subtreemass"):
        assert_allclose(getattr(bare, name), getattr(whole, name), rtol=1e-12)


def test_sites_and_links_of_both_models_stand_at_the_same_place(laboratory, configurations):
    model, arm = laboratory.model, laboratory.arm
    data, other = mujoco.MjData(model), arm.createData()
    for q, _ in configurations:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        pin.framesForwardKinematics(arm, other, q)
        for name in ("tcp", "ft", "flange"):
            frame = other.oMf[arm.getFrameId(name)]
            assert_allclose(frame.translation, data.site(name).xpos, atol=TOLERANCE)
            assert_allclose(frame.rotation.ravel(), data.site(name).xmat, atol=TOLERANCE)
        for name in laboratory.links:
            frame = other.oMf[arm.getFrameId(name)]
            assert_allclose(frame.translation, data.body(name).xpos, atol=TOLERANCE)


def test_tip_jacobians_agree(laboratory, configurations):
    model, arm = laboratory.model, laboratory.arm
    data, other = mujoco.MjData(model), arm.createData()
    linear, angular = np.zeros((3, 7)), np.zeros((3, 7))
    for q, _ in configurations:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, linear, angular, model.site("tcp").id)
        jacobian = pin.computeFrameJacobian(
            arm, other, q, arm.getFrameId("tcp"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        assert_allclose(jacobian, np.vstack([linear, angular]), atol=TOLERANCE)


def test_mass_matrices_and_bias_torques_agree(laboratory, configurations):
    model, arm = laboratory.model, laboratory.arm
    data, other = mujoco.MjData(model), arm.createData()
    mass = np.zeros((7, 7))
    for q, v in configurations:
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        assert_allclose(np.triu(pin.crba(arm, other, q)), np.triu(mass), atol=TOLERANCE)
        assert_allclose(pin.nle(arm, other, q, v), data.qfrc_bias, atol=TOLERANCE)
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)
        gravity = pin.computeGeneralizedGravity(arm, other, q)
        assert_allclose(gravity, data.qfrc_bias, atol=TOLERANCE)


def test_limits_are_those_of_the_data_sheet(laboratory):
    arm, model = laboratory.arm, laboratory.model
    assert arm.effortLimit.tolist() == [87] * 4 + [12] * 3
    assert laboratory.speed_limit.tolist() == [2.175] * 4 + [2.61] * 3
    assert laboratory.acceleration_limit.tolist() == [15, 7.5, 10, 12.5, 15, 20, 20]
    assert_allclose(arm.lowerPositionLimit, model.jnt_range[:, 0], rtol=0, atol=0)
    assert_allclose(arm.upperPositionLimit, model.jnt_range[:, 1], rtol=0, atol=0)
    assert (model.jnt_range[3] == [-3.0718, -0.0698]).all()


def test_tip_follows_the_published_denavit_hartenberg_table(laboratory, configurations):
    data = mujoco.MjData(laboratory.model)
    for q, _ in configurations[:20]:
        pose = np.eye(4)
        for (a, d, alpha), angle in zip(DENAVIT_HARTENBERG, [*q, 0.0], strict=True):
            ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(angle), np.sin(angle)
            pose = pose @ [
                [ct, -st, 0, a],
                [st * ca, ct * ca, -sa, -d * sa],
                [st * sa, ct * sa, ca, d * ca],
                [0, 0, 0, 1],
            ]
        data.qpos[:] = q
        mujoco.mj_kinematics(laboratory.model, data)
        tip = pose[:3, 3] + PROBE_LENGTH_M * pose[:3, 2]
        assert_allclose(data.site("tcp").xpos, tip, atol=TOLERANCE)


def test_a_base_with_an_offset_and_a_nested_site_are_carried_over():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <body name="base" pos="0.1 -0.2 0.3" euler="10 20 30">
          <body name="turn" pos="0 0 0.1"><joint name="a" axis="1 2 3" pos="0.02 0.01 0"
          armature="0.3"/>
            <geom size="0.05" pos="0.1 0 0" contype="0" conaffinity="0"/>
            <body name="held" pos="0.2 0 0" euler="0 40 0"><site name="end" pos="0 0.1 0.05"/>
              <body name="slide"><joint name="b" type="slide" axis="0 1 0"/><geom
              size="0.03"/></body>
            </body></body></body></worldbody></mujoco>"""
    )
    arm, data = pinocchio_model(model), mujoco.MjData(model)
    other, mass = arm.createData(), np.zeros((2, 2))
    q, v = np.array([0.7, -0.2]), np.array([0.4, 0.9])
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    pin.framesForwardKinematics(arm, other, q)
    end = other.oMf[arm.getFrameId("end")].translation
    assert_allclose(end, data.site("end").xpos, atol=TOLERANCE)
    assert_allclose(np.triu(pin.crba(arm, other, q)), np.triu(mass), atol=TOLERANCE)
    assert_allclose(pin.nle(arm, other, q, v), data.qfrc_bias, atol=TOLERANCE)


def test_a_joint_that_cannot_be_carried_over_is_refused():
    ball = (
        "<mujoco><worldbody><body><joint name='b' type='ball'/><geom size='1'/></body></worldbody>"
        "</mujoco>"
    )
    with pytest.raises(ValueError, match="'b': only hinge and slide"):
        pinocchio_model(mujoco.MjModel.from_xml_string(ball))


def test_the_arm_file_compiles_alone_and_the_tip_radius_is_set_in_the_scene():
    assert mujoco.MjModel.from_xml_path(str(ARMS / "panda" / "arm.xml")).nv == 7
    model = build_laboratory(tip_radius_m=0.0037).model
    assert model.geom("probe_tip").size[0] == 0.0037


@pytest.mark.parametrize("name", ["panda", *OTHERS])
def test_every_arm_begins_with_its_tip_upright_above_the_table(name):
    laboratory = build_laboratory(arm=read_arm(name))
    kinematics = TipKinematics(laboratory.arm)
    tip, turn = kinematics.pose(laboratory.home)
    assert_allclose(turn[:, 2], [0, 0, -1], atol=2e-3)
    assert 0.1 < tip[2] < 0.5
    assert (laboratory.home > kinematics.low).all()
    assert (laboratory.home < kinematics.high).all()
    data = mujoco.MjData(laboratory.model)
    data.qpos[:] = laboratory.home
    mujoco.mj_kinematics(laboratory.model, data)
    assert_allclose(data.site("tcp").xpos, tip, atol=TOLERANCE)
    assert laboratory.links[-1] == "probe"


@pytest.mark.parametrize("name", OTHERS)
def test_other_arms_press_as_exactly_as_the_panda(name):
    plan = grid_plan()
    plan = ScanPlan(plan.points_m[[0, 40]], plan.directions[[0, 40]])
    run = run_scan(plan, Spring(), ScanSettings(arm=name))
    assert [outcome.kept for outcome in run.outcomes] == [True, True]
    for press in run.statistics:
        assert abs(press.force_error) < 0.01
        assert press.contact_error_m < 2e-4


SIMPLE = """<mujoco><worldbody><body name="base">
<body name="turn" pos="0 0 0.3"><joint name="a" axis="0 0 1" range="-3 3" limited="true"/>
<geom size="0.03" mass="1"/><body name="hand" pos="0.3 0 0"><joint name="b" axis="0 1 0"
range="-2 2" limited="true"/><geom name="palm" size="0.03" mass="1"/></body></body></body>
</worldbody><actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>"""
TABLE = """model = "own.xml"
joints = ["a", "b"]
home_rad = [0.0, 0.5]
speed_limit_rad_per_s = [2.0, 2.0]
acceleration_limit_rad_per_s2 = [5.0, 5.0]
[probe]
flange = "hand"
length_m = 0.2
"""


def folder_of(tmp_path, table=TABLE, model=SIMPLE):
    (tmp_path / "own.xml").write_text(model)
    (tmp_path / "arm.toml").write_text(table)
    return tmp_path


def test_an_arm_of_ones_own_is_a_folder(tmp_path):
    laboratory = build_laboratory(arm=read_arm(folder_of(tmp_path)))
    assert laboratory.links == ("base", "turn", "hand", "probe")
    tip, turn = TipKinematics(laboratory.arm).pose(np.array([0.0, 0.0]))
    assert_allclose(tip, [0.3, 0.0, 0.5], atol=TOLERANCE)
    assert_allclose(turn, np.eye(3), atol=TOLERANCE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("joints =", "joint ="), "key joint: unknown key; the nearest right name is 'joints'"),
        (('["a", "b"]', '["a", "c"]'), "has no joint 'c'"),
        (('["a", "b"]', '["b", "a"]'), "its joints from the base outwards are a, b"),
        (("[0.0, 0.5]", "[0.0]"), "key home_rad: found .* expected a list of 2 numbers"),
        (("speed_limit_rad_per_s = [2.0, 2.0]\n", ""), "the model states no limit of a"),
        (('"hand"', '"fist"'), "has no body 'fist'"),
        (('"own.xml"', '"other.xml"'), "no file .*other.xml"),
        (('flange = "hand"\n', ""), "expected either body .* or flange"),
        (("0.2", "-0.2"), "key length_m: found -0.2, expected a positive number"),
        (("[0.0, 0.5]", "[0.0, nan]"), "key home_rad: found .* expected a list of 2 numbers"),
        (("[2.0, 2.0]", "[2.0, -1.0]"), "key speed_limit.*: found .*-1.0.*, expected positive"),
    ],
)
def test_an_arm_that_cannot_be_built_is_refused_by_its_key(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        build_laboratory(arm=read_arm(folder_of(tmp_path, TABLE.replace(*change))))


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("<robot", "own.urdf: is no URDF"),
        (
            '<robot><joint name="a"><limit velocity="fast"/></joint></robot>',
            "limit velocity: .*fast",
        ),
        (
            '<robot><joint name="a"><limit velocity="-2"/></joint></robot>',
            "expected positive numbers",
        ),
    ],
)
def test_a_urdf_without_speeds_is_refused(model, message, tmp_path):
    (tmp_path / "own.urdf").write_text(model)
    (tmp_path / "arm.toml").write_text(
        'model = "own.urdf"\njoints = ["a"]\nhome_rad = [0]\n'
        'acceleration_limit_rad_per_s2 = [1]\n[probe]\nflange = "f"\n'
    )
    with pytest.raises(InputError, match=message):
        read_arm(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"probe = 3", "key probe: found 3, expected a table"), (b'name = "\xff"', "is no TOML")],
)
def test_a_damaged_table_of_an_arm_is_refused(content, message, tmp_path):
    (tmp_path / "arm.toml").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_arm(tmp_path)


def test_an_unknown_arm_is_refused_with_the_nearest():
    with pytest.raises(InputError, match="no arm 'pandas'; the nearest right name is 'panda'"):
        read_arm("pandas")
