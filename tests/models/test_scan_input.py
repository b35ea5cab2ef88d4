"""Bad scans get one sentence that names file, row, column, what was found and what to do."""

import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from models.errors import InputError
from models.scan_file import read_scan, write_scan
from tests.paths import LAB

CASE_A = LAB / "case_a" / "scan.csv"
LINES = CASE_A.read_text().splitlines()[: 1 + 3 * 22]
HEADER = LINES[0].split(",")


def column(name: str) -> int:
    return HEADER.index(name)


def changed(row: int, name: str, value: str) -> list[str]:
    """Lines with one cell changed; row counts data rows from 1."""
    cells = LINES[row].split(",")
    cells[column(name)] = value
    return [*LINES[:row], ",".join(cells), *LINES[row + 1 :]]


def scaled(name: str, factor: float) -> list[str]:
    rows = [line.split(",") for line in LINES[1:]]
    for cells in rows:
        cells[column(name)] = repr(float(cells[column(name)]) * factor)
    return [LINES[0], *(",".join(cells) for cells in rows)]


def without_column(name: str) -> list[str]:
    return [
        ",".join(c for i, c in enumerate(line.split(",")) if i != column(name)) for line in LINES
    ]


def renamed(name: str, new: str) -> list[str]:
    return [LINES[0].replace(name, new), *LINES[1:]]


def with_columns(names: str, cells: str) -> list[str]:
    return [f"{LINES[0]},{names}", *(f"{line},{cells}" for line in LINES[1:])]


QUATERNION = "tip_x_m,tip_y_m,tip_z_m,tip_qw,tip_qx,tip_qy,tip_qz"

