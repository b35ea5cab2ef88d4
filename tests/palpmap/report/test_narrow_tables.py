"""Tables as a terminal of 80 columns shows them: no word cut, no name broken within a word."""

import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from identify.design import UndetectedBias
from identify.fit import Area, Spot
from identify.map import GaussianMap, Inclusion, parameter_space
from palpmap.report.draw import console
from palpmap.report.limits_console import limits_screen
from palpmap.result.field_tables import _area_table, _open, _rim, _spot_table
from palpmap.result.records import LimitRecord, LimitsRecord, ParameterRecord
from palpmap.result.tables import Table, number, parameter_table


def test_no_word_of_the_table_of_spots_is_cut_in_a_terminal_of_80_columns():
    size = {"diameter_lower95_m": 0.008, "diameter_upper95_m": 0.012}
    spots = [
        Spot(-0.0384, 0.0398, -0.0574, 3e-4, 0.01, 0.01, 24.03, 11.58, 51.24, 0.999, 0.9, **size),
        Spot(-0.0192, 0.1436, -0.1574, 2e-3, 0.01, 0.01, 0.7, 0.17, 2.35, 0.6, 0.9,
             **(size | {"diameter_lower95_m": 0.0})),
        Spot(-0.0192, 0.1436, -0.1574, 2e-3, 0.01, 0.01, 0.7, 0.17, 2.35, 0.6, 0.9),
    ]  # fmt: skip
    out = io.StringIO()
    Console(file=out, width=80).print(console(_spot_table(spots, True, True, np.zeros(3))))
    hard, soft, old = (line.split() for line in out.getvalue().splitlines()[-4:-1])
    assert hard[:5] == ["hard", "-38.4,", "39.8,", "-57.4", "0.3"]
    assert hard[5:] == ["8", "to", "12", "24", "(12", "to", "51)", ">", "0.99"]
    assert soft[5:] == ["at", "most", "12", "0.7", "(0.17", "to", "2.4)", "0.60"]
    assert old[5:] == ["10", "0.7", "(0.17", "to", "2.4)", "0.60"]  # of a file without interval
    assert "Probability" in out.getvalue()
    assert "+- mm" in out.getvalue()


def test_a_table_of_areas_fits_a_terminal_of_80_columns_and_counts_those_beyond_the_first():
    area = Area(-0.1384, 0.1398, -0.0574, 0.0442, 0.0095, 138, 1.0853, 1.0742, 1.0961, False)
    rim = Area(-0.1384, 0.1398, -0.0574, 0.0442, 0.0095, 38, 0.853, 0.8442, 0.861, True)
    table = _area_table([area, *[rim] * 7], True, np.array([0.0, 0.0, 0.1]))
    out = io.StringIO()
    Console(file=out, width=80).print(console(table))
    line = next(row for row in out.getvalue().splitlines() if "hard area" in row)
    assert line.split()[:7] == ["hard", "area", "-138.4,", "139.8", "44", "x", "10"]
    assert "1.09 (1.07 to 1.1)" in out.getvalue()
    assert "and 2 more" in out.getvalue()
    assert (table.rows[0][0].tone, table.rows[1][0].tone) == ("good", "dim")
    assert _area_table([area], False, np.zeros(3)).rows[0][0].tone == "dim"


def test_a_wide_spot_has_its_depth_size_and_contrast_open():
    ball = (-0.0384, 0.0398, -0.0574, 3e-4, 0.03, 0.01, 24.03, 11.58, 51.24, 0.999, 0.2)
    cells = [
        _spot_table([Spot(*ball, least, 0.036, wide=True)], True, True, np.zeros(3)).rows[0]
        for least in (0.03, 0.0)
    ]
    assert cells[0][1].text == "-38.4, 39.8, open"
    assert [row[3].text for row in cells] == ["over 30", "open"]
    assert cells[0][4].text == "open"
    assert cells[0][0].tone != "good"
    wide, radii = [Spot(*ball, 0.03, 0.036, wide=True)], np.array([0.003, 0.003, 0.006])
    assert "or press with a second tip" in _open(wide, radii[:2])[1]
    assert "second tip" not in _open(wide, radii)[1]  # which the scan has


def test_no_spot_is_shown_as_sure_beside_a_residual_that_is_not_noise():
    spot = Spot(-0.0384, 0.0398, -0.0574, 3e-4, 0.01, 0.01, 24.03, 11.58, 51.24, 0.999, 0.9)
    tones = {
        explained: [cell.tone for cell in table.rows[0]]
        for explained in (True, False)
        for table in [_spot_table([spot], True, explained, np.zeros(3))]
    }
    assert "good" in tones[True]
    assert "good" not in tones[False]


