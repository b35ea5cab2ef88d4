"""`palpmap new`: a study from flags; what a scan cannot tell is asked for by its flag."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from models.scan_file import read_scan, write_scan
from palpmap.__main__ import app
from palpmap.commands import new as command
from palpmap.commands.check import check_study
from palpmap.console import Output
from palpmap.importing.new import Facts, turned
from palpmap.result.press_outcomes import MeasuredRecord, PressesRecord, PressRecord
from palpmap.study.study import load_study
from tests.paths import LAB

SCAN = LAB / "case_c" / "scan.csv"
ALL = ("--tip", "flat", "--size", "0.096,0.096,0.048", "--poisson", "0.49")


def run(*words: object, code: int = 0):
    result = CliRunner().invoke(app, ["new", *map(str, words)])
    assert result.exit_code == code, result.output
    return result


def test_flags_make_a_study_that_can_be_fitted(tmp_path):
    record = json.loads(run(SCAN, *ALL, "--out", tmp_path / "s", "--json").stdout)
    study = load_study(tmp_path / "s" / "study.toml")
    ours, theirs = study, load_study(LAB / "case_c" / "study.toml")
    assert (ours.body, ours.probe, ours.map) == (theirs.body, theirs.probe, theirs.map)
    assert study.scan == (tmp_path / "s" / "scan.csv").resolve()
    assert check_study(tmp_path / "s" / "study.toml").can_be_fitted
    text = (tmp_path / "s" / "study.toml").read_text()
    assert "# Made by palpmap new from scan.csv" in text
    assert "# No [noise]: it is estimated" in text
    assert "81 presses" in record["said"][0]
    assert "already there" in run(SCAN, *ALL, "--out", tmp_path / "s", code=2).stderr


@pytest.mark.parametrize("flag", ["--tip", "--size", "--poisson"])
def test_what_is_not_given_is_an_error_that_names_its_flag(flag, tmp_path):
    at = ALL.index(flag)
    said = run(SCAN, *ALL[:at], *ALL[at + 2 :], "--out", tmp_path / "s", code=2).stderr
    assert flag in said
    assert not (tmp_path / "s").exists()


def test_another_frame_is_asked_for_with_the_height_that_the_points_tell(tmp_path):
    scan = read_scan(SCAN).moved(np.array([0.45, -0.1, 0.02]))
    write_scan(scan, tmp_path / "moved.csv")
    said = run(tmp_path / "moved.csv", *ALL, "--out", tmp_path / "s", code=2).stderr
    assert "--origin is missing" in said
    assert "z is 0.02" in said
    run(tmp_path / "moved.csv", *ALL, "--origin", "0.45,-0.1,0.02", "--out", tmp_path / "s")
    assert check_study(tmp_path / "s" / "study.toml").can_be_fitted


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--size", "0.096,0.096"), "three numbers"),
        (("--size", "96,96,48"), "looks like millimetres"),
        (("--poisson", "0.7"), "palpmap: --poisson: found 0.7"),
        (("--inclusions", "many"), "palpmap: --inclusions: found 'many'"),
        (("--force-noise", "-1"), "--force-noise"),
        (("--touch-noise", "-1"), "--touch-noise"),
        (("--origin", "0,0,0.01"), "check --size and --origin"),
    ],
)
def test_a_wrong_value_is_answered_by_its_flag_and_leaves_no_folder(words, said, tmp_path):
    stderr = run(SCAN, *ALL, *words, "--out", tmp_path / "s", code=2).stderr
    assert said in stderr
    assert str(tmp_path) not in stderr
    assert not (tmp_path / "s").exists()


def test_a_wrong_body_is_answered_by_its_flag_and_leaves_what_was_there(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "notes.txt").touch()
    words = (SCAN, "--tip", "flat", "--poisson", "0.49", "--out", tmp_path / "s")
    said = run(*words, "--thickness", "30", code=2).stderr
    assert "palpmap: --thickness: found 30 m" in said
    assert "units_checked" not in said
    said = run(*words, "--surface", "none.stl", code=2).stderr
    assert "--surface: none.stl is no file" in said
    (tmp_path / "body.txt").touch()
    said = run(*words, "--surface", tmp_path / "body.txt", code=2).stderr
    assert f"{tmp_path / 'body.txt'}: a surface file must end" in said
    assert [path.name for path in (tmp_path / "s").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("name", ["other.csv", "other.xlsx"])
def test_a_table_in_another_form_is_sent_to_import(name, tmp_path):
    (tmp_path / name).write_text("Druck;Kraft [N]\n1;0,4\n")
    said = run(tmp_path / name, "--out", tmp_path / "s", code=2).stderr
    assert f"`palpmap import {tmp_path / name} --propose" in said


def test_the_comment_above_the_map_knows_the_free_one(tmp_path):
    run(SCAN, *ALL, "--inclusions", "free", "--out", tmp_path / "s")
    text = (tmp_path / "s" / "study.toml").read_text()
    assert 'or kind = "free": a map of any shape.\n[map]\nkind = "free"' in text


def test_a_flat_surface_predicts_points_to_0_mm(tmp_path):
    given = ("--tip", "flat", "--thickness", "0.048", "--poisson", "0.49")
    said = json.loads(run(SCAN, *given, "--out", tmp_path / "s", "--json").stdout)["said"]
    assert "predicts points left out to 0 mm" in " ".join(said)


def presses_json(numbers, touch_sd_m) -> PressesRecord:
    """What a robot states of its presses."""
    held = dict.fromkeys(("force_error", "overshoot", "place_error_m", "tare_n", "zero_after_n"), 0)
    return PressesRecord(
        on_fault="skip",
        presses=tuple(
            PressRecord(
                press=number, outcome="made", kept=True, set_force_n=0.3, reason="", faults=(),
                measured=MeasuredRecord(force_n=0.3, touch_sd_m=sd, **held), simulator=None,
            )
            for number, sd in zip(numbers, touch_sd_m, strict=True)
        ),
    )  # fmt: skip


def test_the_first_touch_that_a_robot_states_is_counted(tmp_path):
    """Uncounted, touches off by 36 µm make structure of one noisy scan in twenty."""
    own = tmp_path / "scan.csv"
    own.write_bytes(SCAN.read_bytes())
    numbers = read_scan(SCAN).press_ids.tolist()
    sd_m = np.where(np.arange(len(numbers)) % 2, 3e-5, 4e-5)
    sd_m[0] = 3.5355e-5
    presses_json(numbers, sd_m.tolist()).write(tmp_path / "presses.json")
    given = (*ALL, "--displacement-noise", 2e-5)
    said = json.loads(run(own, *given, "--out", tmp_path / "a", "--json").stdout)["said"]
    assert load_study(tmp_path / "a" / "study.toml").noise.touch_m == pytest.approx(3.5e-5)
    assert "states the depth of first touch to 35 µm" in " ".join(said)
    run(own, *given, "--touch-noise", 6e-5, "--out", tmp_path / "b")
    assert load_study(tmp_path / "b" / "study.toml").noise.touch_m == 6e-5
    # Small beside a reading's noise, or of other presses: not counted
    for name, other in (
        ("c", presses_json(numbers, [5e-6] * len(numbers))),
        ("d", presses_json([n + 1 for n in numbers], sd_m.tolist())),
    ):
        other.write(tmp_path / "presses.json")
        run(own, *given, "--out", tmp_path / name)
        assert load_study(tmp_path / name / "study.toml").noise.touch_m is None
    (tmp_path / "presses.json").write_text("{}")
    said = json.loads(run(own, *given, "--out", tmp_path / "e", "--json").stdout)["said"]
    assert "counts no error of first touch" in said[-1]


def test_questions_take_the_place_of_flags_on_a_terminal(tmp_path):
    answers = iter(["ball", "flat", "thick", "0.096,0.096,0.048", "1.2", "0.49"])
    asked: list[str] = []

    def ask(question):
        asked.append(question)
        return next(answers)

    command.run_new(
        scan=SCAN, out=tmp_path / "s",
        facts=Facts(displacement_noise_m=2e-5, force_noise_n=5e-3, inclusions=1),
        ask=ask, three=lambda text: tuple(map(float, text.split(","))),
        output=Output(quiet=True, json=False),
    )  # fmt: skip
    assert load_study(tmp_path / "s" / "study.toml").probe.tip == "flat"
    assert [q[: q.index(",")] for q in asked[1::2]] == [
        "--tip: found 'ball'", "--thickness: found 'thick'", "--poisson: found 1.2"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("axis", "angle", "back"),
    [
        ((0, 1, 0), -90, (0.707107, 0, -0.707107, 0)),  # pressed along x
        ((1, 0, 0), 180, (0, -1, 0, 0)),  # from below
        ((1, 1, 0), 125, None),  # beside all axes
    ],
)
def test_a_scan_from_another_side_is_turned_until_z_points_up(axis, angle, back, tmp_path):
    """Places, directions, forces and poses turn with it, and the rotation said turns them back."""
    turn = Rotation.from_rotvec(np.radians(angle) * np.array(axis) / np.linalg.norm(axis))
    own = read_scan(LAB / "case_c" / "scan.csv")
    own = own.replace(
        force_vector_n=own.force_n[:, None] * own.direction,
        tip_pose=np.column_stack([own.point_m, np.tile([1.0, 0, 0, 0], (len(own), 1))]),
    )
    write_scan(turned(own, turn), tmp_path / "scan.csv")
    words = ("--tip", "flat", "--thickness", 0.048, "--poisson", 0.49, "--out", tmp_path / "s")
    record = json.loads(run(tmp_path / "scan.csv", *words, "--json").stdout)
    (said,) = (sentence for sentence in record["said"] if "is turned by" in sentence)
    quaternion = [float(q) for q in said.split("(w, x, y, z) = (")[1].split(")")[0].split(",")]
    if back:
        assert quaternion == pytest.approx(back, abs=1e-5)
    found = read_scan(tmp_path / "s" / "scan.csv")
    assert (np.degrees(np.arccos(-found.direction[:, 2])) < 1).all()
    again = turned(found, Rotation.from_quat(quaternion, scalar_first=True))
    for name in ("point_m", "direction", "force_vector_n"):
        expected = getattr(turned(own, turn), name)
        assert getattr(again, name) == pytest.approx(expected, abs=2e-6), name
    pose, expected = again.tip_pose, turned(own, turn).tip_pose
    assert pose is not None
    assert expected is not None
    assert pose[:, :3] == pytest.approx(expected[:, :3], abs=2e-6)
    assert np.abs(np.sum(pose[:, 3:] * expected[:, 3:], axis=1)) == pytest.approx(1, abs=1e-6)
    # The tip still stands at its point, and looks along its press
    assert found.tip_pose is not None
    assert found.tip_pose[:, :3] == pytest.approx(found.point_m, abs=2e-6)
    looks = Rotation.from_quat(found.tip_pose[:, 3:].copy(), scalar_first=True).apply((0, 0, -1))
    assert looks == pytest.approx(found.direction, abs=1e-5)
    study = (tmp_path / "s" / "study.toml").read_text()
    assert "# The robot presses along" in study
    assert check_study(tmp_path / "s" / "study.toml").can_be_fitted


def test_a_turned_scan_has_its_places_directions_and_poses_turned_alike():
    own = read_scan(SCAN)
    pose = np.column_stack([own.point_m, np.tile([1.0, 0, 0, 0], (len(own), 1))])
    turn = Rotation.from_rotvec([0.3, -1.1, 0.6])
    found = turned(own.replace(tip_pose=pose), turn)
    assert found.point_m == pytest.approx(turn.apply(own.point_m.copy()))
    assert found.direction == pytest.approx(turn.apply(own.direction.copy()))
    assert found.tip_pose is not None
    assert found.tip_pose[:, :3] == pytest.approx(found.point_m)
    looks = Rotation.from_quat(found.tip_pose[:, 3:].copy(), scalar_first=True).apply((0, 0, -1))
    assert looks == pytest.approx(found.direction)
