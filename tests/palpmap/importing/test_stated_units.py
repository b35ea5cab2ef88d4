"""A wrong unit in a mapping: the refusal names the mapping's own key, columns and units."""

import re

import pytest

from models.errors import InputError
from palpmap.importing.importing import import_recording

RIG = """
kind = "readings"
time = {column = "time_s"}
press = {number = "press", direction = [0.0, 0.0, -1.0]}
force = {column = "force_N", unit = "N"}
travel = {column = "depth_mm", unit = "mm"}
point = {columns = ["x", "y", "z"], unit = "mm"}
probe = {tip = "flat", radius_m = 0.004}
body = {shape = "block", size_m = [0.06, 0.06, 0.03], poisson_ratio = 0.45}
"""


@pytest.fixture
def imported(tmp_path):
    """Import of two presses in millimetres, with another line in the mapping."""

    def run(right: str, wrong: str):
        rows = ["press,time_s,x,y,z,force_N,depth_mm"]
        for i in range(12):
            depth = 1.5 * min(i % 6 + 1, 4)
            rows.append(f"{i // 6},{0.5 * i},{20 + 20 * (i // 6)},30,30,{0.05 * depth},{depth}")
        (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
        assert right in RIG
        (tmp_path / "rig.toml").write_text(RIG.replace(right, wrong))
        made = import_recording(tmp_path / "run.csv", tmp_path / "rig.toml")
        made.write(tmp_path / "study")
        return made

    return run


POINT, TRAVEL = '"z"], unit = "mm"', '"depth_mm", unit = "mm"'


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        (POINT, POINT.replace("mm", "m"),
         'this looks like millimetres; correct in the mapping point.unit = "m", read from x, y, z'),
        (TRAVEL, TRAVEL.replace('"mm"', '"m"'),
         'correct in the mapping travel.unit = "m" (the recording states mm), read from depth_mm'),
        (POINT, POINT.replace("mm", "cm"), "check body.size_m and body.origin_m in the mapping; or "
         'correct in the mapping point.unit = "cm", read from x, y, z'),
        ('unit = "N"', 'unit = "kN"', "this looks like grams or millinewtons; correct in the "
         'mapping force.unit = "kN" (the recording states N), read from force_N'),
        (TRAVEL, TRAVEL.replace('"mm"', '"um"'),
         'correct in the mapping travel.unit = "um" (the recording states mm), read from depth_mm'),
        ("radius_m = 0.004", "radius_m = 4.0", "key probe.radius_m of the mapping: found 4 m"),
    ],
)  # fmt: skip
def test_a_wrong_unit_is_refused_in_words_of_the_mapping(right, wrong, said, imported):
    with pytest.raises(InputError) as caught:
        imported(right, wrong)
    assert said in str(caught.value)
    assert not re.search("column (x_m|displacement_m).*divide by", str(caught.value))


def test_a_unit_stated_otherwise_is_said_where_nothing_is_refused(imported):
    made = imported('unit = "N"', 'unit = "mN"')
    assert made.said[1] == (
        "force.unit is mN, but the recording states N for force_N: read in mN; correct the mapping "
        "if that is wrong."
    )


def test_a_unit_in_another_spelling_is_the_same(imported):
    made = imported('unit = "N"', 'unit = "newton"')
    assert not [sentence for sentence in made.said if "states" in sentence]
