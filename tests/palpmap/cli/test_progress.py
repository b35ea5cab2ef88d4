"""A command tells its share and the time left: on a bar in a terminal, else a line a stage."""

import re
import time

from rich.console import Console

from palpmap.console import Output
from palpmap.progress import DIAGNOSE, EXPLAIN, FIT, LIMITS, Course, in_words

STEPS = ["meshing the body", "fitting the map", "analysing the residual"]
STEPS += [f"scoring effect_{k}" for k in range(45)]


def test_the_share_rises_to_one_and_never_falls():
    for stages in (FIT, DIAGNOSE, LIMITS, EXPLAIN):
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


def test_on_a_terminal_the_bar_has_share_and_time_left(monkeypatch):
    console = Console(force_terminal=True, width=120, record=True)
    with Output().progress() as bar:
        number = bar.add_task("scoring", total=1.0, completed=0, ends_s=time.monotonic() + 61.0)
        bar.update(number, completed=0.25)
        console.print(bar.get_renderable())
        bar.update(number, completed=0.0, ends_s=None)
        console.print(bar.get_renderable())
    first, second = console.export_text().splitlines()
    assert re.search(r"scoring .* 25% .* left about 60 s", first)
    assert re.search(r"scoring .* 0% .* left \.\.\.", second)


def test_durations_in_words():
    assert [in_words(s) for s in (0.2, 12, 88, 95, 700)] == [
        "5 s",
        "15 s",
        "90 s",
        "2 min",
        "12 min",
    ]
