"""Raw streams of a made-up rig are cut into their presses, or it is said which are left out."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from models.errors import InputError
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.readers.recording import Recording, Table
from palpmap.importing.streams.clocks import rough_offsets
from palpmap.importing.streams.cutting import cut_stream
from palpmap.importing.streams.lag import WITHIN_2_MS, find_lag
from palpmap.importing.streams.path import smooth_path
from palpmap.importing.streams.stream import Stream, ordered, without_jumps
from tests.long import long
from tests.palpmap.importing.raw_streams import RIG, outcome

QUICK, ALL = (1, 6, 9), range(500)
LAG_S = 0.002
INFORMS_S = 1e-3
"""Bound of the lag's standard deviation below which 2 ms are asked for."""


@pytest.mark.parametrize("seed", QUICK)
def test_a_stream_is_cut_and_its_lag_found(seed):
    found = outcome(seed)
    assert found.refused == ""
    assert found.silent == []
    assert found.lost == []
    assert found.seen
    assert abs(found.off_s) < max(LAG_S, 3 * found.stated_s)


@pytest.mark.parametrize("seed", [445, *long(127, 477, 6198, 6457, 6462)])
def test_what_once_hid_a_touch_does_so_no_longer(seed):
    assert outcome(seed).silent == []


@pytest.mark.parametrize("seed", [13067, *long(12066, 20124, 20347)])
def test_almost_even_presses_a_re_tare_before_a_touch_or_a_far_start_lose_no_press(seed):
    assert outcome(seed).wrong == 0


def test_the_lag_of_presses_faster_than_the_average_over_them_is_said_to_be_unsure():
    found = outcome(98)
    assert found.stated_s > WITHIN_2_MS
    assert abs(found.off_s) < 3 * found.stated_s


def rhythmic(uneven_s: float) -> Recording:
    """Ten presses on two clocks, 300 s apart, of which the pose's begins and ends in the pause."""
    rng = np.random.default_rng(7)
    begins = 5.0 * np.arange(10) + uneven_s * rng.uniform(-1, 1, 10)
    time = np.arange(-2.0, 49.0, 0.01)
    away = np.abs(time[:, None] - begins - 1.0).min(axis=1)
    depth = 4e-3 * np.clip(2.0 - 2.0 * away, 0.0, 1.0)
    noise = rng.standard_normal((len(time), 4))
    pose = {"t_s": time - 300.0, "x_mm": 0 * time, "y_mm": 0 * time}
    pose |= {"z_mm": 40 - 1e3 * depth + 0.005 * noise[:, 3]}
    pose |= {name: 0 * time + (name == "qw") for name in ("qx", "qy", "qz", "qw")}
    force = -400 * np.maximum(depth - 2e-3, 0.0)[:, None] * [0, 0, 1] + 0.003 * noise[:, :3]
    columns = dict(zip(("Fx_N", "Fy_N", "Fz_N"), force.T, strict=True))
    return Recording.of(
        [Table("ft", {"time_s": time, **columns}, {}, str), Table("pose", pose, {}, str)]
    )


def test_two_clocks_are_brought_together_by_presses_that_are_not_quite_in_rhythm():
    cut = cut_stream(rhythmic(0.1), parse_rig(RIG, Path("rig.toml")))
    assert cut.streams.offset_s + cut.streams.lag.lag_s == pytest.approx(300.0, abs=0.01)


def test_presses_in_an_exact_rhythm_leave_the_offset_of_two_clocks_to_be_stated():
    with pytest.raises(InputError, match=r"key pose.clock_offset_s: .* fit alike"):
        cut_stream(rhythmic(0.0), parse_rig(RIG, Path("rig.toml")))


STAGE = """
kind = "stream"
time = {column = "t_s", unit = "s"}
press = {direction = "travel"}
force = {column = "force_n", unit = "N"}
pose = {columns = ["x_mm", "y_mm", "z_mm"], unit = "mm"}
probe = {tip = "flat", radius_m = 0.005}
body = {shape = "block", size_m = [0.1, 0.1, 0.048], poisson_ratio = 0.49}
"""


def of_a_stage(hz: float, stairs_mm: float = 0.0, noise_n: float = 0.003) -> Recording:
    """Sixteen presses of a stage that reports where it is to the last digit, with rests.

    `stairs_mm` : height of the steps in which it goes, if it does
    """
    rng, rows, begin = np.random.default_rng(1), [], 0.0
    for x, y in np.ndindex(4, 4):
        along = [[0, -3], [5, 2], [6, 2], [11, -3], [12, -3]]
        time = np.arange(0.0, 13.0, 1 / hz)
        depth = np.interp(time, *np.transpose(along))
        if stairs_mm:
            depth = stairs_mm * np.round(depth / stairs_mm)
        force = np.maximum(depth, 0.0) / 8 + rng.normal(0.0, noise_n, len(time))
        place = 20.0 * np.array([x + 1, y + 1])[:, None] + 0 * time
        rows.append(np.vstack([begin + time, place, 48 - depth, force]))
        begin += 13.0
    names = ("t_s", "x_mm", "y_mm", "z_mm", "force_n")
    return Recording.of([Table("log", dict(zip(names, np.hstack(rows), strict=True)), {}, str)])


