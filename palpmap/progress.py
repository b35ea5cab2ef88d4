"""The share of a command that is done, told by the words of its steps, and the time left."""

import ctypes
import re
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple, Self

from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column
from rich.text import Text

from palpmap.lasting_console import LastingConsole

FIRST_SHARE = 0.08  # of a course: before it, no time left is estimated
MOST_OF_STAGE = 0.95  # of its usual steps: then the next one is awaited
LINE_S = 5.0  # between two lines of a stage, at least ...
LINE_SHARE = 0.05  # ... and this share of the time so far


_COUNTED = re.compile(r"\((\d+) of (\d+)\)$")  # the end of a counted step's words


class Stage(NamedTuple):
    """A stretch of a command.

    Attributes
    ----------
    words : with which its steps begin
    seconds : that it usually takes, beside the other stages
    steps : usual number of steps that are said in it
    asked : only some scans have it; left over, it counts for nothing
    """

    words: tuple[str, ...]
    seconds: float
    steps: int = 1
    asked: bool = False


_OPEN = (
    Stage(("meshing",), 3),
    Stage(("fitting the presses",), 20, 110, asked=True),
    Stage(("fitting", "trying"), 12, 2),
)
_SCORED = Stage(("analysing", "scoring"), 15, 45)
_TRIED = Stage(("trying", "refitting"), 5, 20)
DEMO = (
    Stage(("solving",), 40), Stage(("scanning",), 25, 81), Stage(("building",), 4),
    Stage(("fitting",), 12, 6), Stage(("comparing",), 4),
)  # fmt: skip
FIT = (Stage(("meshing",), 3), Stage(("fitting",), 20, 12), Stage(("comparing",), 4))
FIT_AND_SAMPLE = (*FIT[:2], Stage(("drawing",), 30, 80), FIT[2])
COUNTED_S = {"fitting all presses": 0.5, "fitting the presses": 0.1}
"""Seconds of a counted step, by its words: on scans of 36 presses by a ball, with time stamps."""
DIAGNOSE = (*_OPEN, Stage(("analysing", "scoring"), 16, 45))
LIMITS = (*_OPEN, Stage(("computing",), 12), Stage(("planning",), 40, 8))
EXPLAIN = (
    *_OPEN, Stage(("without", "seeking"), 40, 60, asked=True), _SCORED, _TRIED, _SCORED, _TRIED,
    Stage(("testing", "fitting", "without"), 4, 3),
    Stage(("computing",), 25), Stage(("looking",), 3),
)  # fmt: skip


def counted(words: str, steps: int) -> tuple[Stage]:
    """Return the one stage of a task of counted steps."""
    return (Stage((words,), 1, max(steps, 1)),)


def scan_stages(presses: int) -> tuple[Stage, ...]:
    """Return the stages of a scan of so many presses."""
    return Stage(("meshing",), 40), Stage(("scanning",), 0.3 * presses, presses)


def read_stages(files: int) -> tuple[Stage, ...]:
    """Return the stages of a recording's import."""
    return Stage(("reading",), 10, files), Stage(("finding", "proposing"), 5)


class Course:
    """How far a command is: it has gone through the stages up to that of its last step.

    A stage may stand twice; a step that belongs to none that follows counts to the present one.
    Words that end with "(2 of 40)" are of a task of counted steps: it takes as long as that many,
    in whatever stage it is, as a search that is made again without some presses.

    >>> course = Course(DIAGNOSE)
    >>> [round(course.at(text), 2) for text in ("meshing the body", "scoring hysteresis")]
    [0.0, 0.48]
    """

    def __init__(self, stages: Sequence[Stage]) -> None:
        self._stages, self._now, self._taken = stages, 0, 0
        self._within = -stages[0].seconds / stages[0].steps  # s of the present stage that are done
        self._counted_from = 0.0  # what was done of it when its counted steps began
        self._seconds = [stage.seconds * (not stage.asked) for stage in stages]
        self._told, self._last, self._fallen = 0.0, 0.0, (0.0, 0.0)

    def at(self, text: str) -> float:
        """Return the share to tell when a step begins, 0 to 1; it never falls."""
        following = range(self._now, len(self._stages))
        stage = next((k for k in following if text.startswith(self._stages[k].words)), self._now)
        entered = stage != self._now
        if entered:
            self._now, self._within, self._counted_from, self._taken = stage, 0.0, 0.0, 0
            self._seconds[stage] = self._stages[stage].seconds
        if counted := _COUNTED.search(text):
            self._count(int(counted[1]), int(counted[2]), _pace(text))
        elif not entered:
            return self.again()
        return self._share_told()

    def again(self) -> float:
        """Return the share to tell after one more step of the present stage."""
        now = self._stages[self._now]
        self._taken += 1
        # Where there are many more than usual, most are quick
        usual = min(now.steps / self._taken, 1.0)
        self._within += usual * now.seconds / now.steps
        self._lengthen(self._within)
        return self._share_told()

    def share(self) -> float:
        """Return the share done of all that is known so far, 0 to 1; it falls as that grows."""
        within = max(self._within, 0.0)
        return (sum(self._seconds[: self._now]) + within) / sum(self._seconds)

    @property
    def stage(self) -> int:
        """Number of the present stage."""
        return self._now

    def _count(self, number: int, most: int, pace_s: float) -> None:
        """Begin a step of so many."""
        if number == 1:
            self._counted_from = max(self._within, 0.0)
        self._within = self._counted_from + pace_s * (number - 1)
        self._lengthen(self._counted_from + pace_s * most)

    def _lengthen(self, seconds: float) -> None:
        """Let the present stage, and with it the whole, last longer than so many seconds."""
        ahead = (1 - MOST_OF_STAGE) * self._stages[self._now].seconds
        self._seconds[self._now] = max(self._seconds[self._now], seconds + ahead)

    def _share_told(self) -> float:
        """Return the share to tell: where the share done fell, the told one goes on more slowly."""
        share = self.share()
        if share < self._last:
            self._fallen = self._told, share
        self._last = share
        told, fallen = self._fallen
        self._told = told + (1 - told) * (share - fallen) / (1 - fallen)
        return self._told


