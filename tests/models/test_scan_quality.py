"""Readings that are not what they seem are named press by press; clean scans are left alone."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from models.errors import InputError
from models.scan import Scan
from models.scan_file import read_scan, write_scan
from models.scan_join import join_scans
from models.scan_quality import (
    identical_presses,
    scan_findings,
    touching,
    without_outliers,
)
from models.scan_readings import bad_readings
from palpmap.__main__ import app
from tests.long import long
from tests.paths import LAB, TWELVE

RUN = CliRunner()
SEEN_SHARE = 0.1  # of its press's largest: a third of a smaller reading is often within noise


PARTS = ("load", "hold", "unload")


def drawn_scan(seed: int, quiet: bool = False) -> Scan:
    """Draw a clean scan: body, robot program and sensor by the seed, a law of each press."""
    rng = np.random.default_rng(seed)
    presses = int(rng.integers(9, 40))
    load, hold, unload = (int(rng.integers(*limits)) for limits in ((5, 16), (2, 12), (5, 16)))
    ramp = np.r_[
        np.arange(1, load + 1) / load, np.ones(hold), np.arange(unload - 1, -1, -1) / unload
    ]
    count = len(ramp)
    phase = ["load"] * load + ["hold"] * hold + ["unload"] * unload
    time = 0.1 * np.arange(count)
    stiffness = rng.uniform(50, 300) * rng.uniform(0.6, 1.8, presses)
    depth = rng.uniform(1e-3, 6e-3)
    travel = depth * ramp * np.ones((presses, 1))
    relaxing = rng.uniform(0, 0.3) * rng.uniform(0.5, 1.5, (presses, 1))
    relaxed = 1 - relaxing * (1 - np.exp(-time / rng.uniform(0.2, 2)))
    stiffening = rng.uniform(0, 1) * rng.uniform(0.5, 1.5, (presses, 1))
    force = stiffness[:, None] * travel * (1 + stiffening * ramp**2) * relaxed
    noise_n = rng.uniform(0.001, 0.02) * np.median(force.max(axis=1))
    noise_m = rng.uniform(0.0005, 0.01) * depth
    if quiet:
        noise_n, noise_m = 0.0, 0.0
    force = force + rng.normal(0, noise_n, force.shape)
    travel = travel + rng.normal(0, noise_m, travel.shape)
    place = rng.uniform(0.02, 0.07, (presses, 2))
    return Scan(
        press=np.repeat(np.arange(presses), count),
        time_s=(time + 5.0 * np.arange(presses)[:, None]).ravel(),
        phase=np.tile(phase, presses),
        point_m=np.repeat(np.c_[place, np.full(presses, 0.048)], count, axis=0),
        direction=np.tile([0.0, 0.0, -1.0], (presses * count, 1)),
        force_n=force.ravel(),
        displacement_m=travel.ravel(),
        probe_radius_m=np.full(presses * count, 0.005),
    )


def with_bad_reading(
    scan: Scan, rng: np.random.Generator, least: float = SEEN_SHARE
) -> tuple[Scan, int, str]:
    column = ("force_n", "displacement_m")[rng.integers(2)]
    values = np.array(getattr(scan, column))
    largest = np.zeros(len(scan.press_ids))
    np.maximum.at(largest, scan.press_index, values)
    row = int(rng.choice(np.flatnonzero(values > least * largest[scan.press_index])))
    values[row] *= rng.uniform(3, 30) ** rng.choice([-1, 1])
    return scan.replace(**{column: values}), row, column


def visible(bad: Scan, clean: Scan, quiet: Scan, row: int, column: str) -> bool:
    """Whether who knows the true course and the noise can tell a reading from good ones.

    So that he takes a good one for bad in at most 2 % of the scans.
    """
    true = getattr(quiet, column)
    noise = np.std(getattr(clean, column) - true)
    level = norm.isf(0.02 / (2 * 2 * len(bad)))  # of two columns, to both sides
    return bool(abs(getattr(bad, column)[row] - true[row]) > level * noise)


@pytest.mark.parametrize(("least", "most_hidden"), [(SEEN_SHARE, 0), *long((0.0, 6))])
def test_single_bad_readings_are_named_by_row(least, most_hidden):
    rng = np.random.default_rng(1)
    found, seen = [], []
    for seed in range(200):
        clean = drawn_scan(seed)
        scan, row, column = with_bad_reading(clean, rng, least)
        found.append((row, column) in [place[:2] for place in bad_readings(scan)])
        seen.append(visible(scan, clean, drawn_scan(seed, quiet=True), row, column))
    assert sum(seen) >= 200 - most_hidden
    assert np.mean(np.array(found)[seen]) >= 0.98


def test_bad_readings_of_laboratory_scans_are_named_by_row():
    rng = np.random.default_rng(2)
    scan = read_scan(LAB / "case_a" / "scan.csv")
    found = 0
    for _ in range(50):
        bad, row, column = with_bad_reading(scan, rng)
        found += (row, column) in [place[:2] for place in bad_readings(bad)]
    assert found >= 0.98 * 50


def test_clean_scans_raise_no_doubt():
    alarms = [seed for seed in range(1000, 1200) if scan_findings(drawn_scan(seed))]
    assert len(alarms) <= 0.02 * 200


@pytest.mark.parametrize("case", sorted(path.name for path in LAB.iterdir() if path.is_dir()))
def test_laboratory_scans_raise_no_doubt(case):
    assert scan_findings(read_scan(LAB / case / "scan.csv")) == []


def kinds(scan: Scan) -> dict[str, tuple[int, ...]]:
    return {finding.kind: finding.presses for finding in scan_findings(scan)}


def test_a_press_that_touched_late_has_no_bad_reading():
    """Its first readings are a fraction of the other presses', and so are those beside them."""
    scan = drawn_scan(12)
    late = scan.press == scan.press_ids[3]
    travel = np.where(late, scan.displacement_m - 0.3 * scan.displacement_m[late].max(), 1.0)
    force = np.where(late, scan.force_n * np.clip(travel, 0, None), scan.force_n)
    share = force[late].max() / scan.force_n[late].max()
    shifted = scan.replace(force_n=np.where(late, force / share, force))
    assert "bad_reading" not in kinds(shifted)