def test_rows_without_a_number_are_counted_once():
    values = np.arange(200.0)[:, None]
    values[[20, 50, 120], 0] = np.nan, np.inf, np.nan
    time, said = np.delete(np.arange(200.0), 80), []
    stream = ordered(time, np.delete(values, 80, axis=0), "force", said)
    assert len(stream.time_s) == 196
    assert said[0] == "force: 3 rows were left out, with a cell that is empty or no finite number."
    assert "about 1 of 197 messages are missing" in said[1]


@pytest.mark.parametrize(("hz", "stairs_mm"), [(5, 0.0), (10, 0.0), (100, 0.0), (50, 0.2)])
def test_a_log_of_a_stage_that_stands_still_is_cut(hz, stairs_mm):
    cut = cut_stream(of_a_stage(hz, stairs_mm), parse_rig(STAGE, Path("rig.toml")))
    assert len(cut.presses) == 16
    for press in cut.presses:
        assert "hold" in press.phase
        assert abs(press.point_m[2] - 0.048) < 3 * press.touch_error_m
        off = press.force_n - 125 * press.displacement_m
        assert abs(off.mean()) < 3 * (0.003 / 6**0.5 + 125 * press.touch_error_m)


def test_columns_of_one_table_have_one_clock_however_well_another_offset_fits():
    table = of_a_stage(50).tables[0].columns
    time, none = table["t_s"], np.zeros((0, 2))
    position = 1e-3 * np.column_stack([table[name] for name in ("x_mm", "y_mm", "z_mm")])
    late = Stream(time, np.roll(table["force_n"], 250)[:, None], none)  # by 5 s
    offsets = [one.offset_s for one in rough_offsets(late, Stream(time, position, none), None)]
    assert offsets
    assert np.abs(offsets).max() <= 0.5
    others = rough_offsets(late, Stream(time + 0.003, position, none), None)
    assert abs(others[0].offset_s) > 0.5


def test_noise_at_the_threshold_of_contact_is_no_second_touch():
    recording = of_a_stage(100, noise_n=0.010)  # a 25th of the force
    cut = cut_stream(recording, parse_rig(STAGE, Path("rig.toml")))
    assert len(cut.presses) + len(cut.left_out) == 16
    assert len(cut.presses) >= 4
    assert not any("more than once" in reason for _, reason in cut.left_out)


def test_a_pose_that_froze_in_motion_is_a_gap_and_its_press_left_out():
    recording = of_a_stage(100)
    pose = recording.tables[0].columns
    frozen = slice(360, 400)  # 0.4 s of the first press's way in
    for name in ("x_mm", "y_mm", "z_mm"):
        pose[name][frozen] = pose[name][360]
    cut = cut_stream(recording, parse_rig(STAGE, Path("rig.toml")))
    assert len(cut.presses) == 15
    assert "of the pose are missing" in cut.left_out[0][1]


def test_the_size_of_a_re_tare_is_known_to_a_fraction_of_the_noise():
    rng = np.random.default_rng(8)
    time, off = 0.002 * np.arange(1200), []
    for _ in range(30):
        at, size = int(rng.integers(500, 700)), rng.uniform(0.3, 1.0)
        force = 0.01 * rng.standard_normal((1200, 1)) + 0.02 * time[:, None]
        force[at:] += size
        found = without_jumps(Stream(time, force, np.zeros((0, 2))))[0].values[:, 0]
        off.append(np.polyfit(time, found, 1)[0] - 0.02)  # a step that stays tilts the line
    assert np.std(off) * time[-1] / 1.5 < 0.3 * 0.01


@pytest.mark.slow
def test_of_500_streams_the_presses_are_found_and_their_readings_right():
    """Tuned on these seeds; fresh ones were counted once, see docs/import.md."""
    outcomes = [outcome(seed) for seed in ALL]
    assert [one for one in outcomes if one.silent] == []
    assert sum(bool(one.refused) for one in outcomes) <= 2
    cut = [one for one in outcomes if not one.refused]
    assert sum(not one.seen for one in cut) <= 2  # the page says so, and each touch counts it
    assert sum(one.wrong for one in outcomes) <= 0.01 * sum(one.presses for one in outcomes)
    off, stated_s, sharp, bound = np.array(
        [(abs(one.off_s), one.stated_s, one.sharp, one.bound_s) for one in cut]
    ).T
    assert np.mean(off < 2 * stated_s) >= 0.95
    assert np.mean(off < 3 * stated_s) >= 0.99
    assert np.mean(off[stated_s <= WITHIN_2_MS] < LAG_S) >= 0.99
    assert np.mean(off[(bound < INFORMS_S) & (sharp > 0)] < LAG_S) >= 0.95


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_viscosity_is_not_mistaken_for_a_lag(share):
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 3.0, 0.01)
    travel = 5e-3 * np.clip(np.minimum(time - 0.3, 1.5 * (2.7 - time)), 0.0, 1.0)
    fading = lfilter([1.0], [1.0, -np.exp(-0.01 / 0.4)], np.diff(travel, prepend=0.0))
    force = 60 * ((1 - share) * travel + share * fading)
    count, noise = 30, 1e-5
    forces = [force + 0.003 * rng.standard_normal(len(time)) for _ in range(count)]
    travels = [travel + noise * rng.standard_normal(len(time)) for _ in range(count)]
    lag = find_lag([time + 0.02] * count, forces, [time] * count, travels, noise * np.sqrt(0.01))
    assert lag is not None
    assert lag.has_corners
    assert lag.error_s < 1.5e-3
    assert lag.lag_s == pytest.approx(0.02, abs=3 * lag.error_s)