BAD = {
    "a missing column": (without_column("force_n"), r"column 'force_n' is missing.*add the column"),
    "a missing time column": (without_column("time_s"), r"'time_s' is missing.*leave its cells"),
    "an unknown column": (renamed("force_n", "forze_n"), r"'forze_n'.*right name is 'force_n'"),
    "a column in capitals": (renamed("press", "PRESS"), r"'PRESS'.*right name is 'press'"),
    "a column that is like no other": (
        with_columns("temp_c", "21"),
        r"unknown column 'temp_c'; expected press,.*remove the column",
    ),
    "a comma after each line": (
        [line + "," for line in LINES],
        r"header that ends with a comma.*each line ends with a comma too many",
    ),
    "a comma after each line but the header": (
        [LINES[0], *(line + "," for line in LINES[1:])],
        r"row 1 \(line 2\): found 13 cells, .*the line ends with a comma too many",
    ),
    "a time that begins anew with a press": (
        [*LINES[:23], *(re.sub(r"^1,[\d.]+", "1,0.0", line) for line in LINES[23:])],
        r"row 23 .*time_s: found 0 s after .*start time of each press, or join .*join --pause`",
    ),
    "a clock that begins anew within a press": (
        [*LINES[:30], *(re.sub(r"^(\d+),[\d.]+", r"\1,0.0", line) for line in LINES[30:])],
        r"row 30 .*time_s: found 0 s after .*join --pause`",
    ),
    "a column twice": (renamed("ny", "nx"), r"column 'nx' stands twice"),
    "an incomplete force vector": (with_columns("fx_n", "0"), r"'fx_n' stands without fy_n, fz_n"),
    "an empty cell": (
        changed(5, "force_n", ""),
        r"row 5 \(line 6\), column force_n: found an empty",
    ),
    "a NaN": (changed(5, "x_m", "nan"), r"row 5 \(line 6\), column x_m: found 'nan'.*finite"),
    "an infinity": (changed(5, "x_m", "1e999"), r"row 5 \(line 6\), column x_m: found inf"),
    "text in a number": (changed(9, "force_n", "0.3 N"), r"row 9 .*force_n: found '0.3 N'"),
    "a quoted decimal comma": (
        changed(4, "force_n", '"0,15"'),
        r"row 4 .*force_n: found '0,15'.*write numbers with '.'",
    ),
    "a bare decimal comma": (
        changed(4, "force_n", "0,15"),
        r"row 4 \(line 5\): found 13 cells, expected 12.*write numbers with '.'",
    ),
    "a row cut short": ([*LINES[:7], LINES[7][:20]], r"row 7 \(line 8\): found \d cells"),
    "semicolons": ([line.replace(",", ";") for line in LINES], r"line 1: found ';' between"),
    "tabs": ([line.replace(",", "\t") for line in LINES], r"line 1: found tabs between"),
    "a time that is empty once": (changed(3, "time_s", ""), r"row 3 .*time_s.*whole column empty"),
    "a time that falls": (changed(3, "time_s", "0.1"), r"row 3 .*time_s: found 0.1 s after 0.25 s"),
    "a time that stands still": (changed(3, "time_s", "0.25"), r"row 3 .*found 0.25 s after 0.25"),
    "a direction that is not unit": (scaled("nz", 1.01), r"row 1 .*nx, ny, nz: found a length of"),
    "a quaternion that is not unit": (
        with_columns(QUATERNION, "0,0,0,1,0.1,0,0"),
        r"row 1 .*tip_qw.*found a length of 1.004",
    ),
    "a press of one sample": (
        [*LINES[:23], LINES[23], *LINES[45:]],
        r"row 23 \(line 24\), column press: press 1 has 1 sample .*at least 2",
    ),
    "a press of approach rows only": (
        [*LINES[:23], *(line.replace("load", "approach") for line in LINES[23:25]), *LINES[45:]],
        r"row 23 .*press 1 has 0 samples",
    ),
    "a press id that is not whole": (changed(2, "press", "0.5"), r"row 2 .*press: found 0.5"),
    "a negative press id": (changed(1, "press", "-1"), r"row 1 .*press: found -1"),
    "press ids out of order": (
        [LINES[0], *LINES[23:45], *LINES[1:23]],
        r"row 23 .*press: found 0 after 1.*sort the rows",
    ),
    "an unknown phase": (changed(2, "phase", "laod"), r"row 2 .*phase: found 'laod'.*is 'load'"),
    "forces of the wrong sign": (scaled("force_n", -1), r"force_n: .*change the sign of force_n"),
    "displacements of the wrong sign": (
        scaled("displacement_m", -1),
        r"displacement_m: .*change the sign of displacement_m",
    ),
    "one press of the wrong sign": (
        [
            *LINES[:45],
            *(
                re.sub(r",(-?[\d.]+),(-?[\d.]+),0.005$", r",-\1,\2,0.005", line)
                for line in LINES[45:61]
            ),
        ],
        r"press 2 \(1 of 3 presses are like this\).*correct or remove this press",
    ),
    "forces in grams": (scaled("force_n", 101.97), r"force_n: found 3\d\.\d* N.*looks like grams"),
    "forces in millinewtons": (scaled("force_n", 1000), r"force_n: .*millinewtons"),
    "points in millimetres": (scaled("x_m", 1000), r"x_m: found 30 m.*looks like millimetres"),
    "heights in millimetres": (scaled("z_m", 1000), r"z_m: found 48 m.*looks like millimetres"),
    "travel in millimetres": (scaled("displacement_m", 1000), r"displacement_m: .*millimetres"),
    "a radius in millimetres": (scaled("probe_radius_m", 1000), r"probe_radius_m: .*millimetres"),
    "no force at all": (scaled("force_n", 0), r"column force_n: found 0 in all rows"),
    "no travel at all": (scaled("displacement_m", 0), r"column displacement_m: found 0 in all"),
    "a radius of zero": (scaled("probe_radius_m", 0), r"row 1 .*probe_radius_m: found 0 m"),
    "a negative radius": (scaled("probe_radius_m", -1), r"row 1 .*probe_radius_m: found -0.005"),
    "a contact point that moves": (
        changed(7, "x_m", "0.013"),
        r"row 7 .*x_m: found 0.013 after 0.012 inside press 0",
    ),
    "a tip that changes inside a press": (
        changed(7, "probe_radius_m", "0.004"),
        r"row 7 .*probe_radius_m: found 0.004",
    ),
    "a header alone": (LINES[:1], r"a header and no rows"),
    "blank lines alone": (["", "  "], r"the file is blank"),
    "a stray quotation mark": (changed(2, "phase", '"load'), r"found text that is not CSV"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_table_is_refused_with_its_place(case, tmp_path):
    lines, sentence = BAD[case]
    path = tmp_path / "scan.csv"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=sentence) as caught:
        read_scan(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_displacement_that_falls_while_force_rises_is_refused(tmp_path):
    rows = [line.split(",") for line in LINES[1:]]
    for cells in rows:
        cells[column("displacement_m")] = repr(0.01 - float(cells[column("displacement_m")]))
    path = tmp_path / "scan.csv"
    path.write_text("\n".join([LINES[0], *(",".join(cells) for cells in rows)]))
    with pytest.raises(InputError, match="falls while force_n rises, in 3 of 3 presses"):
        read_scan(path)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_comments_at_the_top_are_skipped_and_counted(end, tmp_path):
    path = tmp_path / "scan.csv"
    top = ['# recorded "2026", by hand', "", '#"', *LINES]
    path.write_bytes(end.join(top).encode())
    plain = tmp_path / "plain.csv"
    plain.write_text("\n".join(LINES))
    np.testing.assert_array_equal(read_scan(path).force_n, read_scan(plain).force_n)
    path.write_bytes(end.join(["# one", *changed(5, "force_n", "x")]).encode())
    with pytest.raises(InputError, match=r"row 5 \(line 7\), column force_n"):
        read_scan(path)


def test_the_line_number_counts_blank_lines_too(tmp_path):
    path = tmp_path / "scan.csv"
    bad = changed(5, "force_n", "x")
    path.write_text("\n".join([bad[0], "", "", *bad[1:]]))
    with pytest.raises(InputError, match=r"row 5 \(line 8\), column force_n"):
        read_scan(path)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file is empty"),
        ("\n".join(LINES).encode("utf-16"), r"line 1: found the byte 0xff, expected UTF-8"),
        (("\n".join(LINES[:3]) + "\nunlädt").encode("latin-1"), r"line 4: found the byte 0xe4"),
    ],
)
def test_bytes_that_are_not_text_are_refused(data, sentence, tmp_path):
    path = tmp_path / "scan.csv"
    path.write_bytes(data)
    with pytest.raises(InputError, match=sentence):
        read_scan(path)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("missing.csv", "no such file"),
        ("scan.xlsx", r"found the ending '.xlsx', expected .csv or .parquet"),
    ],
)
def test_a_path_that_holds_no_scan_is_refused(name, sentence, tmp_path):
    with pytest.raises(InputError, match=sentence):
        read_scan(tmp_path / name)


