"""Press programs, read and made by the robot, and what can be hidden in its scan."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from models.errors import InputError
from models.press_program import grid_program, read_program, write_program
from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.commands.scan import planned_laboratory
from palpmap.commands.scan_scene import draw_scene
from palpmap.commands.scan_truth import true_parameters
from palpmap.recording.maps import map_views
from palpmap.result.truth import read_truth
from palpmap.study.press_plan import grid_plan_of
from palpmap.study.virtual_lab import default_study
from sim.body.law import LawCurve
from sim.body.soft_body import SoftBody
from sim.body.true_body import HiddenBody
from sim.motion.scan_plan import program_plan
from sim.motion.settings import ScanSettings
from sim.scan.plant_on_robot import plant_on_robot, program_of
from sim.scan.whole_scan import run_scan
from tests.sim.springs import Spring

SIZE = (0.096, 0.096, 0.048)
QUIET = ScanSettings(force_noise_n=0.0, displacement_noise_m=0.0)
HEADER = "x_m,y_m,radius_m,force_n,ramp_s,hold_s"
ROWS = ["0.03,0.05,0.004,0.2,0.8,1.0", "0.05,0.04,0.004,0.3,1.5,0.5"]


def written(tmp_path, *lines):
    path = tmp_path / "next_scan.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_program_comes_back_as_it_was_written(tmp_path):
    program = grid_program(per_side=3, radii_m=(0.003, 0.01), seed=2, repeats=2, shuffled=True)
    write_program(program, tmp_path / "program.csv")
    back = read_program(tmp_path / "program.csv")
    for name in ("x_m", "y_m", "radius_m", "force_n", "ramp_s", "hold_s", "unload_s", "pause_s"):
        assert_allclose(getattr(back, name), getattr(program, name), rtol=1e-8)
    spots, counts = np.unique(np.round(np.column_stack([back.x_m, back.y_m]), 6), axis=0,
                              return_counts=True)  # fmt: skip
    assert (len(spots), set(counts)) == (9, {2})
    assert_allclose(program.force_n / program.radius_m, 60.0)


def test_a_mixed_grid_presses_with_every_tip_at_every_force():
    program = grid_program(
        per_side=4, radii_m=(0.003, 0.01), force_n=0.3, shuffled=True, force_shares=(0.5, 1.5)
    )
    pressure = np.round(program.force_n / program.radius_m, 9)
    pairs, counts = np.unique(
        np.column_stack([program.radius_m, pressure]), axis=0, return_counts=True
    )
    assert_allclose(pairs, [[0.003, 30.0], [0.003, 90.0], [0.01, 30.0], [0.01, 90.0]])
    assert counts.tolist() == [4, 4, 4, 4]
    assert len(np.unique(np.column_stack([program.x_m, program.y_m]), axis=0)) == 16
    assert (np.diff(program.y_m) < 0).any()
    # The order changes when a place is pressed, not how
    rows = grid_program(per_side=4, radii_m=(0.003, 0.01), force_n=0.3, force_shares=(0.5, 1.5))
    at = {(x, y): (r, f) for x, y, r, f in zip(rows.x_m, rows.y_m, rows.radius_m, rows.force_n,
                                               strict=True)}  # fmt: skip
    for x, y, r, f in zip(program.x_m, program.y_m, program.radius_m, program.force_n, strict=True):
        assert at[x, y] == (r, f)


def test_missing_columns_are_filled_and_comments_left_out(tmp_path):
    program = read_program(written(tmp_path, "# from a diagnosis", HEADER, *ROWS), seed=5)
    assert program.unload_s.tolist() == [1.0, 1.0]
    assert ((program.pause_s >= 0.05) & (program.pause_s <= 0.95)).all()
    assert program.start_s[1] == pytest.approx(2.8 + program.pause_s.sum())
    other = read_program(written(tmp_path, HEADER, *ROWS), seed=6)
    assert (other.pause_s != program.pause_s).all()


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ((HEADER,), "found 1 rows, expected a header"),
        ((HEADER + ",forse_n", ROWS[0] + ",1"), "unknown column 'forse_n'; the nearest .*'force_n"),
        (("x_m,y_m,radius_m,force_n,ramp_s", "1,1,1,1,1"), "the column 'hold_s' is missing"),
        ((HEADER, ROWS[0], "1,2,3"), "row 2: found 3 cells, expected 6"),
        ((HEADER, ROWS[0].replace("0.2", "-0.2")), "row 1, column force_n: found '-0.2'"),
        ((HEADER, ROWS[0].replace("0.8", "soon")), "row 1, column ramp_s: found 'soon'"),
    ],
)
def test_a_program_that_cannot_be_used_is_refused_by_row_and_column(lines, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_program(written(tmp_path, *lines))


def test_the_robot_refuses_a_tip_over_the_edge():
    one = grid_program(per_side=2)
    with pytest.raises(InputError, match=r"Press 0 .* hangs over the edge"):
        program_plan(replace(one, x_m=one.x_m - 0.009), SIZE)
    with pytest.raises(
        InputError, match=r"Press 0 .* at x_m -0\.\d+, y_m 0\.\d+: there is no body"
    ):
        program_plan(replace(one, x_m=one.x_m - 0.5), SIZE)


def test_the_robot_presses_each_row_with_its_own_force_and_pace(tmp_path):
    program = read_program(written(tmp_path, HEADER, *ROWS))
    plan = program_plan(program, SIZE)
    body = SoftBody(
        SIZE, HiddenBody().modulus, 0.49, 0.004, plan.points_m, plan.directions, (6, 6, 3)
    )
    run = run_scan(plan, body, ScanSettings())
    assert_allclose([s.force_n for s in run.statistics], program.force_n, rtol=0.01)
    assert max(abs(s.force_error) for s in run.statistics) < 0.01
    for press, ramp, hold in zip(run.presses, program.ramp_s, program.hold_s, strict=True):
        time, phase = press.scan.time_s, press.scan.phase
        # From the first of 8 rows of the ramp to its last are 7/8 of it
        assert np.ptp(time[phase == "load"]) == pytest.approx(ramp * 7 / 8, abs=0.01)
        assert np.ptp(time[phase == "hold"]) == pytest.approx(hold * 7 / 8, abs=0.01)


def planted(name, size=0.05):
    program = grid_program(SIZE, per_side=2)
    plan = program_plan(program, SIZE)
    return plant_on_robot([(name, size)], plan, ScanSettings(), HiddenBody())


def test_a_name_that_nothing_has_is_refused_with_the_nearest():
    with pytest.raises(InputError, match="the nearest right name is 'force_drift'"):
        planted("force_drifts")


def test_a_fault_befalls_a_share_of_the_presses_and_the_same_ones_again():
    for size in (5, 0.0, -0.1, float("nan")):
        with pytest.raises(InputError, match=r"0\.03 for 3 %"):
            planted("hysteresis", size)
    first, again = planted("sensor_frozen", 0.5), planted("sensor_frozen", 0.5)
    assert len(first.records[0]["values"]) == 2
    assert first.records == again.records
    assert first.mechanisms.parts[0].name == "sensor_frozen"


def test_a_file_of_hooks_acts_in_the_loop(tmp_path, short_scan):
    path = tmp_path / "own.py"
    path.write_text(
        "def sensor(t, wrench):\n"
        "    return wrench * 1.02 if t > 1e9 else wrench\n"
        "def advance(t, force):\n"
        "    return 2e-3 * force\n"
    )
    plan, scans, law = short_scan
    plant = plant_on_robot([(str(path), 0.03)], plan, ScanSettings(), HiddenBody())
    run = run_scan(plan, law, ScanSettings(), mechanisms=plant.mechanisms)
    for press, plain in zip(run.presses, scans, strict=True):
        hold = press.scan.phase == "hold"
        more = (press.scan.displacement_m - plain.displacement_m)[hold].mean()
        assert more == pytest.approx(2e-3 * 0.3, rel=0.05)
    (tmp_path / "empty.py").write_text("x = 1\n")
    with pytest.raises(InputError, match="found no function of a hook"):
        planted(str(tmp_path / "empty.py"))
    (tmp_path / "broken.py").write_text("1 / 0\n")
    with pytest.raises(InputError, match="fails with ZeroDivisionError"):
        planted(str(tmp_path / "broken.py"))


@pytest.mark.slow
def test_the_same_plant_gives_the_same_scan_again(short_scan):
    plan, _, law = short_scan
    wanted = [("force_wander", 0.05), ("sensor_spike", 0.5), ("viscoelasticity", 0.05)]
    runs = []
    for _ in range(2):
        plant = plant_on_robot(wanted, plan, ScanSettings(), HiddenBody())
        runs.append(run_scan(plan, law, ScanSettings(), mechanisms=plant.mechanisms))
    assert runs[0].outcomes == runs[1].outcomes
    assert (runs[0].scan.force_n == runs[1].scan.force_n).all()
    assert (runs[0].scan.displacement_m == runs[1].scan.displacement_m).all()


def test_a_modulus_field_goes_into_the_body_that_the_robot_presses():
    plant = planted("stiffness_gradient")
    (record,) = plant.records
    assert plant.body.gradient == record["values"]["gradient"] != 0
    assert record["size"] == pytest.approx(0.05, rel=0.011)


def test_a_plan_without_a_program_is_one_of_equal_presses():
    plan = replace(program_plan(grid_program(SIZE, per_side=2), SIZE), program=None)
    program = program_of(plan, ScanSettings(hold_s=1.5), HiddenBody())
    assert set(program.hold_s) == {1.5}
    assert_allclose(program.force_n, plan.force_n)


@pytest.fixture(scope="module")
def short_scan():
    """Four quick presses by the robot, and the body that it pressed."""
    program = grid_program(SIZE, per_side=2, ramp_s=0.5, hold_s=0.3, seed=4)
    plan = program_plan(program, SIZE)
    body = SoftBody(
        SIZE, HiddenBody().modulus, 0.49, 0.005, plan.points_m, plan.directions, (6, 6, 3)
    )
    return plan, [press.scan for press in run_scan(plan, body, ScanSettings()).presses], body


def test_presses_of_a_program_begin_when_the_robot_comes_to_them(short_scan):
    plan, scans, _ = short_scan
    foreseen = program_of(plan, ScanSettings(), HiddenBody()).start_s
    begun = np.array([scan.time_s[0] for scan in scans])
    assert_allclose(np.diff(foreseen), np.diff(begun), rtol=0.03)
    assert np.ptp(plan.program.start_s) < 0.8 * np.ptp(begun)


@pytest.mark.parametrize(
    "name", ["force_drift", "sensitivity_drift", "displacement_drift", "breathing"]
)
def test_what_goes_with_time_has_the_size_that_was_asked_on_the_robots_clock(short_scan, name):
    plan, _, law = short_scan
    plant = plant_on_robot([(name, 0.05)], plan, QUIET, HiddenBody())
    run = run_scan(plan, law, QUIET, mechanisms=plant.mechanisms)
    true = np.concatenate([press.true_force_n for press in run.presses])
    elastic = law.compliance_m_per_n[run.scan.press] * true
    squares = [
        np.sum((seen - plain) ** 2) / np.sum(plain**2)
        for seen, plain in ((run.scan.force_n, true), (run.scan.displacement_m, elastic))
    ]
    assert np.sqrt(sum(squares)) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("name", ["force_drift", "breathing", "viscoelasticity", "play"])
def test_effects_are_planted_in_a_body_of_any_shape_by_the_laws_of_its_presses(short_scan, name):
    plan = short_scan[0]
    force = 0.4 * np.linspace(0, 1, 50) ** 1.5
    slope = 0.008 / 0.9 * (np.maximum(force, force[1]) / 0.3) ** (-1 / 3)
    curve = LawCurve(force, 0.004 * (force / 0.3) ** (2 / 3), slope)
    body = HiddenBody((0.1, 0.1, 0.05), solved=(curve,) * len(plan))
    plant = plant_on_robot([(name, 0.05)], plan, QUIET, body)
    pressed = SimpleNamespace(
        displacement=lambda press, f: curve.at(f)[0], tangent=lambda press, f: 1 / curve.at(f)[1]
    )
    run = run_scan(plan, pressed, QUIET, mechanisms=plant.mechanisms)
    true = np.concatenate([press.true_force_n for press in run.presses])
    elastic = np.array([curve.at(f)[0] for f in true])
    squares = [
        np.sum((seen - plain) ** 2) / np.sum(plain**2)
        for seen, plain in ((run.scan.force_n, true), (run.scan.displacement_m, elastic))
    ]
    assert np.sqrt(sum(squares)) == pytest.approx(0.05, rel=0.15)
    with pytest.raises(InputError, match="'skin_layer' to be planted in a body that is no block"):
        plant_on_robot([("skin_layer", 0.05)], plan, QUIET, body)


@pytest.mark.parametrize(("force_n", "longer"), [(0.3, False), (0.06, True)])
def test_a_weak_press_is_held_until_the_sensors_noise_is_averaged_out(force_n, longer):
    program = grid_program(SIZE, per_side=4, force_n=force_n)
    plan = replace(program_plan(program, SIZE), program=None)
    run = run_scan(plan, Spring(80.0), ScanSettings())
    for press in run.presses:
        held = np.ptp(press.scan.time_s[press.scan.phase == "hold"])
        assert (held > 3.0) == longer
    errors = [statistics.force_error for statistics in run.statistics]
    assert np.std(errors) < 0.0035


def test_the_error_of_a_mesh_has_the_size_that_was_asked_on_the_mesh_where_it_acts(short_scan):
    plan, _, law = short_scan
    plant = plant_on_robot([("mesh_error", 0.05)], plan, ScanSettings(), HiddenBody())
    stiffer = plant.mechanisms.pressed(law)
    travel = np.array([[b.displacement(j, 0.2) for b in (law, stiffer)] for j in range(len(plan))])
    assert abs(np.diff(travel) / travel[:, :1]).mean() == pytest.approx(0.05, rel=0.1)


@pytest.mark.slow
def test_truth_and_recording_of_a_scan_have_the_planted_body(tmp_path):
    words = ["scan", "--presses-per-side", "2", "--force", "0.2", "--json"]
    plant = ["--plant", "extra_inclusion:5", "--plant", "stiffness_gradient:5"]
    done = CliRunner().invoke(app, [*words, *plant, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    truth = json.loads((tmp_path / "truth.json").read_text())
    extra, gradient = (effect["values"] for effect in truth["effects"])
    assert truth["body"]["inclusions"][1:] == [extra]
    assert truth["body"]["gradient"] == gradient["gradient"] != 0
    assert truth["body"]["poisson_ratio"] == 0.49
    assert len(read_truth(tmp_path / "truth.json").inclusions) == 2


def test_the_recordings_truth_is_the_body_that_is_pressed(tmp_path):
    plant = [("extra_inclusion", 0.05), ("stiffness_gradient", 0.05)]
    known = default_study()
    laboratory, _ = planned_laboratory(
        tmp_path, known, grid_plan_of(known, 0.2, 2), ScanSettings(), plant
    )
    recording = MagicMock()
    draw_scene(recording, laboratory, true_parameters(laboratory.truth))
    views, parameters = recording.truth.call_args.args
    true = map_views(laboratory.body.modulus, (0, 0, 0), SIZE)
    assert_allclose(views.side_pa, true.side_pa)
    assert (
        parameters["inclusion_2.weight_pa"] == laboratory.hidden.records[0]["values"]["weight_pa"]
    )
    surface = recording.scene.call_args
    assert_allclose(surface.kwargs["body_modulus_pa"], laboratory.body.modulus(surface.args[0]))


def test_what_is_hidden_by_the_scan_command_is_in_the_rows_and_said_in_the_truth(tmp_path):
    words = ["scan", "--presses-per-side", "2", "--force", "0.2", "--json"]
    run = CliRunner()
    plain = run.invoke(app, [*words, "--out", str(tmp_path / "plain")])
    hidden = run.invoke(
        app,
        [*words, "--plant", "force_bias:5", "--plant", "tool_compliance", "--out",
         str(tmp_path / "hidden")],
    )  # fmt: skip
    assert (plain.exit_code, hidden.exit_code) == (0, 0), plain.output + hidden.output
    truth = json.loads((tmp_path / "hidden" / "truth.json").read_text())
    bias, tool = (effect["values"] for effect in truth["effects"])
    without, with_it = (read_scan(tmp_path / name / "scan.csv") for name in ("plain", "hidden"))
    hold = with_it.phase == "hold"
    # The robot holds the force that it reads; the body bears less by the bias
    assert_allclose(with_it.force_n[hold].mean(), 0.2, rtol=0.01)
    softer = with_it.displacement_m[hold].mean() / without.displacement_m[hold].mean()
    stiffness = 0.2 / without.displacement_m[hold].mean()
    expected = (1 + tool["compliance_m_per_n"] * stiffness) * (1 - bias["bias_n"] / 0.2)
    assert softer == pytest.approx(expected, rel=0.03)
    assert with_it.tip_pose is None
    assert with_it.force_vector_n is None
    for file in ("study.toml", "scan.csv"):
        assert "bias" not in (tmp_path / "hidden" / file).read_text()