def test_a_jump_of_the_tip_is_not_taken_for_a_bad_reading():
    scan = drawn_scan(3)
    row = int(scan.deepest_rows[2])
    scale = np.ones(len(scan))
    scale[row] = 3.0
    jumped = scan.replace(force_n=scan.force_n * scale, displacement_m=scan.displacement_m * scale)
    assert "bad_reading" not in kinds(jumped)


def test_travel_counted_from_above_the_surface_is_seen_with_its_start():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    first = scan.press_ids[0]
    rows = np.flatnonzero((scan.press == first) & (scan.phase == "load"))
    # The same press from 10 mm above: free rows first, then the readings as they were.
    above = scan.rows(np.r_[rows[:4], np.arange(len(scan))])
    force, travel = np.array(above.force_n), np.array(above.displacement_m)
    travel[above.press == first] += 0.010
    force[:4], travel[:4] = [0.001, -0.002, 0.0, 0.001], [0.001, 0.004, 0.007, 0.0098]
    found = scan_findings(above.replace(force_n=force, displacement_m=travel))
    assert [f.kind for f in found] == ["free_travel"]
    assert found[0].presses == (first,)
    assert "at about 9.8 mm" in found[0].sentence


def test_travel_from_above_is_seen_where_all_readings_bear_a_load():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    found = scan_findings(scan.replace(displacement_m=scan.displacement_m + 0.01))
    assert [f.kind for f in found] == ["free_travel"]
    assert len(found[0].presses) > 70