def _pace(text: str) -> float:
    """Seconds of one of the counted steps with these words, beside the stages'."""
    return next((pace for words, pace in COUNTED_S.items() if words in text), 1.0)


def seconds_left(share: float, elapsed_s: float) -> float | None:
    """Return the time left at the pace so far, None where too little is done.

    >>> seconds_left(0.25, 10.0)
    30.0
    """
    return elapsed_s * (1 - share) / share if share >= FIRST_SHARE else None


def in_words(seconds: float) -> str:
    """Return a duration roughly.

    >>> in_words(7.4), in_words(44), in_words(200)
    ('10 s', '45 s', '3 min')
    """
    if seconds < 90:
        return f"{5 * max(round(seconds / 5 + 0.3), 1)} s"
    return f"{round(seconds / 60)} min"


class ShownTask:
    """A task on stderr while its context lasts: share and time left by its stages.

    In a terminal it is a bar. Elsewhere each stage is a line with the seconds so far, the share and
    the time left; a long stage tells its steps further and further apart.

    Parameters
    ----------
    stages : of the task; without them neither share nor time left is told
    """

    def __init__(self, stages: Sequence[Stage] = (), *, quiet: bool = False) -> None:
        console = LastingConsole(stderr=True)
        self.print = console.print
        self._course = Course(stages) if stages else None
        self._lines = not quiet and not console.is_terminal
        self._bar = Progress(
            TextColumn("{task.description}", table_column=Column(no_wrap=True, ratio=1)),
            BarColumn(bar_width=16, table_column=Column(width=16)),
            TaskProgressColumn(table_column=Column(width=4)),
            TimeElapsedColumn(table_column=Column(width=7)),
            LeftColumn(table_column=Column(width=len("about 90 min left"))),
            console=console,
            expand=True,  # the words take what the other columns leave
            disable=quiet or self._lines,
        )
        self._text, self._told = "reading", (-1, -LINE_S)
        total = 1.0 if stages else None
        self._number = self._bar.add_task(self._text, total=total, ends_s=None)

    def __enter__(self) -> Self:
        self._start = time.monotonic()
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._bar.update(self._number, description="done", total=1, completed=1)
            if self._lines:
                self._tell("100 %  done")
        self._bar.stop()

    def say(self, text: str) -> None:
        """Begin a step, named by its words."""
        _give_memory_back()
        self._show(text, self._course.at(text) if self._course else 0.0)

    def advance(self, *_: object) -> None:
        """Count one more step of the present stage."""
        if self._course:
            self._show(self._text, self._course.again())

    def _show(self, text: str, share: float) -> None:
        now = time.monotonic()
        done = self._course.share() if self._course else share
        left = seconds_left(done, now - self._start)
        self._bar.update(
            self._number, description=text, completed=share,
            ends_s=None if left is None else now + left,
        )  # fmt: skip
        stage = self._course.stage if self._course else self._told[0] + (text != self._text)
        self._text = text
        pause = max(LINE_S, LINE_SHARE * (now - self._start))
        if self._lines and (stage != self._told[0] or now - self._told[1] >= pause):
            self._told = (stage, now)
            done = f"{100 * share:3.0f} %  " if self._course else ""
            self._tell(done + text + ("" if left is None else f" (about {in_words(left)} left)"))

    def _tell(self, text: str) -> None:
        line = f"{time.monotonic() - self._start:6.1f} s  {text}"
        self.print(line, markup=False, highlight=False, soft_wrap=True)


class LeftColumn(ProgressColumn):
    """Remaining time of a task, by its end."""

    def render(self, task: Task) -> Text:
        """Return the column's text."""
        ends = task.fields["ends_s"]
        if ends is None or task.finished:
            return Text()
        left = max(ends - time.monotonic(), 1.0)
        return Text(f"about {in_words(left)} left", style="progress.remaining")


def _give_memory_back() -> None:
    """Return freed memory to the system, where the C library is glibc.

    It keeps freed arrays of up to 32 MB, a third of the memory of `explain`.
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
