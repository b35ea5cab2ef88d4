"""Draws any table of a result: on the console, as Markdown, and as HTML within a page."""

import base64
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models import replaced
from palpmap import units
from palpmap.figures.style import DPI
from palpmap.result.tables import Table

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from rich.console import Console, ConsoleOptions, RenderableType

SCREEN_DPI = 88
"""Screen pixels an inch of a picture."""
_LONGEST_PART = 20
"""Characters of a name that a narrow console does not break."""
_STYLES = {"": "", "good": "green", "bad": "yellow", "dim": "dim"}


def console(table: Table) -> "RenderableType":
    """Return a table for the console; where it is narrow, headings fold, then names."""
    return _Fitting(table)


@dataclass(frozen=True)
class _Fitting:
    """A table as one line of headings, or as narrow as it has to be."""

    table: Table

    def __rich_console__(
        self, console: "Console", options: "ConsoleOptions"
    ) -> "Iterator[RenderableType]":
        from rich.measure import Measurement

        for narrowed in range(4):
            grid = _grid(self.table, narrowed)
            wide = Measurement.get(console, options.update(max_width=10_000), grid)
            if (wide.minimum if narrowed else wide.maximum) <= options.max_width:
                break
        yield grid


def _broken(text: str) -> str:
    r"""Return a text whose names break after a dot, and after an underscore where still long.

    >>> _broken("touch_threshold.threshold_n (preconditioning_nearby)").split("\n")
    ['touch_threshold.', 'threshold_n (preconditioning_', 'nearby)']
    """
    text = re.sub(r"(?<=[a-z])\.(?=[a-z])", ".\n", text)
    part = re.compile(rf"(.{{1,{_LONGEST_PART - 1}}}_)(?=.)")
    return re.sub(rf"\S{{{_LONGEST_PART + 1},}}", lambda name: part.sub(r"\1\n", name[0]), text)


def _grid(table: Table, narrowed: int) -> "RenderableType":
    """Return a table; by the steps 1 to 3 headings fold, names break, intervals break."""
    from textwrap import fill

    from rich import box
    from rich.table import Table as Grid
    from rich.text import Text

    grid = Grid(
        box=box.SIMPLE, title=Text(table.title) if table.title else None, title_justify="left",
        show_header=table.has_head, pad_edge=False, padding=(0, 1, 0, 0),
    )  # fmt: skip

    def shown(text: str) -> str:
        if narrowed > 2:
            text = text.replace(" to ", " to\n")
        return _broken(text) if narrowed > 1 else text

    for number, column in enumerate(table.columns):
        heading = column.heading
        texts = [shown(row[number].text) for row in table.rows]
        widest = max((len(line) for text in texts for line in text.split("\n")), default=0)
        longest = max((len(word) for text in texts for word in text.split()), default=0)
        grid.add_column(
            fill(heading, widest or len(heading), break_long_words=False) if narrowed else heading,
            justify="right" if column.right else "left",
            no_wrap=column.right or widest <= longest,  # else rich narrows what cannot fold
            min_width=widest if column.right else longest,
            overflow="fold",
        )
    for row in table.rows:
        grid.add_row(*(Text(shown(cell.text), style=_STYLES[cell.tone]) for cell in row))
    return grid


def markdown(table: Table) -> str:
    """Return a table as Markdown."""
    lines = [
        [column.heading for column in table.columns],
        ["---:" if column.right else "---" for column in table.columns],
        *([cell.text.replace("|", r"\|").replace("\n", " ") for cell in row] for row in table.rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def write_page(path: Path, template: str, **content: Any) -> None:
    """Fill a template of `templates/` and write it as HTML, replaced in one step.

    All texts are escaped. `content["pictures"]` are PNG files by name.
    """
    page = _environment().get_template(template).render(content)
    with replaced(path) as beside:
        beside.write_text(page, encoding="utf-8")


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("palpmap.report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {"data_uri": _data_uri, "screen_width": _screen_width}
    made.filters |= {"rms": units.rms, "percent": units.percent, "prose": _prose}
    return made


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _prose(text: str) -> "Markup":
    """Return a sentence as HTML, escaped, its `commands` as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub("`([^`]*)`", r"<code>\1</code>", str(escape(text))))


def _screen_width(png: bytes) -> int:
    """Return the width in pixels: one scale for all pictures, so that their letters are alike."""
    return round(int.from_bytes(png[16:20], "big") * SCREEN_DPI / DPI)