def test_a_smoothed_path_loses_noise_and_keeps_its_corners():
    rng = np.random.default_rng(6)
    time = np.arange(0.0, 4.0, 0.008)
    true = np.zeros((len(time), 3))
    true[:, 2] = -4e-3 * np.clip(time - 1.0, 0.0, 1.0)
    noise = 2e-5 * rng.standard_normal(true.shape)
    found = smooth_path(Stream(time, true + noise, np.zeros((0, 2))))
    off = found.values - np.column_stack(
        [np.interp(found.time_s, time, column) for column in true.T]
    )
    assert np.std(off[:, 2]) < 0.5 * 2e-5
    corner = np.abs(found.time_s - 1.0) < 0.1
    assert np.abs(off[corner, 2]).max() < 6e-5


def at_a_limit(recording: Recording, least_n: float, most_n: float, noise_n: float) -> Recording:
    """Force of a sensor with limits, and noise behind it; none where it is exactly constant."""
    force = recording.tables[0].columns["force_n"]
    noise = noise_n * np.random.default_rng(3).standard_normal(len(force))
    force[:] = np.clip(force, least_n, most_n) + noise
    return recording


@pytest.mark.parametrize("noise_n", [0.0, 0.003])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_sensor_at_its_limit_is_named_and_tells_neither_lag_nor_stiffness(noise_n, sign):
    recording = of_a_stage(100)
    recording.tables[0].columns["force_n"] *= sign
    recording = at_a_limit(recording, -0.18, 0.18, noise_n)
    rig = STAGE.replace('unit = "N"', f'unit = "N", sign = {sign}')
    cut = cut_stream(recording, parse_rig(rig, Path("rig.toml")))
    assert len(cut.presses) == 16
    (sentence,) = [one for one in cut.said if "limit" in one]
    assert "in 16 of 16 presses: 'force_n' stays at 0.18 N" in sentence.replace("0.181", "0.18")
    assert abs(cut.streams.offset_s + cut.streams.lag.lag_s) < 2 * cut.streams.lag_error_s
    for press in cut.presses:
        assert set(press.phase) == {"load"}
        assert press.force_n.max() < 0.181
        late_n = 125e-3 * cut.streams.lag_error_s * 2 / 5  # of a tip at 1 mm/s
        off = press.force_n - 125 * press.displacement_m
        assert abs(off.mean()) < 3 * (0.003 / 6**0.5 + 125 * press.touch_error_m + late_n)


def test_one_press_at_the_limit_leaves_the_others_as_they_are():
    free = of_a_stage(100)
    free.tables[0].columns["force_n"][:1300] *= 1.5  # the first press, over a hard place
    recording = at_a_limit(free, -1.0, 0.3, 0.0)
    cut = cut_stream(recording, parse_rig(STAGE, Path("rig.toml")))
    assert any("in 1 of 16 presses: 'force_n' stays at 0.3 N" in one for one in cut.said)
    assert [("hold" in press.phase) for press in cut.presses] == [False] + [True] * 15


def test_a_tip_that_holds_a_force_is_no_sensor_at_its_limit():
    rng, rows = np.random.default_rng(2), []
    for k in range(12):
        time = np.arange(0.0, 9.0, 0.01)
        inside = np.clip(time - 1, 0, 1) + 0.5 * np.clip((time - 2) / 3, 0, 1)  # creeps while held
        out = np.clip(1 - (time - 5) / 0.7, 0, 1)
        force = 0.2 * np.clip(time - 1, 0, 1) * out
        depth = np.where(time < 1, 3 * (time - 1), 2 * inside) - 5 * np.clip(time - 5, 0, 1.2)
        place = np.array([20.0 + 5 * k, 20.0])[:, None] + 0 * time
        noisy = np.array([[0.003], [0.003]]) * rng.standard_normal((2, len(time)))
        rows.append(np.vstack([9.0 * k + time, place, 48 - depth + noisy[0], force + noisy[1]]))
    names = ("t_s", "x_mm", "y_mm", "z_mm", "force_n")
    recording = Recording.of(
        [Table("log", dict(zip(names, np.hstack(rows), strict=True)), {}, str)]
    )
    cut = cut_stream(recording, parse_rig(STAGE, Path("rig.toml")))
    assert not any("limit" in one for one in cut.said)
    assert all("hold" in press.phase for press in cut.presses)
