"""What the site adds to the pages: the catalogue of effects, mathematics, links to source files."""

import ast
import html
import re
from pathlib import Path, PurePosixPath

from latex2mathml.converter import convert
from mkdocs.structure.files import File

from identify.catalogue.catalogue import CATALOGUE
from palpmap.commands.effects import effect_page

LINKS = {
    "body": "Body: stiffness, shape and support",
    "contact": "Contact: the tip against the surface",
    "response": "Response: the history of loading",
    "instrument": "Instrument: force sensor and travel",
}
PACKAGES = ("models", "fem", "sim", "identify", "palpmap")


def on_config(config):
    """Put the effects' pages into the navigation, by the link of the measurement chain."""
    entry = next(part for part in config.nav if "Effects" in part)
    for link, title in LINKS.items():
        pages = [{e.title: f"effects/{e.name}.md"} for e in CATALOGUE if e.link == link]
        entry["Effects"].append({title.split(":")[0]: pages})
    return config


def on_files(files, config):
    """Make a page of each effect from its class."""
    for effect in CATALOGUE:
        text = effect_page(effect, latex=True)
        files.append(File.generated(config, f"effects/{effect.name}.md", content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Fill the tables; show links that leave docs/ as the path of a source file."""
    for mark, table in (("effects", effect_table), ("folders", folder_table)):
        if f"<!-- the {mark} -->" in markdown:
            markdown = markdown.replace(f"<!-- the {mark} -->", table())
    folder = PurePosixPath("docs", page.file.src_uri).parent

    def kept(found):
        text, target = found.groups()
        path = (Path(folder) / target.split("#")[0]).resolve()
        inside = "://" in target or path.is_relative_to(Path("docs").resolve())
        return found[0] if inside else f"`{text}`" if "`" not in text else text

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", kept, markdown)


def on_page_content(content, **_):
    """Write mathematics as MathML, which browsers draw by themselves."""

    def drawn(found):
        tag, latex = found.group(1), html.unescape(found.group(2)).strip()
        mode = "block" if tag == "div" else "inline"
        return convert(latex[2:-2], display=mode)

    return re.sub(r'<(div|span) class="arithmatex">(.*?)</\1>', drawn, content, flags=re.DOTALL)


def effect_table():
    """Return a table of the effects for each link of the chain, in Markdown."""
    parts = []
    for link, title in LINKS.items():
        rows = [
            f"| [{e.title}]({e.name}.md) | `{e.name}` | {e.gives_away} |"
            for e in CATALOGUE
            if e.link == link
        ]
        parts += [
            f"## {title}",
            "\n".join(["| effect | name | how it shows |", "|---|---|---|", *rows]),
        ]
    return "\n\n".join(parts)


def folder_table():
    """Return a table of the packages' folders, each with the first line of its docstring."""
    rows = ["| folder | content |", "|---|---|"]
    for package in PACKAGES:
        for path in sorted(Path(package).rglob("__init__.py")):
            said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            rows.append(f"| `{path.parent.as_posix()}/` | {said.splitlines()[0]} |")
    return "\n".join(rows)
