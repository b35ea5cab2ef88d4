"""Runs of the `palpmap` command that several files of tests look at, each made only once."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpmap.__main__ import app

# A process between the tests and the command: what a child is charged with as its peak memory
# starts from that of the process that made it, and pytest is large by then.
MEASURED = """
import json, resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "palpmap", *sys.argv[2:]])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
kilo = 1 if sys.platform == "darwin" else 1024
with open(sys.argv[1], "w") as file:
    json.dump({"peak_bytes": kilo * used.ru_maxrss, "cpu_s": used.ru_utime + used.ru_stime}, file)
sys.exit(done.returncode)
"""


@dataclass(frozen=True)
class CommandRun:
    """A finished run of the command with `--json --out folder`."""

    folder: Path
    exit_code: int
    stdout: str
    stderr: str
    peak_bytes: int
    cpu_s: float

    @property
    def record(self) -> dict:
        """What the command said on stdout, all of which must be one JSON object."""
        return json.loads(self.stdout)


@pytest.fixture(scope="session")
def run_command(tmp_path_factory):
    """Return a function that runs the command in a process of its own."""

    def run(*arguments: object, folder: Path | None = None, cwd: Path | None = None) -> CommandRun:
        folder = folder or tmp_path_factory.mktemp("run")
        usage = tmp_path_factory.mktemp("usage") / "usage.json"
        words = [*map(str, arguments), "--json", "--out", str(folder)]
        done = subprocess.run(
            [sys.executable, "-c", MEASURED, str(usage), *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=3600,
            cwd=cwd,
        )
        return CommandRun(
            folder, done.returncode, done.stdout, done.stderr, **json.loads(usage.read_text())
        )

    return run


@pytest.fixture(scope="session")
def run_review():
    """Return a function: run folder -> exit code and record of `palpmap review --summary`."""

    def review(folder: Path) -> tuple[int, dict]:
        result = CliRunner().invoke(app, ["review", str(folder), "--summary", "--json"])
        return result.exit_code, json.loads(result.stdout)

    return review


@pytest.fixture(scope="session")
def demo(run_command) -> CommandRun:
    """The whole demo."""
    return run_command("demo")
