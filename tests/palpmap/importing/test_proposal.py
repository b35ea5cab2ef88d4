"""A proposed mapping says what it does not know: clocks, travels, units and cells."""

import re

import pytest

from models.errors import InputError
from palpmap.importing.propose import propose_rig
from palpmap.importing.readers.read import read_recording


@pytest.fixture
def proposal(tmp_path):
    """Proposal for twelve readings of three presses, with other headers or other cells."""

    def propose(change=lambda row, cells: cells, **names):
        header = {"press": "press", "time": "time_s", "x": "x_mm", "y": "y_mm", "z": "z_mm",
                  "force": "force_N", "travel": "travel_mm"} | names  # fmt: skip
        rows = [",".join(header.values())]
        for i in range(12):
            cells = {"press": i // 4, "time": f"{0.125 * i}", "x": 12 * (i // 4), "y": 5, "z": 48,
                     "force": 0.1 * (i % 4 + 1), "travel": 1.5 * (i % 4 + 1)}  # fmt: skip
            rows.append(",".join(map(str, change(i, cells).values())))
        path = tmp_path / "run.csv"
        path.write_text("\n".join(rows) + "\n")
        return propose_rig(read_recording([path]))

    return propose


@pytest.mark.parametrize(
    ("name", "clock"),
    [("time", "10:00:{:06.3f}"), ("Datum", "01.03.2026 10:00:{:06.3f}"),
     ("Uhrzeit", "2026-03-01 10:00:{:06.3f}")],
)  # fmt: skip
def test_a_clock_of_text_is_the_time(name, clock, proposal):
    text = proposal(lambda i, cells: cells | {"time": clock.format(0.125 * i)}, time=name)
    assert f'[time]\ncolumn = "{name}"' in text


def test_a_clock_that_is_not_read_is_said(proposal):
    text = proposal(lambda i, cells: cells | {"time": f"10h 0m {i}"}, time="time")
    assert "\n[time]" not in text
    assert re.search(r"# \[time\] .*line 2, time: found '10h 0m 0'.*seconds, or dates", text)


def test_presses_without_a_travel_are_said(proposal):
    text = proposal(travel="reached_mm")
    assert "'press' numbers the presses, but no column looks like travel" in text


@pytest.mark.parametrize(("key", "name"), [("force", "force_N"), ("travel", "travel_mm")])
def test_a_cell_that_hides_a_column_is_named(key, name, proposal):
    with pytest.raises(InputError, match=rf"run.csv, line 7, {name}: found 'OVERFLOW'"):
        proposal(lambda i, cells: cells | ({key: "OVERFLOW"} if i == 5 else {}))


@pytest.mark.parametrize(
    ("names", "unit"),
    [({"travel": "Travel[mil]"}, "mil"), ({"force": "force [dyn]"}, "dyn"),
     ({"force": "force_V"}, "V"), ({"travel": "travel / feet"}, "feet")],
)  # fmt: skip
def test_a_unit_that_is_not_known_is_said(names, unit, proposal):
    text = proposal(**names)
    assert f"the unit '{unit}' is none of" in text
    assert "no unit stated" not in text


def test_presses_that_are_numbered_by_their_places_are_readings(proposal):
    text = proposal(lambda i, cells: cells | {"press": (7, 2, 5)[i // 4]})
    assert 'kind = "readings"' in text
    assert '[press]\nnumber = "press"' in text


def test_a_column_of_the_tips_radius_is_found_and_what_has_no_use_is_said(proposal):
    text = proposal(lambda i, cells: cells | {"travel": f"1.5,{4 + i // 6}"}, travel="d_mm,R_mm")
    assert '[radius]\ncolumn = "R_mm"' in text
    assert "Not used" not in text
    text = proposal(lambda i, cells: cells | {"travel": f"1.5,{8 + i // 6}"}, travel="d_mm,wide_mm")
    assert "\n# Not used: wide_mm\n" in text


def test_a_column_of_the_bodys_width_hides_no_contact_points(proposal):
    text = proposal(lambda i, cells: cells | {"more": 40 + i}, more="w_mm")
    assert 'columns = ["x_mm", "y_mm", "z_mm"]' in text
    assert "# Not used: w_mm" in text
    turned = proposal(lambda i, cells: cells | {"more": 0, "x": 0, "y": 0, "z": 1}, more="w_mm")
    assert "columns = [" not in turned.replace("# columns", "")  # of unit length: a quaternion
