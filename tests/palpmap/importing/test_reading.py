"""What readers make of files, whole and damaged."""

import pickle

import numpy as np
import pytest

from models.errors import InputError
from models.scan_file import read_scan
from palpmap.importing.read import read_recording
from tests.palpmap.importing.foreign_files import FORMS
from tests.paths import LAB


def refusal(*files) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(files)
    return str(caught.value)


@pytest.fixture(scope="module")
def few():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    return scan.rows(scan.press < 4)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_a_damaged_file_is_refused_in_one_sentence_or_read(form, few, tmp_path):
    rng = np.random.default_rng(5)
    for file in form(few, tmp_path).files[:1]:
        path = next(file.glob("*.mcap")) if file.is_dir() else file
        whole = path.read_bytes()
        for _ in range(12):
            if rng.random() < 0.5:
                data = whole[: int(rng.integers(1, len(whole)))]
            else:
                data = bytearray(whole)
                at = int(rng.integers(0, len(whole) - 8))
                data[at : at + 8] = rng.bytes(8)
            path.write_bytes(bytes(data))
            said = str(tmp_path)
            try:
                recording = read_recording([file])
                assert all(len(channel.values) for channel in recording.channels)
            except InputError as error:
                said = str(error)
            assert str(tmp_path) in said
            assert "\n" not in said


def test_python_objects_are_never_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "sprung"), "w"))

    path = tmp_path / "trap.npy"
    np.save(path, np.array([Trap()], dtype=object), allow_pickle=True)
    bare = tmp_path / "bare.npy"
    bare.write_bytes(pickle.dumps(Trap()))
    assert "pickle" in refusal(path)
    refusal(bare)
    assert not (tmp_path / "sprung").exists()


def test_what_is_no_recording_is_said(tmp_path):
    (tmp_path / "empty.csv").touch()
    (tmp_path / "words.csv").write_text("just\nsome\nwords\n")
    (tmp_path / "program.exe").write_bytes(b"MZ\0\0\0\0")
    assert "no such file" in refusal(tmp_path / "none.csv")
    assert "a folder that is no ROS 2 bag" in refusal(tmp_path)
    assert "empty" in refusal(tmp_path / "empty.csv")
    assert "does not split into columns" in refusal(tmp_path / "words.csv")
    assert "binary file" in refusal(tmp_path / "program.exe")


def test_a_ragged_line_and_a_bad_cell_are_named(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t;F\n0,1;2,5\n0,2;3,5;7\n0,3;4\n0,4;5\n0,5;5\n")
    assert "line 3: found 3 cells, expected 2" in refusal(path)
    path.write_text("t;F\n0,1;2,5\n0,2;overload\n0,3;\n0,4;5\n0,5;5\n")
    channel = read_recording([path]).channel("F", "force.column")
    with pytest.raises(InputError, match=r"line 3, F: found 'overload', expected a number"):
        channel.numbers()
    path.write_text("t;F\n0,1;2,5\n0,2;1\n0,3;\n0,4;5\n0,5;5\n")
    with pytest.raises(InputError, match=r"line 4, F: found an empty cell"):
        read_recording([path]).channel("F", "force.column").numbers()


def test_a_wrong_name_is_answered_with_the_nearest_right_one(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,force_z\n0.1,2.5\n0.2,2.6\n0.3,2.7\n")
    with pytest.raises(InputError) as caught:
        read_recording([path]).channel("force_x", "force.column")
    assert "the recording has no 'force_x'; the nearest right name is 'force_z'" in str(
        caught.value
    )


def test_units_are_read_from_headers_and_from_a_row_below(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [ms],Kraft in mN,x_mm,n\n1,2,3,4\n2,3,4,5\n3,4,5,6\n")
    assert {c.name: c.unit for c in read_recording([path]).channels} == {
        "t [ms]": "ms", "Kraft in mN": "mN", "x_mm": "mm", "n": ""
    }  # fmt: skip
    path.write_text("t,F,x\n[s],[N],[µm]\n1,2,3\n2,3,4\n3,4,5\n")
    assert [c.unit for c in read_recording([path]).channels] == ["s", "N", "um"]
