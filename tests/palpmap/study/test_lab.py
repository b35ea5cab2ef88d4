"""The file of a laboratory, and what is refused in it."""

import pytest

from models.errors import InputError
from palpmap.study.lab import read_lab
from palpmap.study.press_plan import grid_plan_of
from palpmap.study.virtual_lab import default_study
from sim.motion.settings import ScanSettings

WHOLE = """arm = "xarm7"
truth = "map.toml"
plant = ["force_drift:3", "own.py"]
[body]
position_m = [0.4, -0.05, 0.1]
[robot]
hold_s = 1.5
pause_s = [0.1, 0.2]
[[obstacles]]
size_m = [0.1, 0.02, 0.2]
position_m = [0.5, 0.2, 0.1]
"""


def written(tmp_path, text):
    path = tmp_path / "lab.toml"
    path.write_text(text)
    return path


def test_a_laboratory_says_arm_truth_place_robot_and_obstacles(tmp_path):
    lab = read_lab(written(tmp_path, WHOLE))
    settings = lab.settings(ScanSettings(seed=3))
    assert (settings.arm, settings.seed, settings.hold_s) == ("xarm7", 3, 1.5)
    assert settings.pause_s == (0.1, 0.2)
    assert settings.obstacles == (((0.1, 0.02, 0.2), (0.5, 0.2, 0.1)),)
    assert lab.truth == str(tmp_path / "map.toml")
    assert lab.plant == ("force_drift:3", str(tmp_path / "own.py"))
    plan = lab.placed(grid_plan_of(default_study(), 0.3, 2))
    assert plan.body_in_world.position_m == (0.4, -0.05, 0.1)
    own = read_lab(written(tmp_path, 'arm = "mine"\n'))
    assert own.arm == str(tmp_path / "mine")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("arm =", "arms ="), "arms"),
        (
            ("hold_s", "holds_s"),
            "key robot.holds_s: unknown key; the nearest right name is 'hold_s'",
        ),
        (("[0.1, 0.02, 0.2]", "[0.1, 0.0, 0.2]"), "size_m"),
        (("[robot]", "[robot"), "cannot be read as a laboratory"),
    ],
)
def test_a_laboratory_that_cannot_be_is_refused_by_its_key(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_lab(written(tmp_path, WHOLE.replace(*change)))