def test_a_ball_is_in_the_body_at_its_first_reading():
    """Travel grows with the force to two thirds: a quarter of the force, two fifths of it."""
    rng = np.random.default_rng(1)
    share = np.concatenate([np.linspace(0.24, 1, 8), np.ones(8), np.linspace(0.9, 0.06, 6)])
    press, force = np.repeat(np.arange(16), 22), np.tile(0.12 * share, 16)
    scan = Scan(
        press=press, time_s=np.arange(352.0), phase=np.tile(np.repeat(PARTS, (8, 8, 6)), 16),
        point_m=np.column_stack([0.01 * (press % 4), 0.01 * (press // 4), 0 * press]),
        direction=np.tile([0.0, 0, -1], (352, 1)),
        displacement_m=4e-3 * (force / 0.12) ** (2 / 3) + rng.normal(0, 2e-5, 352),
        force_n=force + rng.normal(0, 5e-3, 352), probe_radius_m=np.full(352, 0.004),
    )  # fmt: skip
    assert scan_findings(scan) == []


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_clipped_sensor_is_said_press_by_press(share):
    scan = read_scan(LAB / "case_a" / "scan.csv")
    limit = share * np.median(scan.force_n[scan.deepest_rows])
    clipped = scan.replace(force_n=np.minimum(scan.force_n, limit))
    assert len(kinds(clipped)["clipped"]) > 0.5 * len(scan.press_ids)


def test_a_bad_reading_hides_no_other_doubt_and_makes_none():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    force = np.array(scan.force_n)
    force[400] = 30.0
    assert list(kinds(scan.replace(force_n=force))) == ["bad_reading"]
    clipped = np.minimum(force, 0.5 * np.median(force[scan.deepest_rows]))
    clipped[400] = 30.0
    assert set(kinds(scan.replace(force_n=clipped))) == {"bad_reading", "clipped"}


def test_hold_without_contact_and_collapsed_force_are_said_press_by_press():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    force = np.array(scan.force_n)
    rng = np.random.default_rng(0)
    missed, slipped = scan.press == 5, (scan.press == 9) & (scan.phase == "hold")
    force[missed] = rng.normal(0, 1e-3, missed.sum())
    force[np.flatnonzero(slipped)[2:]] = rng.normal(0, 1e-3, slipped.sum() - 2)
    found = kinds(scan.replace(force_n=force))
    assert found == {"no_contact": (5,), "collapsed": (9,)}


def test_a_press_without_any_force_met_no_body_however_few_its_readings():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    few = scan.rows(np.concatenate([np.flatnonzero(scan.press == p)[:3] for p in range(12)]))
    force = np.where(few.press == 5, 0.0, few.force_n)
    assert kinds(few.replace(force_n=force))["no_contact"] == (5,)
    assert 5 not in touching(few.replace(force_n=force)).press


def test_a_press_in_millinewtons_and_times_in_milliseconds_are_said():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    other = scan.press == 7
    force = np.where(other, 1000 * scan.force_n, scan.force_n)
    (found,) = scan_findings(scan.replace(force_n=force))
    assert (found.kind, found.presses, found.leaves_out) == ("force_unit", (7,), True)
    assert "Press 7 (1 of 81): forces about" in found.sentence
    (found,) = scan_findings(scan.replace(time_s=1000 * scan.time_s))
    assert (found.kind, found.leaves_out) == ("time_unit", False)
    assert "if these are milliseconds divide by 1000" in found.sentence


def test_a_press_without_a_phase_that_the_others_have_is_said():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    cut = scan.rows(~((scan.press == 4) & (scan.phase == "unload")))
    assert kinds(cut) == {"missing_phase": (4,)}


def test_identical_presses_are_refused_when_scans_are_joined():
    scan = drawn_scan(5)
    with pytest.raises(InputError, match=r"b, press 0: holds the same readings as a, press 0"):
        join_scans([scan, scan], ["a", "b"], 60.0)
    other = drawn_scan(6)
    mixed = other.rows(other.press < 3)
    with pytest.raises(InputError, match=r"b, press 2: holds .* as a, press 2 \(1 presses"):
        join_scans([scan, scan.rows(scan.press == 2)], ["a", "b"], 60.0)
    joined, _ = join_scans([scan, mixed], ["a", "b"], 60.0)
    assert identical_presses(joined) == []


@pytest.mark.parametrize(
    ("unit", "per_second"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]
)
def test_times_since_1970_in_another_unit_are_recognised(unit, per_second, tmp_path):
    scan = drawn_scan(7)
    write_scan(scan.replace(time_s=(scan.time_s + 1.75e9) * per_second), tmp_path / "scan.csv")
    with pytest.raises(InputError, match=f"column time_s.*looks like {unit} since 1970"):
        read_scan(tmp_path / "scan.csv", units_checked=True)
    write_scan(scan.replace(time_s=scan.time_s + 1.75e9), tmp_path / "seconds.csv")
    assert read_scan(tmp_path / "seconds.csv").time_s[0] == 1.75e9


@pytest.mark.parametrize("column", ["force_n", "displacement_m", "z_m"])
def test_numbers_beyond_any_rig_are_refused(column, tmp_path):
    lines = (LAB / "case_a" / "scan.csv").read_text(encoding="utf-8").splitlines()
    cells = lines[7].split(",")
    cells[lines[0].split(",").index(column)] = "1e308"
    lines[7] = ",".join(cells)
    (tmp_path / "scan.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=rf"row 7 \(line 8\), column {column}: found 1e\+308"):
        read_scan(tmp_path / "scan.csv", units_checked=True)


@pytest.mark.parametrize("found", [b"v3 of another", b"\xff\xfe", b"-1", b"9" * 5000])
def test_parquet_metadata_of_another_program_is_refused(found, tmp_path):
    write_scan(drawn_scan(8), tmp_path / "scan.parquet")
    table = pq.read_table(tmp_path / "scan.parquet")
    table = table.replace_schema_metadata({b"palpmap.scan_schema": found})
    pq.write_table(table, tmp_path / "scan.parquet")
    with pytest.raises(InputError, match="found scan schema"):
        read_scan(tmp_path / "scan.parquet")


def test_a_press_number_beyond_whole_numbers_is_refused(tmp_path):
    write_scan(drawn_scan(8), tmp_path / "scan.parquet")
    table = pq.read_table(tmp_path / "scan.parquet")
    press = np.full(len(table), 2**63, dtype=np.uint64)
    pq.write_table(table.set_column(0, "press", pa.array(press)), tmp_path / "scan.parquet")
    with pytest.raises(InputError, match=r"row 1, column press: found 9\.22337e\+18"):
        read_scan(tmp_path / "scan.parquet")


def test_check_names_the_bad_reading(tmp_path):
    for name in ("scan.csv", "study.toml"):
        shutil.copy(LAB / "case_a" / name, tmp_path / name)
    scan = read_scan(tmp_path / "scan.csv")
    force = np.array(scan.force_n)
    force[100] = 15.0
    write_scan(scan.replace(force_n=force), tmp_path / "scan.csv")
    study = Path(tmp_path / "study.toml")
    done = RUN.invoke(app, ["check", str(study)])
    said = " ".join(done.output.split())
    assert done.exit_code == 0, done.output
    assert f"Row 101 (press {scan.press[100]}), column force_n: found 15 N" in said
    assert "look at the doubtful readings" in said


@pytest.mark.slow
def test_a_bad_reading_is_left_out_of_a_fit_and_said(tmp_path):
    shutil.copytree(TWELVE, tmp_path / "study")
    study = tmp_path / "study" / "study.toml"
    scan = read_scan(study.parent / "scan.csv")
    force = np.array(scan.force_n)
    force[30] = 30.0
    write_scan(scan.replace(force_n=force), study.parent / "scan.csv")
    left, sentences = without_outliers(scan.replace(force_n=force))
    assert np.array_equal(left.force_n, np.delete(scan.force_n, 30))
    (sentence,) = sentences
    assert re.match(r"Left out: [Rr]ow 31 \(press \d+\), column force_n: found 30 N", sentence)
    done = RUN.invoke(app, ["fit", str(study), "--without-outliers", "--json", "--out",
                            str(tmp_path / "run")])  # fmt: skip
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["left_out"] == [sentence]
    assert sentence in " ".join(done.stderr.split())
    assert len(read_scan(tmp_path / "run" / "scan.csv")) == len(scan) - 1
    clean = RUN.invoke(app, ["fit", str(TWELVE / "study.toml"), "--json", "--out",
                             str(tmp_path / "clean")])  # fmt: skip
    found, known = (
        json.loads(run.stdout)["parameters"]["background_pa"]["value"] for run in (done, clean)
    )
    assert found == pytest.approx(known, rel=0.02)


def test_an_error_names_press_and_row_of_the_bad_reading(tmp_path):
    shutil.copytree(TWELVE, tmp_path / "study")
    study = tmp_path / "study" / "study.toml"
    scan = read_scan(study.parent / "scan.csv")
    travel = np.array(scan.displacement_m)
    travel[30] = 0.03
    write_scan(scan.replace(displacement_m=travel), study.parent / "scan.csv")
    for command in ("check", "fit", "explain"):
        out = [] if command == "check" else ["--out", str(tmp_path / command)]
        done = RUN.invoke(app, [command, str(study), *out])
        said = " ".join(done.stderr.split())
        assert done.exit_code == 2, done.output
        cause = r"Doubtful data may be the cause: Row 31 \(press \d+\), column displacement_m"
        assert re.search(cause + r": found 0\.03 m, .* --without-outliers` leaves such", said)


def test_presses_that_went_wrong_are_left_out_as_a_whole():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    force = np.array(scan.force_n)
    force[scan.press == 5] = np.random.default_rng(0).normal(0, 1e-3, np.sum(scan.press == 5))
    left, sentences = without_outliers(scan.replace(force_n=force))
    assert set(scan.press_ids) - set(left.press_ids) == {5}
    assert sentences == (
        "Left out: Press 5 (1 of 81): the force does not rise with the travel, or "
        "the hold is below 5 % of a typical press's force: the tip met no body.",
    )


def test_a_press_three_times_stronger_than_those_beside_it_is_left_out():
    scan = read_scan(LAB / "case_a" / "scan.csv")
    force = np.where(scan.press == 5, 3.0, 1.0) * scan.force_n
    left, (sentence,) = without_outliers(scan.replace(force_n=force))
    assert set(scan.press_ids) - set(left.press_ids) == {5}
    assert re.match(r"Left out: Press 5 \(1 of 81\): forces 2\.\d times those of any", sentence)


@pytest.mark.parametrize(
    "file", [*LAB.glob("*/scan.csv"), LAB.parents[2] / "examples/organ/scan.csv"]
)
def test_no_press_over_a_hard_spot_is_left_out(file):
    scan = read_scan(file)
    assert "lone_force" not in [doubt.kind for doubt in scan_findings(scan)]
    hard = np.exp(-((np.linalg.norm(scan.point_m - scan.point_m[0], axis=1) / 0.009) ** 2))
    scan = scan.replace(force_n=scan.force_n * (1 + hard))  # as over a ball right under the tip
    assert "lone_force" not in [doubt.kind for doubt in scan_findings(scan)]


@pytest.mark.parametrize("zero", [0.0, -0.3])
def test_presses_in_the_air_may_read_below_zero(tmp_path, zero):
    """A tip that stops 2 mm above the surface, its sensor's zero a little off."""
    scan = read_scan(LAB / "case_a" / "scan.csv")
    force, air = np.array(scan.force_n), np.isin(scan.press, (5, 40))
    force[air] = zero * np.median(force) + np.random.default_rng(0).normal(0, 1e-3, np.sum(air))
    write_scan(scan.replace(force_n=force), tmp_path / "scan.csv")
    read = read_scan(tmp_path / "scan.csv")
    assert set(read.press_ids) - set(touching(read).press_ids) == {5, 40}


def test_presses_in_the_air_are_told_from_soft_places_beside_them():
    """A robot that takes a jerk for its touch: noise over the whole travel, without a hold."""
    rng = np.random.default_rng(4)
    travel = np.tile(np.linspace(0, 2e-3, 10), 12)
    press = np.repeat(np.arange(12), 10)
    stiffness = np.where(press < 6, 80.0, 15.0)  # N/m; the soft ones rise by 4 deviations
    stiffness[press % 6 == 5] = 0.0
    points = np.column_stack([0.01 * (press % 4), 0.01 * (press // 4), np.zeros(120)])
    scan = Scan(
        press=press, time_s=np.full(120, np.nan), phase=np.full(120, "load"), point_m=points,
        direction=np.tile([0.0, 0, -1], (120, 1)), displacement_m=travel,
        force_n=stiffness * travel + rng.normal(0, 0.007, 120),
        probe_radius_m=np.full(120, 0.004), tip_pose=None,
    )  # fmt: skip
    assert kinds(scan)["no_contact"] == (5, 11)
    assert set(scan.press_ids) - set(touching(scan).press_ids) == {5, 11}


@pytest.mark.parametrize("seed", [4, 19, 179, 184])
def test_a_coarse_sensor_raises_no_doubt(seed):
    scan = drawn_scan(seed)
    step = np.random.default_rng(10_000 + seed).uniform(0.002, 0.02) * scan.force_n.max()
    assert scan_findings(scan.replace(force_n=np.round(scan.force_n / step) * step)) == []


def test_a_body_that_stiffens_strongly_is_not_taken_for_free_travel():
    for seed in (121, 141, 146, 176):
        scan = drawn_scan(seed)
        deepest = np.zeros(len(scan.press_ids))
        np.maximum.at(deepest, scan.press_index, scan.displacement_m)
        share = np.clip(scan.displacement_m / deepest[scan.press_index], 0, None)
        stiff = scan.replace(force_n=scan.force_n * np.exp(3 * (share - 1)))
        assert "free_travel" not in kinds(stiff)


def test_a_press_that_bends_more_than_the_others_has_no_bad_reading_at_its_end():
    """Soft tissue of uneven thickness: where it is thin, the last reading is twice the others'."""
    rng = np.random.default_rng(2)
    depth = np.linspace(0.1, 1.0, 10)
    bend = np.repeat([1.0, 1.5, 5.0], (14, 14, 8))[:, None]
    force = 0.12 * np.expm1(bend * depth) / np.expm1(0.75 * bend)
    press = np.repeat(np.arange(36), 10)
    scan = Scan(
        press=press, time_s=np.full(360, np.nan), phase=np.full(360, "load"),
        point_m=np.column_stack([0.01 * (press % 6), 0.01 * (press // 6), 0 * press]),
        direction=np.tile([0.0, 0, -1], (360, 1)), displacement_m=np.tile(2e-3 * depth, 36),
        force_n=force.ravel() + rng.normal(0, 5e-3, 360), probe_radius_m=np.full(360, 0.004),
    )  # fmt: skip
    assert bad_readings(scan) == []
    spiked = np.array(scan.force_n)
    spiked[79] = 2.0  # the last reading of press 7
    assert [row for row, *_ in bad_readings(scan.replace(force_n=spiked))] == [79]
