"""Folders and files that a command is pointed at: what is missing, there already, or another's."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from identify.design.predicted_limits import BetterScans, Improvement
from identify.design.scan_variants import Design, presses_of
from identify.effects.readings import Readings
from models.press_program import grid_program, read_program, write_program
from models.scan import Scan
from models.scan_file import read_scan, write_scan
from palpmap.blind import tournament
from palpmap.blind.trial import Trial, make_trial
from palpmap.result.next_scan import Sites, write_planned, write_presses
from palpmap.result.presses_words import presses_sentences
from palpmap.result.records import ExplainRecord
from palpmap.study.body import Body
from palpmap.study.press_plan import program_plan_of
from palpmap.study.study import load_study, write_study
from palpmap.study.virtual_lab import default_study
from tests.palpmap.cli.test_loop import palpmap, sentence_of
from tests.palpmap.pipeline.test_blind import result
from tests.palpmap.report.loop_study import put, shifted


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    return put(tmp_path_factory.mktemp("folders") / "study", shifted(5))


@pytest.mark.parametrize("command", ["diagnose", "explain", "limits", "fit"])
def test_a_scan_that_is_not_there_is_said_and_leaves_no_folder(study, command, tmp_path):
    lost = shutil.copytree(study.parent, tmp_path / "lost")
    (lost / "scan.csv").unlink()
    said = sentence_of(palpmap(command, lost / study.name, "--out", tmp_path / "run"))
    assert "scan.csv" in said
    assert "check the path" in said
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("words", [["explain"], ["fit", "--inclusions", "2"]])
def test_the_folder_of_the_study_itself_is_not_written_over(study, words, tmp_path):
    own = shutil.copytree(study.parent, tmp_path / "own")
    before = (own / "study.toml").read_bytes()
    said = sentence_of(palpmap(*words, own / "study.toml", "--out", own))
    assert "would be replaced" in said
    assert (own / "study.toml").read_bytes() == before


def test_a_second_trial_does_not_go_into_the_folder_of_the_first(tmp_path):
    make_trial(tmp_path, Trial(3, ("force_bias",), (0.03,), 1), per_side=2)
    scan = (tmp_path / "scan.csv").read_bytes()
    said = sentence_of(palpmap("blind", "--seed", "8", "--out", tmp_path))
    assert "holds a blind trial already" in said
    assert (tmp_path / "scan.csv").read_bytes() == scan


@pytest.mark.slow
def test_a_trial_that_was_stopped_after_further_presses_is_begun_anew(tmp_path):
    folder = tmp_path / "0"
    program = tmp_path / "next.csv"
    write_program(grid_program(per_side=2, radii_m=(0.005,)), program)
    game = tournament.Game(0, str(folder), Trial(3, ("force_bias",), (0.05,), 1), 1)
    seen: list[int] = []

    def explain(study, out, seed):
        seen.append(len(read_scan(load_study(study).scan).press_ids))
        group = [["force_bias", "contact_offset"]]
        return result("ambiguous", (), group, next_presses=[{"program": str(program)}])

    first = tournament.play(game, explain, 3)
    again = tournament.play(game, explain, 3)
    assert seen == [9, 13, 9, 13]
    assert first.outcome == again.outcome == "honest"


def test_a_tournament_of_plain_scans_that_does_not_say_so_goes_on(tmp_path):
    (tmp_path / "settings.json").write_text('{"effects": [], "seed": 1}\n')
    plain = {"effects": [], "mixed": False, "further": 0, "seed": 1}
    assert tournament.earlier_games(tmp_path, plain) == {}
    with pytest.raises(ValueError, match="not --plain"):
        tournament.earlier_games(tmp_path, {**plain, "mixed": True})
    (tmp_path / "settings.json").write_text('{"effects": [')
    with pytest.raises(ValueError, match="not JSON"):
        tournament.earlier_games(tmp_path, plain)


@pytest.mark.parametrize("answer", ["none,force_drift", "force_drift, unexplained"])
def test_an_answer_that_contradicts_itself_is_refused(answer, tmp_path):
    make_trial(tmp_path, Trial(3, ("force_bias",), (0.03,), 1), per_side=2)
    said = sentence_of(palpmap("reveal", tmp_path, "--answer", answer))
    assert "alone" in said


def test_units_that_look_odd_are_asked_about_with_the_study_not_where_scans_are_joined(
    study, tmp_path
):
    strong = read_scan(study.parent / "scan.csv")
    for number in (1, 2):
        table = replace(strong, force_n=300.0 * number * strong.force_n)
        write_scan(table, tmp_path / f"{number}.csv")
    words = [tmp_path / "1.csv", tmp_path / "2.csv", "--pause", "60"]
    assert palpmap("join", *words, "--out", tmp_path / "both.csv").exit_code == 0
    with pytest.raises(ValueError, match="units_checked"):
        read_scan(tmp_path / "both.csv")


@pytest.mark.parametrize("shape", ["block", "from-contacts"])
def test_a_joined_scan_has_the_study_of_the_first_one(study, shape, tmp_path):
    first, known = tmp_path / "study.toml", load_study(study)
    if shape == "from-contacts":
        known = known.model_copy(
            update={"body": Body(shape=shape, thickness_m=0.03, poisson_ratio=0.49)}  # pyright: ignore[reportCallIssue]
        )
    write_study(known, first)
    scan = read_scan(study.parent / "scan.csv")
    write_scan(scan.replace(force_n=1.01 * scan.force_n), tmp_path / "new.csv")
    words = [study.parent / "scan.csv", tmp_path / "new.csv", "--pause", "60", "--study", first]
    done = palpmap("join", *words, "--out", tmp_path / "both.csv")
    assert done.exit_code == 0, done.output
    joined, before = load_study(tmp_path / "both.toml"), load_study(first)
    assert joined.scan == (tmp_path / "both.csv").resolve()
    assert joined.body.file == (None if shape == "block" else joined.scan)
    assert (joined.noise, joined.probe, joined.map) == (before.noise, before.probe, before.map)
    for name in ("both.csv", "new.toml"):  # the study's file would be that of the scan
        said = sentence_of(palpmap("join", *words, "--out", tmp_path / name))
        assert name in said or "both.toml" in said
    said = sentence_of(palpmap("join", *words, "--out", tmp_path / "both.parquet"))
    assert "both.toml: is already there" in said
    assert not (tmp_path / "both.parquet").exists()


def test_presses_that_were_too_many_are_counted_aloud():
    record = ExplainRecord(verdict="explained", added=(), ambiguous=())
    says = presses_sentences(record.changed(presses_used=200, presses_left_out=25))
    assert says == [
        "200 of 225 presses, evenly spread, were used: time and memory grow with their number."
    ]
    assert not presses_sentences(record.changed(presses_used=81))


def without(scan: Scan, *phases: str) -> Scan:
    return scan.rows(~np.isin(scan.phase, phases))


@pytest.mark.parametrize("phases", [("unload",), ("hold", "unload")])
def test_what_is_proposed_after_a_scan_without_unloading_can_be_made(study, phases, tmp_path):
    scan = without(read_scan(study.parent / "scan.csv"), *phases)
    readings = Readings.of(scan)
    sites = Sites.of(scan, load_study(study))
    write_presses(presses_of(readings), sites, tmp_path / "next.csv")
    program = read_program(tmp_path / "next.csv")
    assert len(program) == readings.presses
    assert "z_m" not in (tmp_path / "next.csv").read_text()  # level, and pressed straight down
    assert_allclose(program.x_m, scan.contact_points[:, 0], rtol=1e-8)
    assert program.unload_s.min() > 0
    assert program.hold_s.min() > 0


def test_a_program_is_in_the_frame_of_the_study(tmp_path):
    known = default_study()
    body = known.body.model_copy(update={"origin_m": (-0.1, 0.02, 0.3)})
    elsewhere = known.model_copy(update={"body": body})
    program = grid_program(per_side=3)
    moved = replace(program, x_m=program.x_m - 0.1, y_m=program.y_m + 0.02)
    write_program(moved, tmp_path / "moved.csv")
    plan = program_plan_of(elsewhere, read_program(tmp_path / "moved.csv"))
    assert_allclose(plan.points_m, program_plan_of(known, program).points_m, atol=1e-8)
    write_study(elsewhere, tmp_path / "study.toml")
    program_file, run = tmp_path / "program.csv", tmp_path / "run"
    write_program(program, program_file)
    said = sentence_of(
        palpmap("scan", "--study", tmp_path / "study.toml", "--program", program_file, "--out", run)
    )
    assert "hangs over the edge" in said
    assert not run.exists()


def test_the_settings_of_a_scan_say_what_was_made(tmp_path):
    write_program(grid_program(per_side=2), tmp_path / "four.csv")
    words = ["--program", tmp_path / "four.csv", "--plant", "force_bias:4", "--json"]
    made = palpmap("scan", *words, "--out", tmp_path / "run")
    assert made.exit_code == 0, made.output
    (run,) = json.loads((tmp_path / "run" / "run.json").read_text())["runs"]
    assert run["settings"] == {"plant": [["force_bias", 0.04]]}
    both = palpmap("scan", "--program", tmp_path / "four.csv", "--presses-per-side", "3")
    assert both.exit_code == 2


def test_programs_of_planned_scans_are_those_of_the_latest_limits(study, tmp_path):
    scan = read_scan(study.parent / "scan.csv")
    presses, sites = presses_of(Readings.of(scan)), Sites.of(scan, load_study(study))
    for force in (1.0, 2.0):
        harder = replace(presses, force_n=force * presses.force_n)
        limits: Any = (SimpleNamespace(name="breathing", smallest_share=0.1),)
        better = BetterScans(mixed=Improvement(Design("two_forces", "", harder), limits))
        write_planned(better, sites, tmp_path)
    written = read_program(tmp_path / "scan_two_forces.csv")
    assert_allclose(written.force_n, 2 * presses.force_n, rtol=1e-5)


def test_a_scan_says_what_its_next_presses_may_press_with(tmp_path):
    """As much as the laboratory bears, or as was asked for."""
    for force, most in ((0.3, 1.0), (1.5, 1.5)):
        run = tmp_path / f"{force:g}"
        words = ["--presses-per-side", "2", "--force", force, "--out", run, "--quiet"]
        assert palpmap("scan", *words).exit_code in (0, 1)
        assert load_study(run / "study.toml").probe.most_force_n == most
