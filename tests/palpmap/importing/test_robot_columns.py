"""Logs of robots as their makers' tools write them: a numbered pose, a matrix, angles in turn."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from models.errors import InputError
from palpmap.importing.mapping.orientation import quaternions
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.propose import propose_rig
from palpmap.importing.readers.recording import Recording, Table
from palpmap.importing.streams.cutting import cut_stream

LEAN = Rotation.from_euler("xyz", [176.0, 5.0, 20.0], degrees=True)
"""A tool that hangs down, not quite upright."""
FLANGE_M = np.array([0.003, -0.002, 0.05])  # the tip's end, in its axes


def pressed(seed: int = 2, hz: float = 125.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (m,), position of the flange (m, 3) and force on the tip in the base's axes, (m, 3)."""
    rng, parts, begin = np.random.default_rng(seed), [], 0.0
    course = np.array([[0.0, -3.0], [2.5, 2.0], [3.5, 2.0], [6.0, -3.0], [6.5, -3.0]])
    for x, y in np.ndindex(3, 3):
        time = np.arange(0.0, 6.5, 1 / hz)
        depth = np.interp(time, *course.T)
        place = np.tile([0.4 + 0.02 * x, 0.02 * y, 0.2], (len(time), 1))
        place[:, 2] -= 1e-3 * depth
        parts.append((begin + time, place, np.maximum(depth, 0) / 8))
        begin += 6.5
    time, place, force = (np.concatenate(some) for some in zip(*parts, strict=True))
    vector = rng.normal(0, 0.004, (len(time), 3)) + force[:, None] * [0, 0, 1]
    place = place + rng.normal(0, 5e-6, place.shape) - LEAN.apply(FLANGE_M)
    return time, place, vector


def names(base: str, count: int) -> list[str]:
    return [f"{base}_{i}" for i in range(count)]


def universal_robots(time, place, force) -> dict[str, np.ndarray]:
    pose = np.column_stack([place, np.tile(LEAN.as_rotvec(), (len(time), 1))])
    wrench = np.column_stack([force, 0 * force])
    commanded = np.round(pose, 2)
    return {
        "timestamp": time + 12345.0,
        **dict(zip(names("actual_q", 6), 0.1 * commanded.T, strict=True)),
        **dict(zip(names("target_TCP_pose", 6), commanded.T, strict=True)),
        **dict(zip(names("actual_TCP_pose", 6), pose.T, strict=True)),
        **dict(zip(names("actual_TCP_force", 6), wrench.T, strict=True)),
    }


def franka(time, place, force) -> dict[str, np.ndarray]:
    matrix = np.tile(np.eye(4), (len(time), 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = LEAN.as_matrix(), place
    by_columns = matrix.swapaxes(1, 2).reshape(-1, 16)
    still = np.tile(np.eye(4).ravel(), (len(time), 1))
    return {
        "time": time,
        **dict(zip(names("F_T_EE", 16), still.T, strict=True)),
        **dict(zip(names("O_T_EE", 16), by_columns.T, strict=True)),
        **dict(zip(names("O_F_ext_hat_K", 3), force.T, strict=True)),
    }


def kuka(time, place, force) -> dict[str, np.ndarray]:
    turns = np.tile(LEAN.as_euler("ZYX", degrees=True), (len(time), 1))
    return {
        "t": time,
        **dict(zip("XYZ", 1e3 * place.T, strict=True)),
        **dict(zip("ABC", turns.T, strict=True)),
        **dict(zip(("Fx", "Fy", "Fz"), LEAN.inv().apply(force).T, strict=True)),
    }


@pytest.mark.parametrize(
    ("log", "order", "frame"),
    [(universal_robots, "vector", "base"), (franka, "columns", "base"), (kuka, "ZYX", "tip")],
)
def test_a_robots_own_log_is_understood_and_cut(log, order, frame):
    recording = Recording.of([Table("log", log(*pressed()), {}, str)])
    proposed = propose_rig(recording)
    rig = parse_rig(proposed, Path("rig.toml"))
    assert rig.pose is not None
    assert (rig.pose.order, rig.force.frame, rig.force.sign) == (order, frame, -1)
    assert not any("target" in name or "F_T_EE" in name for name in rig.pose.columns)
    pose = rig.pose.model_copy(update={"tip_offset_m": tuple(FLANGE_M)})
    cut = cut_stream(recording, rig.model_copy(update={"pose": pose}))
    assert len(cut.presses) == 9
    for press in cut.presses:
        assert abs(press.point_m[2] - 0.2) < 4 * press.touch_error_m
        place = press.point_m[:2]
        assert place == pytest.approx(0.02 * np.round(place / 0.02), abs=1e-4)
        assert press.force_n.max() == pytest.approx(0.25, abs=0.01)


def test_where_both_frames_fit_alike_the_sign_goes_with_the_one_that_the_name_tells():
    for seed in range(6):
        log = universal_robots(*pressed(seed))
        text = propose_rig(Recording.of([Table("log", log, {}, str)]))
        rig = parse_rig(text, Path("rig.toml"))
        assert "both frames fit alike" in text
        assert (rig.force.frame, rig.force.sign) == ("base", -1)


@pytest.mark.parametrize(
    ("order", "written"),
    [
        ("xyzw", lambda r: r.as_quat()),
        ("wxyz", lambda r: np.roll(r.as_quat(), 1, axis=1)),
        ("vector", lambda r: r.as_rotvec()),
        ("ZYX", lambda r: r.as_euler("ZYX")),
        ("xyz", lambda r: r.as_euler("xyz")),
        ("rows", lambda r: r.as_matrix().reshape(-1, 9)),
        ("columns", lambda r: r.as_matrix().swapaxes(1, 2).reshape(-1, 9)),
    ],
)
def test_each_order_gives_the_same_orientations_back(order, written):
    turns = Rotation.random(20, np.random.default_rng(3))
    found, none = quaternions(written(turns), order)
    assert not none.any()
    again = Rotation.from_quat(np.roll(found, -1, axis=1))
    assert np.max((again * turns.inv()).magnitude()) < 1e-9


def test_rows_that_are_no_orientation_are_told():
    assert quaternions(np.array([[0.5, 0.0, 0.0, 0.0]]), "wxyz")[1].all()
    assert quaternions(np.diag([1.0, 1.0, -1.0]).reshape(1, 9), "rows")[1].all()
    found, none = quaternions(np.array([[np.nan, 0.0, 0.0]]), "vector")
    assert np.isnan(found).all()
    assert not none.any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({'"a", "b", "c"': '"a", "b"'}, "a list of 3 columns"),
        ({'"vector"': '"ZZX"'}, "order = "),
        ({'"rad"': '"grad centigrade"'}, "pose.angle_unit"),
    ],
)
def test_a_wrong_orientation_is_refused_in_one_sentence(change, said):
    text = (
        'kind = "stream"\nforce = {column = "f", unit = "N"}\n[pose]\ncolumns = ["x", "y", "z"]\n'
        'unit = "m"\norientation = ["a", "b", "c"]\norder = "vector"\nangle_unit = "rad"\n'
    )
    assert parse_rig(text, Path("rig.toml"))
    for old, new in change.items():
        text = text.replace(old, new)
    with pytest.raises(InputError, match=said) as caught:
        parse_rig(text, Path("rig.toml"))
    assert "\n" not in str(caught.value)
