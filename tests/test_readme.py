"""What README and docs say can be done as they say: examples run, commands and files exist."""

import contextlib
import importlib.util
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from typer.testing import CliRunner

from identify.catalogue.catalogue import CATALOGUE
from identify.select.forward_selection import Verdict
from models.scan_file import read_scan
from palpmap.__main__ import app
from palpmap.commands.check import check_study

ROOT = Path(__file__).parent.parent
PAGES = {
    page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8")
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
README = PAGES["README.md"]


def blocks(language: str, page: str = "README.md") -> list[str]:
    """Contents of the code blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGES[page], re.MULTILINE | re.DOTALL)


def command_lines(language: str) -> list[str]:
    """Lines that call palpmap in the blocks of one language, on all pages."""
    lines = [
        line for page in PAGES for block in blocks(language, page) for line in block.split("\n")
    ]
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


@pytest.mark.skipif(shutil.which("sh") is None, reason="the shell blocks need a shell")
def test_the_shell_blocks_run_one_after_the_other(tmp_path):
    shutil.copytree(ROOT / "tests" / "data", tmp_path / "tests" / "data")
    shutil.copytree(ROOT / "examples" / "own_effect", tmp_path / "examples" / "own_effect")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["sh", "-e", "-c", "\n".join(blocks("sh"))],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "presses                 81" in done.stdout
    assert "closed, 4 of 4 presses" in done.stdout
    assert '"passed": true' in done.stdout
    assert "warm_up keeps to all" in done.stdout
    table = blocks_after("A run folder stands for itself", "docs/files.md")
    for name in ("scan.csv", "study.toml", "recording.rrd", "run.json", "truth.json"):
        assert f"`{name}`" in table
        assert (tmp_path / "runs" / "small" / name).is_file()


def blocks_after(sentence: str, page: str = "README.md") -> str:
    """The part of a page from a sentence to the next heading."""
    assert sentence in PAGES[page]
    return PAGES[page].split(sentence)[1].split("\n## ")[0]


def test_every_block_that_can_be_run_is_run_by_a_test():
    found = {
        (page, kind)
        for page, kind in on_all_pages(r"(?m)^```(\w+)$")
        if kind in ("sh", "python", "toml", "csv")
    }
    assert found == {("README.md", kind) for kind in ("sh", "python", "toml", "csv")}


def test_the_python_block_prints_the_numbers_that_it_says():
    _, code = blocks("python")
    promised = re.findall(r"m/N: (\[.*\])", code)
    said = io.StringIO()
    names: dict = {}
    with contextlib.redirect_stdout(said):
        exec(compile(code, "README.md", "exec"), names)
    assert said.getvalue().splitlines() == promised
    assert len(promised) == 2
    assert names["derivative"].shape == (2, 6)
    # The same presses on two extrapolated meshes, which agree with an independent solver.
    extrapolated = pytest.approx([0.011455, 0.011629], rel=0.005)
    assert names["homogeneous"].compliance.tolist() == extrapolated


def test_the_effect_of_ones_own_passes_the_checks(tmp_path):
    code, _ = blocks("python")
    (tmp_path / "cable_drag.py").write_text(code, encoding="utf-8")
    done = CliRunner().invoke(app, ["check-effect", str(tmp_path / "cable_drag.py"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["effect"] == "cable_drag"


def test_the_table_of_effects_is_the_catalogue():
    part = blocks_after("## Find the missing physics")
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \| (.*) \|$", part, re.MULTILINE)
    assert rows == [(e.name, e.link, e.gives_away) for e in CATALOGUE]


def test_the_table_of_verdicts_is_complete():
    part = blocks_after("## Find the missing physics")
    told = re.findall(r"^\| `(\w+)` \| (?:[^|]*[ ,][^|]*) \| [^|]+ \|$", part, re.MULTILINE)
    assert set(get_args(Verdict)) <= set(told)


def test_the_example_of_scan_and_study_can_be_used(tmp_path):
    (scan,), (study,) = blocks("csv"), blocks("toml")
    (tmp_path / "scan.csv").write_text(scan, encoding="utf-8")
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    found = check_study(tmp_path / "study.toml")
    assert (found["presses"], found["rows"]) == (2, 4)
    assert read_scan(tmp_path / "scan.csv").force_n.tolist() == [0.1, 0.2, 0.1, 0.2]


def test_every_command_and_option_exists_and_no_command_is_left_out():
    known = set(re.findall(r"^  ([\w-]+)  ", help_of().split("Commands:")[1], re.MULTILINE))
    table = set(re.findall(r"^\| `palpmap ([\w-]+)` \|", README, re.MULTILINE))
    assert table == known
    mentioned = {command for _, command in on_all_pages(r"`palpmap\s+([a-z-]+)")}
    assert mentioned <= known
    lines = command_lines("sh") + command_lines("console")
    assert len(lines) > 5
    for line in lines:
        _, command, *words = shlex.split(line, comments=True)
        said = help_of(command)
        for option in (word for word in words if word.startswith("--")):
            assert re.search(rf"{option}\b", said), line


def test_options_in_the_table_of_commands_exist():
    for command, row in re.findall(r"^\| `palpmap ([\w-]+)` \|(.*)$", README, re.MULTILINE):
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
