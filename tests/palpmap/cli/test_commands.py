"""The command line: help, exit codes, and what is imported for it."""

import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

from palpmap.__main__ import app
from palpmap.console import to_type

COMMANDS = (
    "demo", "paper", "scan", "fit", "compare", "diagnose", "add", "history", "limits", "explain",
    "effects", "check-effect", "blind", "reveal", "review", "check",
)  # fmt: skip
HEAVY = ("numpy", "scipy", "numba", "mujoco", "pinocchio", "rerun", "pyarrow", "matplotlib")


def palpmap(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "palpmap", *arguments], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_shows_an_example(command):
    result = CliRunner().invoke(app, [*command.split(), "--help"])
    assert result.exit_code == 0
    assert f"Example: palpmap {command}".strip() in result.stdout


def test_help_lists_every_command_with_a_whole_sentence():
    text = CliRunner().invoke(app, ["--help"]).stdout
    for command in COMMANDS:
        line = next(line for line in text.splitlines() if line.strip().startswith(command + " "))
        assert line.endswith(".")
        assert not line.endswith("...")


def test_help_answers_at_once():
    # 0.25 s on an idle core; the best of three keeps a busy machine out of the measurement.
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        assert palpmap("fit", "--help").returncode == 0
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 1.5


def test_help_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from palpmap.__main__ import app\n"
        "app(['fit', '--help'], standalone_mode=False)\n"
        f"print('imported:', [name for name in {HEAVY} if name in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines()[-1] == "imported: []"


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["check"],
        ["check", "study.toml", "--fast"],
        ["scan", "--force", "1", "--paper-force"],
        ["scan", "--force", "-1"],
        ["scan", "--presses-per-side", "1"],
        ["fit", "study.toml", "--inclusions", "some"],
        ["fit", "study.toml", "--optimizer", "newton"],
        ["demo", "--seed", "-1"],
        ["add", "study.toml"],
        ["blind", "--radii", "3"],
        ["blind", "--workers", "2"],
        ["history", "study.toml", "--redo"],
        ["review", "run", "--png", "--summary"],
    ],
    ids=" ".join,
)
def test_a_wrong_command_line_has_exit_code_2(arguments):
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "Usage: palpmap" in result.stderr


def test_a_fault_of_the_user_shows_no_traceback():
    result = palpmap("check", "missing.toml")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == (
        "palpmap: missing.toml: no such file, expected a study file (.toml); check the path\n"
    )


def test_a_command_to_type_works_off_the_path_and_with_spaces(monkeypatch, tmp_path):
    scripts = tmp_path / "a venv" / "bin"
    monkeypatch.setattr("sysconfig.get_path", lambda name: str(scripts))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert to_type("review", "a run") == f"'{scripts}/palpmap' review 'a run'"
    monkeypatch.chdir(tmp_path)
    assert to_type("review", "run") == "'a venv/bin/palpmap' review run"
    (tmp_path / "palpmap").touch(mode=0o755)
    assert to_type("review", "run") == "palpmap review run"