def test_a_folder_is_refused(tmp_path):
    (tmp_path / "scan.csv").mkdir()
    for path in (tmp_path / "scan.csv", tmp_path):
        with pytest.raises(InputError, match="a folder, expected a scan"):
            read_scan(path)


def test_a_parquet_file_named_csv_is_refused(tmp_path):
    write_scan(read_scan(CASE_A), tmp_path / "scan.parquet")
    path = (tmp_path / "scan.parquet").rename(tmp_path / "scan.csv")
    with pytest.raises(InputError, match=r"found a Parquet file, expected text; name it .parquet"):
        read_scan(path)


def test_a_parquet_file_that_is_cut_off_is_refused(tmp_path):
    path = tmp_path / "scan.parquet"
    write_scan(read_scan(CASE_A), path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="not Parquet or is cut off"):
        read_scan(path)


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("force_n", pa.nulls(1782, pa.float64()), r"row 1, column force_n: found nan"),
        ("force_n", pa.array(["x"] * 1782), r"row 1, column force_n: found 'x'"),
        ("force_n", pa.array([True] * 1782), r"column force_n: found values of type bool"),
        ("phase", pa.array(np.zeros(1782)), r"column phase: found values of type double"),
    ],
)
def test_a_parquet_column_of_the_wrong_kind_is_refused(name, values, sentence, tmp_path):
    path = tmp_path / "scan.parquet"
    write_scan(read_scan(CASE_A), path)
    table = pq.ParquetFile(path).read()
    pq.write_table(table.set_column(table.column_names.index(name), name, values), path)
    with pytest.raises(InputError, match=sentence):
        read_scan(path)


def test_a_newer_parquet_schema_is_refused(tmp_path):
    path = tmp_path / "scan.parquet"
    write_scan(read_scan(CASE_A), path)
    table = pq.ParquetFile(path).read()
    pq.write_table(table.replace_schema_metadata({b"palpmap.scan_schema": b"2"}), path)
    with pytest.raises(InputError, match="found scan schema 2, expected at most 1; update"):
        read_scan(path)


@pytest.mark.parametrize(
    "lines", [scaled("force_n", 101.97), scaled("displacement_m", 1000), scaled("x_m", 1000)]
)
def test_sizes_that_a_user_has_confirmed_are_taken_as_they_stand(lines, tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("\n".join(lines))
    assert len(read_scan(path, units_checked=True)) == 66
