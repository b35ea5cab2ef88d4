"""Blind trials: what is sealed stays sealed, what is judged is judged as the table says."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import palpmap as pm
from models.errors import InputError
from models.press_program import PressProgram
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.blind import tournament
from palpmap.blind.further_presses import press_further
from palpmap.blind.layout import SMALL, draw_map, usual_layout, varied_layout
from palpmap.blind.records import (
    AnswerRecord,
    CoverageRecord,
    MapErrorRecord,
    TrialLine,
    TrialTruthRecord,
)
from palpmap.blind.reveal import stated
from palpmap.blind.score import map_errors, score_blind
from palpmap.blind.seal import seal, unseal
from palpmap.blind.statistics import tournament_record, tournament_screen
from palpmap.blind.trial import Conditions, Trial, draw_trial, make_trial
from palpmap.result.next_scan import REPEAT
from palpmap.study.placement import place_scan
from palpmap.study.study import load_study
from tests.paths import ROOT

RUN = CliRunner()


def answer(*effects):
    """Answer with effects given as (name, category, size)."""
    keys = ("name", "category", "size", "kin")
    spot = {"weight_pa": 9000.0, "x_m": 0.04, "y_m": 0.05, "z_m": 0.03, "radius_m": 0.01}
    body = {"background_pa": 5000.0, "inclusions": [spot]}
    hidden = [dict(zip(keys, e, strict=False)) for e in effects]
    return TrialTruthRecord.model_validate({"effects": hidden, "body": body})


def result(verdict, added=(), ambiguous=(), **more):
    found = {"verdict": verdict, "added": added, "ambiguous": ambiguous, **more}
    return AnswerRecord.model_validate(found)


CREEP = ("viscoelasticity", "structured", 0.03)
TOOL = ("tool_compliance", "compliance", 0.03)
LATE = ("outside_stick_slip", "outsider", 0.05)
BIAS = ("force_bias", "structured", 0.02)
FORM = ("form_broad_creep", "form", 0.05, ("viscoelasticity", "two_time_creep"))

JUDGED = [
    (answer(), result("nothing_missing"), "none", "right", True),
    (answer(), result("explained", ["force_bias"]), "none", "wrong", False),
    (answer(), result("ambiguous", (), [["skin_layer", "mesh_error"]]), "none", "wrong", False),
    (answer(), result("unexplained"), "none", "honest", False),
    (answer(CREEP), result("explained", ["viscoelasticity"]), "structured", "right", True),
    (answer(CREEP), result("explained", ["hysteresis"]), "structured", "wrong", False),
    (answer(CREEP), result("explained", ["hysteresis", "viscoelasticity"]), "structured", "wrong",
     False),
    (answer(CREEP), result("nothing_missing"), "structured", "missed", False),
    (answer(CREEP), result("nothing_missing", detection_limits={"viscoelasticity": 0.05}),
     "structured", "honest", False),
    (answer(CREEP), result("unexplained"), "structured", "honest", False),
    (answer(CREEP), result("ambiguous", (), [["viscoelasticity", "hysteresis"]]), "structured",
     "honest", False),
    (answer(TOOL), result("explained", ["tool_compliance"]), "compliance", "right", True),
    (answer(TOOL), result("ambiguous", (), [["mesh_error", "tool_compliance", "skin_layer"]]),
     "compliance", "right", True),
    (answer(TOOL), result("ambiguous", (), [["a", "b", "c", "tool_compliance"]]), "compliance",
     "honest", False),
    (answer(TOOL), result("nothing_missing", detection_limits={"tool_compliance": 0.05}),
     "compliance", "honest", True),
    (answer(TOOL), result("nothing_missing", detection_limits={"tool_compliance": 0.02}),
     "compliance", "missed", False),
    (answer(TOOL), result("nothing_missing", never_seen=["tool_compliance"]), "compliance",
     "honest", True),
    (answer(TOOL), result("nothing_missing", never_seen=["skin_layer"]), "compliance", "missed",
     False),
    (answer(TOOL), result("explained", ["skin_layer"], detection_limits={"tool_compliance": 0.05}),
     "compliance", "wrong", False),
    (answer(LATE), result("unexplained"), "outsider", "right", True),
    (answer(LATE), result("unexplained", ["hysteresis"]), "outsider", "right", True),
    (answer(LATE), result("explained", ["hysteresis"]), "outsider", "wrong", False),
    (answer(LATE), result("nothing_missing"), "outsider", "missed", True),
    (answer(LATE), result("ambiguous", (), [["a", "b"]]), "outsider", "honest", True),
    (answer(LATE), result("ambiguous", ["hysteresis"], [["a", "b"]]), "outsider", "wrong", False),
    (answer(FORM), result("explained", ["two_time_creep"]), "form", "right", True),
    (answer(FORM), result("explained", ["two_time_creep", "force_bias"]), "form", "wrong", True),
    (answer(FORM), result("unexplained", ["force_bias"]), "form", "wrong", False),
    (answer(FORM), result("unexplained"), "form", "honest", False),
    (answer(FORM), result("nothing_missing"), "form", "missed", False),
    (answer(FORM), result("nothing_missing", detection_limits={"viscoelasticity": 0.06}),
     "form", "honest", False),
    (answer(FORM), result("nothing_missing", detection_limits={"viscoelasticity": 0.06,
     "two_time_creep": 0.04}), "form", "missed", False),
    (answer(CREEP, BIAS), result("explained", ["force_bias", "viscoelasticity"]), "pair", "right",
     True),
    (answer(CREEP, BIAS), result("explained", ["force_bias"]), "pair", "wrong", False),
    (answer(CREEP, BIAS), result("unexplained", ["force_bias"]), "pair", "honest", False),
]  # fmt: skip


@pytest.mark.parametrize(("hidden", "found", "category", "outcome", "passed"), JUDGED)
def test_an_answer_is_judged_as_the_table_says(hidden, found, category, outcome, passed):
    score = score_blind(found, hidden.effects)
    assert (score.category, score.outcome, score.passed) == (category, outcome, passed)
    assert score.reason.endswith(".")


def test_the_nearest_of_the_catalogue_is_honest_for_its_own_outsider_only():
    (effect,) = answer(("outside_creeping_inclusion", "outsider", 0.05)).effects
    hidden = (effect.changed(kin=("viscoelasticity",)),)
    near = result("explained", ["viscoelasticity"])
    assert score_blind(near, hidden).outcome == "honest"
    both = result("explained", ["viscoelasticity", "force_bias"])
    assert score_blind(both, hidden).outcome == "wrong"


def test_map_errors_pair_found_with_true_values():
    parameters = {"inclusion_1.x_m": {"value": 0.041, "std": 2e-4}}
    (row,) = map_errors(result("explained", parameters=parameters), answer())
    assert (row.name, row.found, row.std, row.true) == ("inclusion_1.x_m", 0.041, 2e-4, 0.04)
    assert row.inside is row.unseen_shift is None
    shifts = {"inclusion_1.x_m": {"shift": 2e-3, "effect": "skin_layer", "share": 0.02}}
    (row,) = map_errors(result("explained", parameters=parameters, unseen_shifts=shifts), answer())
    assert row.unseen_shift == 2e-3


def test_what_is_drawn_depends_on_the_seed_alone_and_covers_all_kinds():
    trials = [draw_trial(seed, Conditions()) for seed in range(200)]
    assert trials[7] == draw_trial(7, Conditions())
    assert {len(t.effects) for t in trials} == {0, 1, 2}
    assert any(name.startswith("outside_") for t in trials for name in t.effects)
    sizes = np.array([size for t in trials for size in t.sizes])
    assert sizes.min() < 0.02
    assert sizes.max() > 0.08
    assert ((sizes >= 0.01) & (sizes <= 0.1)).all()
    depths = [0.048 - draw_map(seed).inclusions[0].centre_m[2] for seed in range(50)]
    assert 0.008 <= min(depths) < 0.010
    assert 0.020 < max(depths) <= 0.022


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        (Conditions(("force_drifd",)), "did you mean 'force_drift'"),
        (Conditions(size=0.7), "found a size of 0.7"),
        (Conditions(radii=3), "found 3 tip radii"),
        (Conditions(small=True, varied=True), "found --varied with --small or --robot"),
    ],
)
def test_conditions_that_make_no_sense_are_refused(conditions, message):
    with pytest.raises(InputError, match=message):
        draw_trial(0, conditions)


def test_a_varied_trial_presses_its_block_anywhere_and_differs_from_the_papers():
    layouts = [varied_layout(Trial(seed, (), (), 1 + seed % 2, varied=True)) for seed in range(100)]
    for layout in layouts:
        program, (x, y, z) = layout.program, layout.size_m
        (inclusion,) = layout.truth.inclusions
        for at, edge in ((program.x_m, x), (program.y_m, y)):
            assert (at > program.radius_m).all()
            assert (at < edge - program.radius_m).all()
        assert 0 < inclusion.centre_m[2] < z
        assert z >= 5 * min(layout.radii_m)
        assert 36 <= len(program) <= 121
    sizes = np.array([layout.size_m for layout in layouts])
    assert sizes[:, 0].min() < 0.05
    assert sizes[:, 0].max() > 0.2
    felt = [np.ptp(lay.program.x_m) / lay.size_m[0] for lay in layouts]
    assert min(felt) < 0.2
    assert max(felt) > 0.7
    assert {len(layout.radii_m) for layout in layouts} == {1, 2}


def test_a_varied_trial_states_its_block_and_is_pressed_further(tmp_path):
    trial = Trial(46, ("force_bias",), (0.05,), 1, varied=True)
    layout = varied_layout(trial)
    make_trial(tmp_path, trial)
    study, sealed = load_study(tmp_path / "study.toml"), unseal(tmp_path)
    assert study.body.size_m == pytest.approx(layout.size_m)
    assert study.body.poisson_ratio == sealed.poisson_ratio == layout.poisson_ratio
    assert sealed.divisions == layout.divisions
    scan = read_scan(study.scan)
    travel = scan.displacement_m.max()
    assert 0.002 < study.noise.displacement_m / travel < 0.02
    (name,) = [e.name for e in sealed.effects]
    assert name == "force_bias"
    few = {f.name: getattr(layout.program, f.name)[:4] for f in fields(PressProgram)}
    press_further(tmp_path, PressProgram(**few))
    assert len(read_scan(tmp_path / "scan_2.csv").press_ids) == len(layout.program) + 4
    again = unseal(tmp_path).compliance_m_per_n
    np.testing.assert_allclose(again[-4:], again[:4], rtol=1e-9)  # one body, one mesh


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """A small trial with two radii."""
    folder = tmp_path_factory.mktemp("blind")
    make_trial(folder, Trial(3, ("force_bias", "breathing"), (0.03, 0.03), 2), per_side=3)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("radii", [1, 2])
def test_the_tips_of_a_small_trial_lie_on_its_block(tmp_path, radii):
    make_trial(tmp_path, Trial(3, (), (), radii, small=True))
    study = load_study(tmp_path / "study.toml")
    placed = place_scan(read_scan(study.scan), study).scan
    size, reach = study.body.size_m, placed.contact_radii[:, None]
    assert len(np.unique(placed.contact_radii)) == radii
    assert np.all(placed.contact_points[:, :2] >= reach)
    assert np.all(placed.contact_points[:, :2] <= np.array(size[:2]) - reach)


def test_a_trial_is_a_study_that_places_and_its_answer_is_not_in_plain_text(trial):
    study = load_study(trial / "study.toml")
    scan = place_scan(read_scan(study.scan), study).scan
    radii, counts = np.unique(scan.contact_radii, return_counts=True)
    assert radii == pytest.approx([0.003, 0.010])
    assert counts.tolist() == [5, 4]
    assert [e.name for e in unseal(trial).effects] == ["force_bias", "breathing"]
    for path in trial.rglob("*"):
        if path.is_file():
            assert "force_bias" not in path.read_text()


def test_a_changed_answer_is_refused(trial, tmp_path):
    seal(tmp_path, unseal(trial))
    path = tmp_path / "sealed" / "answer.json"
    record = json.loads(path.read_text())
    record["sha256"] = "0" * 64
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match="was changed or cut off"):
        unseal(tmp_path)


def test_only_blind_reveal_and_tournament_know_of_the_seal():
    knows = {
        path.stem
        for package in ("palpmap", "identify")
        for path in (ROOT / package).rglob("*.py")
        if "palpmap.blind.seal" in path.read_text() or "sealed/" in path.read_text()
    }
    assert knows == {"trial", "further_presses", "reveal", "tournament", "seal"}


WATCHED = """
import sys
from pathlib import Path
trial = Path(sys.argv[1])
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
from palpmap.blind.tournament import explain_trial
record = explain_trial(trial / "study.toml", trial, 0)
assert any(name.endswith("scan.csv") for name in opened)
assert not [name for name in opened if "sealed" in Path(name).parts]
print(record.verdict)
"""


@pytest.mark.slow
def test_explain_opens_nothing_under_the_seal(tmp_path):
    words = ["blind", "--seed", "3", "--effects", "force_bias", "--size", "5"]
    made = RUN.invoke(app, [*words, "--out", str(tmp_path / "trial"), "--json"])
    assert made.exit_code == 0, made.output
    words = [sys.executable, "-c", WATCHED, str(tmp_path / "trial")]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    told = RUN.invoke(app, ["reveal", str(tmp_path / "trial"), "--json"])
    assert json.loads(told.stdout)["outcome"] == "right", told.stdout


PROGRAM = """x_m,y_m,radius_m,force_n,ramp_s,hold_s
0.03,0.04,0.003,0.2,1,1
0.05,0.06,0.010,0.4,1,1
"""


def test_further_presses_join_the_trial_and_its_answer_stays_sealed(trial, tmp_path):
    folder = shutil.copytree(trial, tmp_path / "trial")
    before = unseal(folder)
    program = tmp_path / "next.csv"
    program.write_text(PROGRAM)
    for number, presses in ((2, 11), (3, 13)):
        done = RUN.invoke(app, ["press", str(folder), str(program)])
        assert done.exit_code == 0, done.output
        assert "force_bias" not in done.output
        study = load_study(folder / f"study_{number}.toml")
        scan = place_scan(read_scan(study.scan), study).scan
        assert len(scan.press_ids) == presses
        assert scan.contact_radii[-2:].tolist() == [0.003, 0.010]
        earlier = read_scan(folder / ("scan.csv" if number == 2 else f"scan_{number - 1}.csv"))
        assert (scan.force_n[: len(earlier)] == earlier.force_n).all()
    assert (folder / "scan.csv").read_bytes() == (trial / "scan.csv").read_bytes()
    assert unseal(folder).effects == before.effects
    assert load_study(folder / "study_3.toml").noise == load_study(folder / "study.toml").noise


def test_further_presses_need_a_trial_and_a_program(trial, tmp_path):
    program = tmp_path / "next.csv"
    for folder, says in ((tmp_path, "a folder that `palpmap blind` has made"),
                         (trial, "next.csv: cannot be read as a press program")):  # fmt: skip
        refused = RUN.invoke(app, ["press", str(folder), str(program)])
        assert refused.exit_code == 2
        assert says in " ".join(refused.stderr.split())
    assert not (trial / "study_2.toml").exists()


@pytest.mark.slow
def test_a_game_makes_the_presses_that_an_ambiguous_answer_proposes(tmp_path):
    """New places, or the outlying presses once more where these leave the answer open."""
    game = tournament.Game(0, str(tmp_path / "0"), Trial(3, ("force_bias",), (0.05,), 1), 2)
    (tmp_path / "0").mkdir()
    (tmp_path / "0" / REPEAT).write_text(PROGRAM)
    seen = []

    def explain(study, out, seed):
        presses = len(read_scan(load_study(study).scan).press_ids)
        seen.append(presses)
        if presses > 9:
            return result("explained", ["force_bias"])
        group = [["force_bias", "contact_offset"]]
        return result("ambiguous", (), group, next_presses=[{"program": REPEAT}])

    played = tournament.play(game, explain, 3)
    assert seen == [9, 11]
    assert (played.outcome, played.further_presses) == ("right", 2)
    assert played.at_first.verdict == "ambiguous"
    once = tournament.Game(1, str(tmp_path / "1"), game.trial)
    shutil.copytree(tmp_path / "0", tmp_path / "1", ignore=lambda *_: ["study_2.toml"])
    assert tournament.play(once, explain, 3).outcome == "honest"


@pytest.mark.slow
def test_presses_that_explain_proposes_decide_what_was_ambiguous(tmp_path):
    """An offset of 1 % with one tip is not told from a force bias; some 40 presses tell it."""
    trial = tmp_path / "trial"
    words = ["blind", "--plain", "--seed", "1000004", "--effects", "contact_offset", "--size", "1"]
    assert RUN.invoke(app, [*words, "--out", str(trial)]).exit_code == 0
    unsure = RUN.invoke(
        app, ["explain", str(trial / "study.toml"), "--out", str(trial / "first"), "--json"]
    )
    assert unsure.exit_code == 1
    record = json.loads(unsure.stdout)
    assert {"contact_offset", "force_bias"} <= set(record["ambiguous"][0])
    program = trial / "first" / record["next_presses"][0]["program"]
    assert record["next_presses"][0]["presses"] < 81
    assert RUN.invoke(app, ["press", str(trial), str(program)]).exit_code == 0
    sure = RUN.invoke(
        app, ["explain", str(trial / "study_2.toml"), "--out", str(trial / "second"), "--json"]
    )
    assert json.loads(sure.stdout)["added"] == ["contact_offset"], sure.stdout
    told = RUN.invoke(app, ["reveal", str(trial), "--json"])
    assert json.loads(told.stdout)["outcome"] == "right"


def test_reveal_shows_hidden_beside_found_and_judges(trial):
    # Not a result.json: is not looked at
    result("explained", ["force_bias"]).write(trial / "explained.json")
    missing = RUN.invoke(app, ["reveal", str(trial)])
    assert missing.exit_code == 2
    assert "found no result.json" in missing.stderr
    found = result(
        "explained",
        ["breathing", "force_bias"],
        parameters={"background_pa": {"value": 6000.0, "std": 50.0}},
    )
    (trial / "explained").mkdir()
    found.write(trial / "explained" / "result.json")
    done = RUN.invoke(app, ["reveal", str(trial), "--json"])
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    assert (record["outcome"], record["category"]) == ("right", "pair")
    assert record["map"][0]["found"] == 6000.0
    screen = RUN.invoke(app, ["reveal", str(trial)]).stdout
    assert "right" in screen
    assert "background_pa" in screen
    wrong = RUN.invoke(app, ["reveal", str(trial), "--answer", "hysteresis", "--json"])
    assert wrong.exit_code == 1
    assert json.loads(wrong.stdout)["outcome"] == "wrong"


def test_an_answer_by_hand_is_checked():
    assert stated("unexplained").verdict == "unexplained"
    with pytest.raises(InputError, match="found 'gravity', expected none, unexplained"):
        stated("gravity")


def line(number, hidden, added, category, outcome, verdict="explained"):
    return TrialLine(
        number=number, hidden=tuple(hidden), added=tuple(added), verdict=verdict,
        category=category, outcome=outcome, passed=outcome == "right",
    )  # fmt: skip


def test_a_tournament_counts_by_category_and_by_what_was_named_for_what():
    lines = [
        line(0, ["force_bias"], ["force_bias"], "structured", "right"),
        line(1, ["force_bias"], ["breathing"], "structured", "wrong"),
        line(2, [], [], "none", "right", "nothing_missing"),
        TrialLine(number=3, hidden=(), error="ValueError: no"),
    ]
    record = tournament_record(lines).to_dict()
    assert record["categories"]["structured"] == {
        "trials": 2, "passed": 1, "right": 1, "honest": 0, "missed": 0, "wrong": 1,
    }  # fmt: skip
    assert record["confusion"]["force_bias"] == {"force_bias": 1, "breathing": 1}
    assert record["confusion"]["none"] == {"nothing_missing": 1}
    assert (record["failed"], record["errors"]) == (1, ["ValueError: no"])
    assert record["coverage"] == {}


def test_a_tournament_counts_how_often_intervals_held_where_the_answer_was_right():
    held, missed, bare = (
        MapErrorRecord(name="background_pa", found=1.0, true=1.0, inside=inside)
        for inside in (True, False, None)
    )
    right = line(0, ["force_bias"], ["force_bias"], "structured", "right")
    nothing = line(1, [], [], "none", "right", "nothing_missing")
    group = line(2, ["breathing"], [], "structured", "right", "ambiguous")
    wrong = line(3, ["force_bias"], ["breathing"], "structured", "wrong")
    lines = [right.changed(map=(held,)), nothing.changed(map=(missed, bare))]
    lines += [group.changed(map=(missed,)), wrong.changed(map=(missed,))]
    record = tournament_record(lines)
    assert record.coverage == {"background_pa": CoverageRecord(intervals=2, held=1)}
    assert "held the truth 1 of 2 times" in tournament_screen(record)[-1]


def test_without_a_choice_everything_that_can_be_hidden_takes_its_turn(tmp_path):
    from sim.planted.catalogue import HIDDEN, INSIDERS, OUTSIDERS

    games = tournament.draw_games(tmp_path, len(HIDDEN) + 8, Conditions(), 5)
    single = {g.trial.effects[0] for g in games if len(g.trial.effects) == 1}
    assert single >= {*INSIDERS, *OUTSIDERS}
    assert any(g.trial.effects == () for g in games)
    assert any(len(g.trial.effects) == 2 for g in games)
    assert len({g.trial.seed for g in games}) == len(games)


def test_a_stopped_tournament_goes_on_and_refuses_other_settings(tmp_path):
    settings = {"effects": [], "seed": 1}
    assert tournament.earlier_games(tmp_path, settings) == {}
    whole = line(4, [], [], "none", "right", "nothing_missing")
    (tmp_path / "trials.jsonl").write_text(whole.to_json() + '\n{"number": 5, "hid')
    assert tournament.earlier_games(tmp_path, settings) == {4: whole}
    assert (tmp_path / "trials.jsonl").read_text() == whole.to_json() + "\n"
    with pytest.raises(InputError, match="was begun with"):
        tournament.earlier_games(tmp_path, {**settings, "seed": 2})


def test_a_game_is_made_explained_and_judged_and_a_fault_is_a_line(tmp_path):
    game = tournament.Game(0, str(tmp_path / "0000"), Trial(3, ("force_bias",), (0.05,), 2))

    def explain(study, out, seed):
        assert load_study(study).probe.radius_m == 0.003
        return result("explained", ["force_bias"])

    played = tournament.play(game, explain, 3)
    assert (played.outcome, played.passed) == ("right", True)
    assert played.sizes == pytest.approx([0.05], rel=0.011)
    assert json.loads(played.to_json())["trial"]["seed"] == 3

    def fails(study, out, seed):
        raise ValueError("no")

    assert tournament.play(game, fails, 3).error == "ValueError: no"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes in /proc")
def test_workers_end_with_a_tournament_that_is_killed(tmp_path):
    command = ["-m", "palpmap", "blind", "--tournament", "2", "--workers", "1", "--quiet"]
    told = subprocess.Popen([sys.executable, *command, "--out", tmp_path / "run"], cwd=ROOT)
    try:
        wait_until(lambda: (tmp_path / "run" / "trials" / "0000").exists(), 120)
        workers = children(told.pid)
        assert workers
    finally:
        told.kill()
        told.wait()
    wait_until(lambda: not any(alive(pid) for pid in workers), 20)


def children(parent: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it may end while it is looked at
            if int(stat.read_text().rpartition(")")[2].split()[1]) == parent:
                found.append(int(stat.parent.name))
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(true: Callable[[], bool], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_dask_is_asked_for_in_one_sentence_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    with pytest.raises(InputError, match=r"pip install 'palpmap\[dask\]'"):
        next(tournament.play_dask([], "tcp://localhost:1"))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere://x"])
def test_a_dask_address_at_which_nobody_answers_is_said(address):
    dask = pytest.importorskip("dask")
    pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(InputError, match=f"--dask {address}: no scheduler answers there"),
    ):
        next(tournament.play_dask([], address))


@pytest.mark.slow
def test_a_cluster_plays_and_what_fails_on_it_is_a_line(tmp_path):
    distributed = pytest.importorskip("distributed")
    (tmp_path / "file").touch()
    lost = tournament.Game(
        0, str(tmp_path / "file" / "0000"), Trial(3, ("force_bias",), (0.05,), 1)
    )
    absurd = tournament.Game(1, str(tmp_path / "0001"), Trial(4, ("no_such_effect",), (0.05,), 1))
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1"
    )
    with cluster:
        lines = list(tournament.play_dask([lost, absurd], cluster.scheduler_address))
    errors = {line.number: line.error for line in lines}
    assert errors[0].startswith("NotADirectoryError: ")  # outside of what `play` catches
    assert "no_such_effect" in errors[1]
    assert (tmp_path / "0001").is_dir()  # a worker made it


@pytest.mark.slow  # a grain is left in identify/fit/test_correction, too
def test_a_deep_inclusion_is_not_taken_for_a_hard_grain(tmp_path):
    """Here the coarse mesh's own minimum is a grain a hundred times as hard, 11 mm too deep.

    Depth and weight answer for each other along a valley that is flat for 10 mm, and much bent.
    """
    make_trial(tmp_path, Trial(733, (), (), 1, small=True))
    found = pm.fit(pm.read_study(tmp_path / "study.toml"))
    (true,), (inclusion,) = draw_map(733, SMALL).inclusions, found.map.inclusions
    assert not found.at_bound
    assert inclusion.weight_pa < 5 * true.weight_pa
    truth = dict(zip(("x_m", "y_m", "z_m"), true.centre_m, strict=True))
    truth |= {"weight_pa": true.weight_pa, "radius_m": true.radius_m}
    for key, value in truth.items():
        own = found.parameters[f"inclusion_1.{key}"]
        assert own.lower95 < value < own.upper95, key


@pytest.mark.parametrize("layout", [usual_layout, varied_layout])
def test_a_mixed_trial_rests_early_and_a_plain_one_does_not(layout):
    mixed, plain = (
        layout(Trial(3, ("preconditioning",), (0.03,), 1, mixed)).program for mixed in (True, False)
    )
    assert np.flatnonzero(mixed.pause_s - plain.pause_s).tolist() == [len(plain) // 8]
    assert mixed.pause_s.max() > 10.0


def softness(scan: Scan) -> np.ndarray:
    """Travel over force of each press while it is held, (j,) m/N."""
    held = scan.rows(scan.phase == "hold")
    index = held.press_index
    return np.bincount(index, held.displacement_m) / np.bincount(index, held.force_n)


@pytest.mark.slow
def test_the_robot_presses_a_trial_and_goes_on_where_the_body_stands(tmp_path):
    """The body has softened by what was pressed before; clock and numbers go on."""
    make_trial(tmp_path, Trial(3, ("preconditioning",), (0.3,), 1, False, True, True), per_side=2)
    program = pm.grid_program((0.064, 0.064, 0.032), per_side=2)
    scan = read_scan(load_study(press_further(tmp_path, program)).scan)
    assert scan.press_ids.tolist() == list(range(8))
    assert scan.time_s[scan.press == 4].min() > scan.time_s[scan.press == 3].max() + 55
    answer = unseal(tmp_path)
    assert answer.robot
    assert len(answer.program["x_m"]) == 8
    v = answer.effects[0].values
    softened = 1 + v["share"] * (1 - (1 - 1 / v["presses"]) ** np.arange(8))
    expected = np.log(softened[4:] / softened[:4]).mean()
    soft = softness(scan)
    found = np.log(soft[4:] / soft[:4]).mean()
    assert expected > 0.05
    assert found == pytest.approx(expected, abs=0.015)  # first touch is known to 0.05 mm of 5 mm


@pytest.mark.slow
def test_what_an_earlier_scan_had_planted_acts_again(tmp_path):
    """`scan --truth truth.json`: the same body, the same effects with the same values."""
    first, again = tmp_path / "first", tmp_path / "again"
    plant = ["--plant", "extra_inclusion:8", "--plant", "tool_compliance:12"]
    runs = {first: ["--seed", "1", *plant], again: ["--truth", str(first / "truth.json")]}
    for folder, more in runs.items():
        done = RUN.invoke(app, ["scan", "--presses-per-side", "2", *more, "--out", str(folder)])
        assert done.exit_code == 0, done.output
    said = [json.loads((folder / "truth.json").read_text()) for folder in runs]
    assert said[0] == said[1]
    soft = [softness(read_scan(folder / "scan.csv")) for folder in runs]
    assert np.log(soft[0] / soft[1]).mean() == pytest.approx(0.0, abs=0.015)
    told = json.loads((first / "truth.json").read_text())
    told["effects"][0]["name"] = "sensor_frozen"
    (first / "truth.json").write_text(json.dumps(told))
    done = RUN.invoke(app, ["scan", "--truth", str(first / "truth.json"), "--out", str(again)])
    assert done.exit_code == 2
    assert "found 'sensor_frozen' in the earlier scan" in " ".join(done.stderr.split())
