"""Several scans of one body as one: numbered on, in one clock, nothing lost in silence."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from typer.testing import CliRunner

from models.errors import InputError
from models.scan import Scan
from models.scan_file import read_scan, write_scan
from models.scan_join import join_scans
from palpmap.__main__ import app

RUN = CliRunner()


def table(begin_s: float | None = 0.0, ids=(0, 1), **more) -> Scan:
    """Return a scan of two presses, three rows each."""
    m = 3 * len(ids)
    time = np.full(m, np.nan) if begin_s is None else begin_s + np.arange(m)
    return Scan(
        press=np.repeat(ids, 3),
        time_s=time,
        phase=np.array(["load", "hold", "unload"] * len(ids)),
        point_m=np.repeat(np.arange(float(len(ids))), 3)[:, None] * [0.01, 0.0, 0.0],
        direction=np.tile([0.0, 0.0, -1.0], (m, 1)),
        force_n=np.linspace(0.1, 0.2, m),
        displacement_m=np.linspace(1e-3, 2e-3, m),
        probe_radius_m=np.full(m, 0.005),
        **more,
    )


def test_presses_are_numbered_on_and_every_row_is_there():
    first, second, third = table(0.0, (3, 7)), table(10.0, (0, 1)), table(20.0, (5,))
    joined, left_out = join_scans([first, second, third], ["a", "b", "c"])
    assert joined.press_ids.tolist() == [3, 7, 8, 9, 10]
    assert_array_equal(joined.force_n, np.concatenate([s.force_n for s in (first, second, third)]))
    assert_array_equal(joined.time_s, np.r_[0:6, 10:16, 20:23])
    assert left_out == ()


def test_gaps_of_presses_left_out_stay_in_every_scan():
    joined, _ = join_scans([table(0.0, (3, 7)), table(10.0, (2, 4)), table(20.0)], list("abc"))
    assert joined.press_ids.tolist() == [3, 7, 8, 10, 11, 12]


@pytest.mark.parametrize(
    ("other", "says"),
    [
        ({"travel_from": "plane"}, "b: has travel from plane, expected touch as a"),
        ({"travel_from": ""}, "b: has travel from unknown, expected touch as a"),
        ({"frame_m": (0.1, 0.0, 0.0)}, r"b: has a frame with its origin at \(0.1, 0.0, 0.0\)"),
    ],
)
def test_scans_of_unlike_travel_or_frame_are_refused(other, says):
    first = table(travel_from="touch")
    with pytest.raises(InputError, match=says):
        join_scans([first, table(9.0).replace(**{"travel_from": "touch"} | other)], ["a", "b"])
    joined, _ = join_scans([first, table(9.0, travel_from="touch")], ["a", "b"])
    assert joined.travel_from == "touch"


def test_a_clock_that_was_set_back_needs_a_pause():
    with pytest.raises(InputError, match=r"b: its clock begins at 2 s.*later than 5 s.*--pause"):
        join_scans([table(), table(2.0)], ["a", "b"])
    joined, _ = join_scans([table(), table(2.0), table(0.0)], list("abc"), 60.0)
    assert_allclose(joined.time_s, np.r_[0:6, 65:71, 130:136])


def test_scans_without_times_go_together_but_not_with_others():
    joined, _ = join_scans([table(None), table(None)], ["a", "b"])
    assert not joined.has_time
    with pytest.raises(InputError, match="a has times and b has none"):
        join_scans([table(), table(None)], ["a", "b"])


def test_columns_that_only_one_has_are_left_out_and_said(tmp_path):
    vector = np.ones((6, 3))
    joined, left_out = join_scans([table(force_vector_n=vector), table(9.0)], ["a", "b"])
    assert joined.force_vector_n is None
    assert left_out == ("fx_n, fy_n, fz_n",)
    kept, left_out = join_scans([table(force_vector_n=vector)] * 2, ["a", "b"], 1.0)
    assert kept.force_vector_n is not None
    assert left_out == ()


def test_the_command_writes_one_scan_and_overwrites_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_scan(table(force_vector_n=np.ones((6, 3))), "a.csv")
    write_scan(table(), "b.parquet")
    done = RUN.invoke(app, ["join", "a.csv", "b.parquet", "--out", "both.csv", "--pause", "30"])
    assert done.exit_code == 0, done.output
    assert "4 presses, 12 rows in both.csv" in done.output
    assert "Left out, as not every scan has them: fx_n" in done.output
    assert read_scan("both.csv").time_s[6] == 35.0
    before = Path("both.csv").read_bytes()
    for words, says in (
        (["a.csv", "b.parquet", "--out", "both.csv"], "both.csv: is already there"),
        (["a.csv", "--out", "c.csv"], "found 1 scan, expected two or more"),
        (["a.csv", "b.parquet", "--out", "c.csv"], "say with --pause"),
        (["a.csv", "none.csv", "--out", "c.csv"], "none.csv: no such file"),
        (["a.csv", "a.csv", "--out", "c.csv", "--pause", "9"], "same readings as a.csv"),
    ):
        refused = RUN.invoke(app, ["join", *words])
        assert refused.exit_code == 2
        assert says in " ".join(refused.stderr.split())
    assert Path("both.csv").read_bytes() == before
