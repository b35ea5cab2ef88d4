"""The share of a command that is done, told by the words of its steps, and the time left."""

import time
from collections.abc import Sequence
from typing import NamedTuple

from rich.progress import MofNCompleteColumn, ProgressColumn, Task, TimeRemainingColumn
from rich.text import Text

FIRST_SHARE = 0.08  # of a course: before it, no time left is estimated


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
    Stage(("fitting the presses",), 60, 110, asked=True),
    Stage(("fitting", "trying"), 12, 2),
)
_SCORED = Stage(("analysing", "scoring"), 15, 45)
_TRIED = Stage(("trying", "refitting"), 5, 20)
FIT = (Stage(("meshing",), 3), Stage(("fitting",), 20, 12), Stage(("comparing",), 4))
FIT_AND_SAMPLE = (*FIT[:2], Stage(("drawing",), 30, 80), FIT[2])
DIAGNOSE = (*_OPEN, Stage(("analysing", "scoring"), 16, 45))
LIMITS = (*_OPEN, Stage(("computing",), 12), Stage(("planning",), 40, 8))
EXPLAIN = (
    *_OPEN, _SCORED, _TRIED, _SCORED, _TRIED,
    Stage(("testing", "fitting", "without"), 4, 3),
    Stage(("computing",), 25), Stage(("looking",), 3),
)  # fmt: skip


class Course:
    """How far a command is: it has gone through the stages up to that of its last step.

    A stage may stand twice; a step that belongs to none that follows counts to the present one.

    >>> course = Course(DIAGNOSE)
    >>> [round(course.at(text), 2) for text in ("meshing the body", "scoring hysteresis")]
    [0.0, 0.48]
    """

    def __init__(self, stages: Sequence[Stage]) -> None:
        self._stages = stages
        self._now, self._step = 0, -1
        self._seconds = [stage.seconds * (not stage.asked) for stage in stages]

    def at(self, text: str) -> float:
        """Return the share done when a step begins, 0 to 1; it never falls."""
        following = range(self._now, len(self._stages))
        stage = next((k for k in following if text.startswith(self._stages[k].words)), self._now)
        self._step = self._step + 1 if stage == self._now else 0
        self._now = stage
        self._seconds[stage] = self._stages[stage].seconds
        return self.share()

    def again(self) -> float:
        """Return the share done after one more step of the present stage."""
        self._step += 1
        return self.share()

    def share(self) -> float:
        """Return the share done, 0 to 1."""
        seconds, now = self._seconds, self._stages[self._now]
        within = now.seconds * min(max(self._step, 0) / now.steps, 0.95)
        return (sum(seconds[: self._now]) + within) / sum(seconds)

    @property
    def stage(self) -> int:
        """Number of the present stage."""
        return self._now


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


class CountColumn(MofNCompleteColumn):
    """Steps done of all; nothing for a course, whose steps nobody has counted."""

    def render(self, task: Task) -> Text:
        """Return the column's text."""
        return Text() if "ends_s" in task.fields else super().render(task)


class LeftColumn(ProgressColumn):
    """The time left: of a course by its end, else by the pace of the steps."""

    def __init__(self) -> None:
        super().__init__()
        self._by_pace = TimeRemainingColumn()

    def render(self, task: Task) -> Text:
        """Return the column's text."""
        if "ends_s" not in task.fields:
            return self._by_pace.render(task)
        ends = task.fields["ends_s"]
        if ends is None or task.finished:
            return Text("" if task.finished else "...", style="progress.remaining")
        left = max(ends - time.monotonic(), 1.0)
        return Text(f"about {in_words(left)}", style="progress.remaining")