@pytest.mark.parametrize("unseen", [False, True])
def test_parameters_keep_their_words_in_a_terminal_of_80_columns(unseen):
    def row(value: float, unit: str, at_bound: bool = False) -> ParameterRecord:
        low, high, std = 0.99 * value, 1.01 * value, 0.005 * value
        return ParameterRecord(
            value=value, std=std, unit=unit, lower95=low, upper95=high, at_bound=at_bound
        )  # fmt: skip

    found = {
        "inclusion_1.radius_m": row(0.00999, "m"),
        "touch_threshold.threshold_n": row(0.0867, "N"),
        "tool_compliance.compliance_m_per_n": row(1e-4, "m/N", at_bound=True),
    }
    shifts = {
        name: UndetectedBias(p.std, "preconditioning_nearby", 0.03) for name, p in found.items()
    }
    out = io.StringIO()
    table = parameter_table(found, unseen=shifts if unseen else {})
    Console(file=out, width=80).print(console(table))
    words = set(out.getvalue().split())
    assert {"inclusion", "radius", "touch_threshold.", "tool_compliance."} <= words
    assert {"threshold_n", "compliance_m_per_n", "9.89", "10.09", "mm", "0.1010", "mm/N"} <= words
    assert {"at", "its", "bound", "mN"} <= words
    assert not unseen or {"(preconditioning_", "nearby)"} <= words


@pytest.mark.parametrize("width", range(70, 90))
def test_nothing_is_cut_however_wide_the_terminal_is(width):
    rows = [
        ("strain_stiffening.b", "0.432", "0.394 to 0.470", "± 0.49 (free_saturation)"),
        ("touch_threshold.threshold_n", "87 mN", "70 to 88 mN", "± 12 mN (force_bias)"),
    ]
    head = ("Parameter", number("Found"), number("95 % interval"), "Unseen effect")
    out = io.StringIO()
    Console(file=out, width=width).print(console(Table.of(head, rows)))
    shown = sorted(character for character in out.getvalue() if character not in " \n─")
    assert shown == sorted("".join(["".join(row) for row in rows] + _texts(head)).replace(" ", ""))


def _texts(head) -> list[str]:
    return [getattr(column, "heading", column) for column in head]


def test_sure_spots_that_the_presses_do_not_reach_around_are_named_in_the_scan_s_frame():
    def spot(x_m, at_rim, probability=0.99) -> Any:
        return SimpleNamespace(x_m=x_m, y_m=0.01, probability=probability, at_rim=at_rim)

    inside, cut, unsure = spot(0.02, False), spot(0.004, True), spot(0.05, True, 0.6)
    name, says = _rim([inside, cut, unsure], np.array([0.1, 0, 0]))
    assert name == "at the rim"
    assert "(104.0, 10.0) mm" in says
    assert "120" not in says
    assert "150" not in says
    assert _rim([inside, unsure], np.zeros(3)) == ()


def test_limits_count_what_is_seen_and_leave_a_shift_beyond_the_body_open():
    start = GaussianMap(5e3, [Inclusion(2e3, 0.05, 0.05, 0.02, 0.01)])
    box = np.array([[0, 0, 0], [0.096, 0.096, 0.048]])
    fit: Any = SimpleNamespace(
        values=dict(zip(start.names, start.values.tolist(), strict=True)),
        model=SimpleNamespace(space=parameter_space(start, box)),
    )
    rest: Any = dict(
        shape={}, sizes={}, visible=1.0, confused_with=(), bias_at_share=0.03, untestable=None,
        better_scan=None, in_mixed_scan=None,
    )  # fmt: skip
    shift = {"background_pa": 50.0, "inclusion_1.weight_pa": 200.0, "inclusion_1.z_m": -25.6}
    limits = (
        LimitRecord(name="a", smallest_share=0.05, largest_share=None, map_bias=shift, **rest),
        LimitRecord(name="b", smallest_share=None, largest_share=0.01, map_bias={}, **rest),
    )
    out = io.StringIO()
    for one in limits_screen(LimitsRecord(limits=limits, mixed_scan=None), fit):
        Console(file=out, width=80).print(one)
    said = out.getvalue()
    assert "shows 1 of 2 effects" in said
    assert next(line for line in said.splitlines() if " a " in line).split()[-3:] == [
        "+1.0", "+10", "-",
    ]  # fmt: skip
    assert "-: not determined" in said
    assert "25600" not in said
