"""Every block of README and docs that can be run is run as it stands, page by page."""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from typer.testing import CliRunner

from palpmap.__main__ import app

ROOT = Path(__file__).parent.parent
RUN_ELSEWHERE = {"docs/import.md"}  # tests/palpmap/importing makes the bag that it speaks of
PAGES = sorted(
    {page.relative_to(ROOT).as_posix() for page in (ROOT / "README.md", *ROOT.glob("docs/**/*.md"))}
    - RUN_ELSEWHERE
)
FENCE = re.compile(
    r'^(<!-- slow -->\n)?```(\w*)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL
)
JUDGED = (
    "add",
    "compare",
    "predict",
    "diagnose",
    "explain",
    "reveal",
    "scan",
)  # exit code 1: a criterion failed


SAID = {
    "README.md": ("presses                 2", "cable_drag keeps to all"),
    "docs/commands.md": ("closed, 4 of 4 presses",),
    "docs/tutorials/own_effect.md": ("cable_drag keeps to all", "warm_up keeps to all"),
    "docs/tutorials/missing_effect.md": ("presses                 81",),
}
"""What the quick blocks of a page must say."""
SAID_SLOWLY = {
    "README.md": (
        "Best: contact_offset",
        "Explained. With contact_offset in the model",
        "The residual is noise",
    ),
    "docs/commands.md": ('"passed": true',),
    "docs/tutorials/missing_effect.md": ("Explained. With contact_offset in the model",),
}
"""What the slow ones must say besides."""


class Block(NamedTuple):
    """A code block: its language, its file's name if it has one, and its text."""

    slow: bool
    language: str
    title: str | None
    text: str


def blocks(page: str) -> list[Block]:
    """Return the code blocks of a page."""
    found = FENCE.findall((ROOT / page).read_text(encoding="utf-8"))
    return [
        Block(bool(slow), language, title or None, text) for slow, language, title, text in found
    ]


def runnable(page: str) -> list[Block]:
    """Return the blocks of a page that are commands, Python or files for them."""
    return [block for block in blocks(page) if block.language in ("sh", "python") or block.title]


WITH_BLOCKS = [page for page in PAGES if runnable(page)]
WITH_SLOW_BLOCKS = [page for page in WITH_BLOCKS if any(block.slow for block in runnable(page))]


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Return a folder like a fresh clone, as far as the pages speak of it, and work there."""
    for part in ("tests/data/lab", "tests/data/twelve_presses", "examples"):
        shutil.copytree(ROOT / part, tmp_path / part)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(page: str, folder: Path, with_slow: bool) -> tuple[str, dict]:
    """Run the blocks of a page in their order; return what they said, and the names of Python."""
    names: dict = {}
    said = ""
    for block in runnable(page):
        if block.slow and not with_slow:
            continue
        if block.title:
            (folder / block.title).write_text(block.text, encoding="utf-8")
        elif block.language == "sh":
            for line in block.text.splitlines():
                said += run_line(line, folder)
        else:
            run_python(block.text, page, names)
    return said, names


def run_line(line: str, folder: Path) -> str:
    """Run one command line; return what it said.

    A plain call of palpmap runs in this process, which costs no start; the rest in a shell.
    """
    words = shlex.split(line, comments=True)
    allowed = (0, 1) if words[0] == "palpmap" and words[1] in JUDGED else (0,)
    if words[0] == "palpmap" and not set(line) & set("|&;<>$*"):
        here = CliRunner().invoke(app, words[1:])
        assert here.exit_code in allowed, f"{line}\n{here.stderr}"
        assert isinstance(here.exception, SystemExit | None), f"{line}\n{here.exception!r}"
        return here.stdout
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["sh", "-c", line],
        cwd=folder,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=1800,
    )
    assert done.returncode in allowed, f"{line}\n{done.stderr}"
    assert "Traceback" not in done.stderr, f"{line}\n{done.stderr}"
    return done.stdout


def run_python(code: str, page: str, names: dict) -> None:
    """Run Python; it must print what the comments behind `print(...)` say."""
    promised = re.findall(r"^ *print\(.*\)  # (?:[^:\[]*: (?=[\[(]))?(.*)$", code, re.MULTILINE)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(code, page, "exec"), names)
    assert said.getvalue().splitlines() == promised, page


@pytest.mark.skipif(shutil.which("sh") is None, reason="the shell blocks need a shell")
@pytest.mark.parametrize("page", WITH_BLOCKS)
def test_the_blocks_of_a_page_run(page, folder):
    said, names = run(page, folder, with_slow=False)
    for sentence in SAID.get(page, ()):
        assert sentence in said
    if page == "docs/commands.md":
        table = (ROOT / "docs/files.md").read_text(encoding="utf-8").split("## The run folder")[1]
        for name in ("scan.csv", "study.toml", "recording.rrd", "run.json", "truth.json"):
            assert f"`{name}`" in table
            assert (folder / "runs" / "small" / name).is_file()
    if page == "docs/tutorials/python.md":
        # The same presses on two extrapolated meshes, which agree with an independent solver.
        extrapolated = pytest.approx([0.011455, 0.011629], rel=0.005)
        assert names["homogeneous"].compliance.tolist() == extrapolated


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("sh") is None, reason="the shell blocks need a shell")
@pytest.mark.parametrize("page", WITH_SLOW_BLOCKS)
def test_all_blocks_of_a_page_run(page, folder):
    said, _ = run(page, folder, with_slow=True)
    for sentence in SAID.get(page, ()) + SAID_SLOWLY.get(page, ()):
        assert sentence in said


def test_a_block_is_run_or_is_an_output_or_a_file():
    for page in PAGES:
        for block in blocks(page):
            known = block.language in ("sh", "python", "text") or block.title
            assert known, f"{page}: a block of '{block.language}' without a title is not run"
