"""What README and docs say can be done as they say: examples run, commands and files exist."""

import importlib.util
import re
import shlex
from pathlib import Path
from typing import get_args

import pytest
from typer.testing import CliRunner

from identify.select.explanation import Verdict
from palpmap.__main__ import app
from palpmap.study.study import Effect, Study

ROOT = Path(__file__).parent.parent
PAGES = {
    page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8")
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md")))
}
README = PAGES["README.md"]
COMMANDS = PAGES["docs/commands.md"].split("## Demo")[0]


def command_lines() -> list[str]:
    """Return the lines that call palpmap in the shell blocks of all pages."""
    blocks = [block for _, block in on_all_pages(r"(?ms)^```sh\n(.*?)^```$")]
    lines = [line for block in blocks for line in block.split("\n")]
    return [line for line in lines if line.startswith("palpmap ")]


def on_all_pages(pattern: str) -> list[tuple[str, str]]:
    """Page and match of a pattern with one group, everywhere in README and docs."""
    return [(page, found) for page, text in PAGES.items() for found in re.findall(pattern, text)]


def anchors(page: str) -> set[str]:
    """What a link can lead to on a page: its headings, written as GitHub writes them in links."""
    text = re.sub(r"^```.*?^```$", "", PAGES[page], flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def help_of(*words: str) -> str:
    result = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0, f"palpmap {' '.join(words)} --help"
    return result.output


def blocks_after(sentence: str, page: str = "README.md") -> str:
    """The part of a page from a sentence to the next heading."""
    assert sentence in PAGES[page]
    return PAGES[page].split(sentence)[1].split("\n## ")[0]


def test_the_table_of_verdicts_is_complete():
    part = blocks_after("## Find the missing effect")
    told = re.findall(r"^\| `(\w+)` \| (?:[^|]*[ ,][^|]*) \| [^|]+ \|$", part, re.MULTILINE)
    assert set(get_args(Verdict)) <= set(told)


def test_the_table_of_the_study_has_every_key():
    keys = {
        f"{table}.{field.alias or key}"
        for table, kind in Study.model_fields.items()
        for key, field in getattr(kind.annotation, "model_fields", {}).items()
    }
    keys |= {f"effects.{key}" for key in Effect.model_fields}
    table = PAGES["docs/files.md"].split("## The study")[1].split("## ")[0]
    assert set(re.findall(r"(?m)^\| `([\w.]+)` \|", table)) == keys


def test_every_command_and_option_exists_and_no_command_is_left_out():
    known = set(re.findall(r"^  ([\w-]+)  ", help_of().split("Commands:")[1], re.MULTILINE))
    table = set(re.findall(r"^\| `palpmap ([\w-]+)` \|", COMMANDS, re.MULTILINE))
    assert table == known
    mentioned = {command for _, command in on_all_pages(r"`palpmap\s+([a-z-]+)")}
    assert mentioned <= known
    lines = command_lines()
    assert len(lines) > 5
    for line in lines:
        _, command, *words = shlex.split(line, comments=True)
        said = help_of(command)
        for option in (word for word in words if word.startswith("--")):
            assert re.search(rf"{option}\b", said), line


def test_options_in_the_table_of_commands_exist():
    for command, row in re.findall(r"^\| `palpmap ([\w-]+)` \|(.*)$", COMMANDS, re.MULTILINE):
        for option in re.findall(r"`(--[a-z-]+)", row):
            assert re.search(rf"{option}\b", help_of(command)), f"palpmap {command} {option}"


def test_every_target_of_make_exists():
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    mentioned = [target for _, target in on_all_pages(r"`make (\w+)`")]
    assert {"demo", "test", "bench"} <= set(mentioned) <= set(targets)


def test_every_link_and_picture_leads_to_a_file_and_a_heading():
    inside = [(page, link) for page, link in on_all_pages(r"\]\(([^)]+)\)") if "://" not in link]
    assert len(inside) > 30
    for page, link in inside:
        path, _, heading = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), f"{page}: {link}"
        if heading:
            name = target.resolve().relative_to(ROOT.resolve()).as_posix()
            assert heading in anchors(name), f"{page}: {link}"


def test_pictures_are_small():
    for page, picture in on_all_pages(r"!\[[^\]]*\]\(([^)]+)\)"):
        assert ((ROOT / page).parent / picture).stat().st_size < 400_000, picture


def test_the_benchmarks_find_their_place_and_have_left_a_table(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    spec = importlib.util.spec_from_file_location("run", ROOT / "benchmarks" / "run.py")
    assert spec is not None
    assert spec.loader is not None
    run = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(run)
    page = PAGES["docs/benchmarks.md"]
    assert page == run.PAGE.read_text(encoding="utf-8")
    for name in run.BENCHMARKS:
        changed = run.put(page, name, ["| new |"])
        table = page.split(f"<!-- bench:{name} -->")[1].split(f"<!-- /bench:{name} -->")[0]
        assert changed == page.replace(table, "\n| new |\n")
        assert table.count("\n") > 6, f"`make bench` has not filled the table {name}"
        assert "Measured on" in table
    with pytest.raises(ValueError, match="bench:solver"):
        run.put("no markers", "solver", [])


def test_nothing_is_left_to_be_filled_in():
    for page, text in PAGES.items():
        prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
        assert re.findall(r"\b(?:TODO|TBD|FIXME|[A-Z]+_[A-Z_]+)\b", prose) == [], page


def test_the_readme_counts_the_catalogue():
    from identify.catalogue import CATALOGUE

    assert f"a catalogue of {len(CATALOGUE)} such effects" in README.replace("\n", " ")
