"""What reports are made of: a page, sections, pictures, lists and tables, all text escaped."""

import base64
from collections.abc import Iterable, Sequence
from html import escape

from palpmap.figures.style import DPI
from palpmap.report.draw import SCREEN_DPI


def section(title: str, content: str, kind: str = "") -> str:
    """Return a section; nothing where there is no content."""
    if not content:
        return ""
    attribute = f' class="{escape(kind)}"' if kind else ""
    return f"<section{attribute}>\n<h2>{escape(title)}</h2>\n{content}\n</section>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text."""
    attribute = f' class="{escape(kind)}"' if kind else ""
    return f"<p{attribute}>{escape(text)}</p>\n" if text else ""


def picture(caption: str, data: bytes) -> str:
    """Return a PNG with its caption."""
    text = escape(caption)
    source = "data:image/png;base64," + base64.b64encode(data).decode("ascii")
    # One scale for all pictures, so that their letters have one size.
    width = round(int.from_bytes(data[16:20], "big") * SCREEN_DPI / DPI)
    image = f'<img alt="{text}" style="max-width: {width}px" src="{source}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>\n"


def listing(items: Sequence[str]) -> str:
    """Return a list of plain texts; nothing where there are none."""
    return "<ul>" + "".join(f"<li>{escape(i)}</li>" for i in items) + "</ul>" if items else ""


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, numeric: bool = True, raw: bool = False
) -> str:
    """Return a table; all but the first column right-aligned if `numeric`, cells HTML if `raw`."""
    text = (lambda cell: cell) if raw else escape

    def cells(tag: str, values: Sequence[str]) -> str:
        out = [
            f'<{tag} class="n">{text(v)}</{tag}>' if i and numeric else f"<{tag}>{text(v)}</{tag}>"
            for i, v in enumerate(values)
        ]
        return f"<tr>{''.join(out)}</tr>"

    lines = [cells("td", row) for row in rows]
    if not lines:
        return ""
    header = f"<thead>{cells('th', head)}</thead>" if any(head) else ""
    return f'<div class="wide"><table>{header}<tbody>{"".join(lines)}</tbody></table></div>\n'
