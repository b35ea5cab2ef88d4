"""A command tells its share and the time left: on a bar in a terminal, else a line a stage."""

import io
import json
import re
import subprocess
import sys
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from rich.console import Console

from palpmap.console import Output
from palpmap.progress import (
    DEMO,
    DIAGNOSE,
    EXPLAIN,
    FIT,
    LIMITS,
    Course,
    counted,
    in_words,
    scan_stages,
)

STUDY = Path(__file__).parents[2] / "data" / "twelve_presses" / "study.toml"
STEPS = ["meshing the body", "fitting the map", "analysing the residual"]
STEPS += [f"scoring effect_{k}" for k in range(45)]


def test_the_share_rises_to_one_and_never_falls():
    for stages in (DEMO, FIT, DIAGNOSE, LIMITS, EXPLAIN):
        course = Course(stages)
        rounds = [*STEPS, *(f"trying effect_{k}" for k in range(9)), "refitting with x"] * 3
        words = [*rounds, "computing detection limits", "planning a scan", "comparing and drawing"]
        shares = [course.at(text) for text in words]
        assert shares == sorted(shares)
        assert shares[0] == 0.0
        assert 0.4 < shares[-1] < 1.0


def test_without_a_terminal_each_stage_is_a_line_with_share_and_time_left(capsys, monkeypatch):
    clock = iter(range(0, 10_000, 2))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)) / 4)
    with Output().task(DIAGNOSE) as task:
        for text in STEPS:
            task.say(text)
    lines = capsys.readouterr().err.splitlines()
    said = [line for line in lines if re.match(r" +\d+\.\d s +\d+ %  [a-z]+ing ", line)]
    assert 3 < len(said) < len(STEPS) / 2
    assert all("left)" in line for line in said[2:])
    assert max(map(len, said)) < 80


def test_counted_steps_are_told_by_share_some_seconds_apart(capsys, monkeypatch):
    clock = iter(range(10_000))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    with Output().task(scan_stages(81)) as task:
        task.say("meshing the body")
        task.say("scanning")
        for _ in range(81):
            task.advance()
    lines = capsys.readouterr().err.splitlines()
    assert 10 < len(lines) < 60
    assert re.fullmatch(r" +\d+\.\d s +\d+ %  scanning \(about \d+ s left\)", lines[-3])
    assert re.fullmatch(r" +\d+\.\d s  100 %  done", lines[-1])


def test_a_task_that_fails_is_not_told_as_done(capsys):
    with pytest.raises(AttributeError), Output().task(FIT) as task:
        task.say(None)  # pyright: ignore[reportArgumentType]
    assert "done" not in capsys.readouterr().err


@pytest.mark.parametrize("step", ["scoring tool_compliance_lateral and a name of 60 letters", "x"])
def test_on_a_terminal_of_80_columns_share_and_time_left_are_seen_whole(monkeypatch, step):
    screen = io.StringIO()
    made = partial(Console, file=screen, force_terminal=True, width=80, color_system=None)
    monkeypatch.setattr("palpmap.progress.LastingConsole", lambda **_: made())
    real = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: 2000 * real())
    with Output().task(counted(step, 3)) as task:
        task.say(step)
        time.sleep(0.2)
        task.advance()
        time.sleep(0.2)
    seen = screen.getvalue()
    shown = re.split(r"[\r\n]+|\x1b\[[0-9?]+[A-Za-z]", seen)
    bar = next(line for line in shown if "left" in line)
    assert len(bar) <= 80
    assert re.search(r" 33% +\d:\d\d:\d\d +about \d+ min left", bar)
    assert any(re.search(r"^done .*100% +\d:\d\d:\d\d *$", line) for line in shown)


def test_durations_in_words():
    assert [in_words(s) for s in (0.2, 12, 88, 95, 700)] == [
        "5 s",
        "15 s",
        "90 s",
        "2 min",
        "12 min",
    ]


@pytest.mark.skipif(sys.platform == "win32", reason="pipes are closed otherwise there")
def test_a_run_outlives_a_reader_who_leaves(tmp_path):
    """`palpmap fit ... 2>&1 | head -1`: the folder is whole, as nothing was lost but lines."""
    command = [sys.executable, "-m", "palpmap", "fit", str(STUDY), "--out", str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
        assert run.stdout is not None
        assert b"meshing" in run.stdout.readline()
        run.stdout.close()
        assert run.wait(120) == 0
    (entry,) = json.loads((tmp_path / "run" / "run.json").read_text())["runs"]
    assert entry["outcome"] == "done"
    assert (tmp_path / "run" / "report.html").exists()


def test_a_stage_that_lasts_longer_than_usual_goes_on_and_the_share_never_falls():
    course = Course(EXPLAIN)
    words = [
        "meshing",
        "fitting",
        "analysing",
        "trying",
        "scoring",
        *["trying x", "testing y"] * 60,
    ]
    shares = [course.at(text) for text in [*words, "computing", "looking"]]
    assert all(before <= after for before, after in pairwise(shares))
    over = shares[-40:-2]
    assert all(before < after for before, after in pairwise(over))
    assert shares[-1] < 1


def searched(say, counts=((1, 45), (46, 270), (271, 310))):
    """Tell the steps of a search for a contact law, whose number grows as it goes on."""
    ends = [first for first, _ in counts[1:]] + [counts[-1][1] + 1]
    for (first, most), end in zip(counts, ends, strict=True):
        for number in range(first, end):
            say(f"fitting the presses alone with play ({number} of {most})")


@pytest.mark.parametrize("before", ["meshing", "looking"])
def test_a_search_of_counted_sets_moves_on_wherever_it_is_made(before):
    course, told = Course(EXPLAIN), []
    words = ["meshing", "fitting", "analysing", "trying", "scoring", "testing", "computing"]
    for text in [*words, "looking"] if before == "looking" else [before]:
        course.at(text)
    prefix = "without presses 3, 4: " if before == "looking" else ""
    searched(lambda text: told.append((course.at(prefix + text), course.share())))
    shown, done = zip(*told, strict=True)
    assert all(one < other for one, other in pairwise(shown[1:44]))
    assert all(one <= other for one, other in pairwise(shown))
    assert all(before < after for before, after in zip(shown, shown[40:], strict=False))
    assert 0 < shown[-1] < 1
    left = [1 - share for share in done]
    assert left[50] > 1.2 * left[260]
    assert left[50] > 0.05


def test_the_time_left_is_not_that_of_a_stage_nearly_over_while_a_law_is_sought_again(
    capsys, monkeypatch
):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with Output().task(EXPLAIN) as task:

        def say(text):
            task.say(text)
            now[0] += 0.5

        for text in ["meshing", "fitting", "analysing", "trying", "scoring", "testing"]:
            now[0] += 10
            say(text)
        searched(lambda text: say(f"without presses 3, 4: {text}"))
    lines = capsys.readouterr().err.splitlines()
    said = [line for line in lines if "without presses" in line]
    assert len(said) > 10
    assert len({line.split("%")[0].split()[-1] for line in said}) > 4  # the share moves
    early = [line for line in said if "(50 of" in line or re.search(r"\((4|5|6)\d of 270", line)]
    assert early
    assert all(re.search(r"about \d+ (s|min) left", line) for line in early)
    assert not any("about 5 s left" in line or "about 10 s left" in line for line in early)


def test_many_quick_steps_of_a_stage_do_not_count_for_the_rest_of_the_command():
    course = Course(EXPLAIN)
    for text in ("meshing the body", "fitting the map"):
        course.at(text)
    for _ in range(100):
        course.again()
    assert 0.2 < course.share() < 0.6
