"""What readers make of files, whole and damaged."""

import pickle

import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from models.errors import InputError
from models.scan_file import read_scan
from palpmap.importing.readers.read import read_recording
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


def test_a_reading_below_the_header_is_never_taken_for_a_title(tmp_path):
    path = tmp_path / "run.csv"
    full = "".join(f"{i},1,2,3\n" for i in range(5))
    path.write_text("t,x,y,F\n0,1,2\n" + full)
    assert "line 2: found 3 cells, expected 4" in refusal(path)
    path.write_text("t,x,y,F\n0,,,\n" + full)
    with pytest.raises(InputError, match="line 2, F: found an empty cell"):
        read_recording([path]).channel("F", "force.column").numbers()
    path.write_text("0,1,2\n" + full)
    assert read_recording([path]).notes[0].endswith("1 above them was taken for a title.")


def test_a_typographic_minus_is_a_minus(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,F\n1,\N{MINUS SIGN}2.5\n2,3\n3,3\n", encoding="utf-8")
    assert read_recording([path]).channel("F", "force.column").values.tolist() == [-2.5, 3, 3]


@pytest.mark.parametrize("start", [b"\x1f\x8b", b"PK\3\4", b"BZh", b"\xfd7zXZ"])
def test_a_packed_file_is_to_be_unpacked(start, tmp_path):
    path = tmp_path / "run.csv.gz"
    path.write_bytes(start + b"\0\0")
    assert "unpack it first" in refusal(path)


def test_the_columns_of_a_parquet_file_are_read(tmp_path):
    path = tmp_path / "run.parquet"
    dates = np.array(["2026-01-01T00:00:00.5", "2026-01-01T00:00:01"], "datetime64[ns]")
    table = {"t": dates, "n": [1, None], "F [mN]": [2.5, 3.5], "phase": ["load", None]}
    pq.write_table(pa.table(table), path)
    recording = read_recording([path])
    time, number, force, phase = recording.channels
    assert (time.unit, force.unit) == ("ns", "mN")
    assert np.diff(time.values).tolist() == [5e8]
    assert force.values.tolist() == [2.5, 3.5]
    assert phase.values.tolist() == ["load", ""]
    with pytest.raises(InputError, match=r"run\.parquet, row 2, n: found an empty cell"):
        number.numbers()
    path.write_bytes(path.read_bytes()[:-9])
    assert "cannot be read as a Parquet file" in refusal(path)


def test_a_wrong_name_is_answered_with_the_nearest_right_one(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,force_z\n0.1,2.5\n0.2,2.6\n0.3,2.7\n")
    with pytest.raises(InputError) as caught:
        read_recording([path]).channel("force_x", "force.column")
    assert "the recording has no 'force_x'; the nearest right name is 'force_z'" in str(
        caught.value
    )


def test_a_name_that_stands_twice_is_asked_for_by_its_number(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,F,F\n1,2.5,5.0\n2,2.6,5.2\n3,2.7,5.4\n")
    recording = read_recording([path])
    with pytest.raises(InputError, match=r"'F' stands 2 times .* as 'F\.1', 'F\.2'"):
        recording.channel("F", "force.column")
    assert recording.channel("F.2", "force.column").values.tolist() == [5.0, 5.2, 5.4]


def test_quoted_commas_are_read_where_one_meaning_fits_the_column(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(
        't,F,d,u\n1,"0,25","673.2","1,250"\n2,"12","1,417.1","1,300"\n3,"3,5","9","1"\n'
    )
    recording = read_recording([path])
    assert recording.channel("F", "force.column").numbers().tolist() == [0.25, 12.0, 3.5]
    assert recording.channel("d", "travel.column").numbers().tolist() == [673.2, 1417.1, 9.0]
    with pytest.raises(InputError, match=r"line 2, u: found '1,250', .* comma as a point"):
        recording.channel("u", "travel.column").numbers()


def test_text_cells_of_a_sheet_are_numbers_where_all_are(tmp_path):
    book = openpyxl.Workbook()
    assert book.active is not None
    for row in (["t", "F"], [1, "0,25"], [2, 0.5], [3, "0,75"]):
        book.active.append(row)
    book.save(tmp_path / "run.xlsx")
    channel = read_recording([tmp_path / "run.xlsx"]).channel("F", "force.column")
    assert channel.is_number
    assert channel.values.tolist() == [0.25, 0.5, 0.75]


def test_units_are_read_from_headers_and_from_a_row_below(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [ms],Kraft in mN,x_mm,n\n1,2,3,4\n2,3,4,5\n3,4,5,6\n")
    assert {c.name: c.unit for c in read_recording([path]).channels} == {
        "t [ms]": "ms", "Kraft in mN": "mN", "x_mm": "mm", "n": ""
    }  # fmt: skip
    path.write_text("t,F,x\n[s],[N],[µm]\n1,2,3\n2,3,4\n3,4,5\n")
    assert [c.unit for c in read_recording([path]).channels] == ["s", "N", "um"]


def test_a_commented_header_names_the_columns(tmp_path):
    path = tmp_path / "wrench.csv"
    path.write_text("%time,field.wrench.force.z\n1,2.5\n2,2.6\n3,2.7\n")
    assert read_recording([path]).names == ("time", "field.wrench.force.z")
    np.savetxt(path, np.ones((4, 2)), header="t F", comments="# ")
    assert read_recording([path]).names == ("t", "F")


def test_transforms_and_joints_are_read_from_a_bag(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1_760_000_000, nanosec=5)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
    there = types["geometry_msgs/msg/Vector3"](x=0.1, y=0.2, z=0.3)
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    moved = types["geometry_msgs/msg/Transform"](translation=there, rotation=turn)
    one = types["geometry_msgs/msg/TransformStamped"](
        header=header, child_frame_id="tip", transform=moved
    )
    joints = {"name": ["b", "a"], "position": np.array([1.0, 2.0]), "velocity": np.array([]),
              "effort": np.array([])}  # fmt: skip
    path = tmp_path / "run"
    with Writer(path, version=9) as writer:
        for topic, kind, message in (
            ("/tf", "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"](transforms=[one])),
            ("/joints", "sensor_msgs/msg/JointState",
             types["sensor_msgs/msg/JointState"](header=header, **joints)),
        ):  # fmt: skip
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(2):
                writer.write(
                    connection, 1_760_000_000_000_000_005 + k, store.serialize_cdr(message, kind)
                )
    for files in ([path], list(path.glob("*.db3"))):
        recording = read_recording(files)
        assert recording.channel("transform.translation.y", "k").values.tolist() == [0.2, 0.2]
        assert recording.channel("/tf base->tip:stamp", "k").values.tolist() == [0.0, 0.0]
        assert recording.channel("position.a", "k").values.tolist() == [2.0, 2.0]
        assert "velocity.a" not in recording.names
