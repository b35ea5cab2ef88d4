"""Runs of the `palpmap` command that several files of tests look at, each made only once."""

import gc
import json
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from filelock import FileLock
from numba.core.caching import NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from typer.testing import CliRunner

from fem import PalpationModel, RefinedModel, block_mesh
from identify.catalogue.catalogue import CATALOGUE
from identify.design.assessment import Assessment, assess
from identify.fit.map_fit import fit_scan
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.experiment import BodyModel, PlacedExperiment, contacts_of
from identify.measurement.noise import scan_noise
from identify.select.explanation import Explanation
from identify.select.forward_selection import forward_selection
from identify.select.start_fit import measurement_model
from models.catalogue import Catalogue
from models.scan_file import read_scan, write_scan
from palpmap.__main__ import app
from palpmap.result.explain_record import explain_record
from palpmap.result.records import ExplainRecord
from palpmap.run_files.explain_run import write_explain_files
from palpmap.run_folder import RunFolder
from palpmap.study.open_study import Problem
from palpmap.study.placement import place_scan
from palpmap.study.study import load_study

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


SHARED = re.compile(r"def \w+\([^)]*\b(demo|explained_case)\b")
"""Use of a long run: its files share one process (xdist's groups fail with newer pytests)."""


FIRST = (
    "fem/near_field",
    "palpmap/importing/test_raw_streams",
    "sim/test_scan",
    "fem/finite_strain",
    "palpmap/importing/test_import_command",
    "palpmap/pipeline/test_demo",
    "test_blocks",
    "palpmap/cli/test_loop",
    "test_notebooks",
    "palpmap/test_api",
    "identify/select",
    "identify/fit",
    "palpmap/pipeline",
    "fem",
    "sim",
)
"""Files that are begun first: those that compile most kernels, beside some that need none, so that
commands started later find them compiled; then the longest, so that none is left at the end."""


def pytest_collection_modifyitems(items):
    """Put these files first, in their order; the others keep theirs."""

    def rank(item) -> int:
        name = item.nodeid.removeprefix("tests/")
        return next((i for i, begin in enumerate(FIRST) if name.startswith(begin)), len(FIRST))

    items.sort(key=rank)


def pytest_configure(config) -> None:
    """Let the processes of one clone, which share its compiled kernels, take turns in compiling.

    Two that need a kernel at the same time would both compile it; so the second one waits, and
    reads what the first has written. There is a lock for each module, as waiting costs time, too:
    modules do not import each other in a circle, so that no two can wait for each other.
    """
    if not hasattr(config, "workerinput"):
        return
    clone = crc32(str(config.rootpath).encode())
    compile_one = Dispatcher.compile

    @cache
    def lock_of(module: str) -> FileLock:
        return FileLock(Path(tempfile.gettempdir()) / f"palpmap-tests-{clone}-{module}.lock")

    def in_turns(self, sig):
        if isinstance(self._cache, NullCache):  # numba's own parts, which each compiles for itself
            return compile_one(self, sig)
        with global_compiler_lock, lock_of(self.py_func.__module__):  # threads first, then others
            return compile_one(self, sig)

    Dispatcher.compile = in_turns


def pytest_collection_finish(session) -> None:
    """Spare the garbage collector what has been imported, which lives as long as the process."""
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give every process whole files, and files that share a long run to the same one."""
    from xdist.scheduler import LoadFileScheduling

    @cache
    def group(file: str) -> str:
        if file.startswith("tests/fem/"):  # in a fresh clone the kernels are compiled once
            return file.rpartition("/")[0]
        path = config.rootpath / file
        shared = SHARED.search(path.read_text(encoding="utf-8")) if path.is_file() else None
        return shared[1] if shared else file

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            return group(super()._split_scope(nodeid))

    return Scheduling(config, log)


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

    def run(*arguments: object, folder: Path | None = None) -> CommandRun:
        folder = folder or tmp_path_factory.mktemp("run")
        usage = tmp_path_factory.mktemp("usage") / "usage.json"
        words = [*map(str, arguments), "--json", "--out", str(folder)]
        done = subprocess.run(
            [sys.executable, "-c", MEASURED, str(usage), *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=3600,
        )
        return CommandRun(
            folder, done.returncode, done.stdout, done.stderr, **json.loads(usage.read_text())
        )

    return run


@pytest.fixture(scope="session")
def run_here():
    """Return a function that runs the command in this process, which costs no start."""

    def run(*arguments: object, folder: Path) -> CommandRun:
        words = [*map(str, arguments), "--json", "--out", str(folder)]
        done = CliRunner().invoke(app, words)
        return CommandRun(folder, done.exit_code, done.stdout, done.stderr, 0, 0.0)

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


@dataclass(frozen=True)
class Explained:
    """A small scan with creep in it that the loop has explained, and its run folder."""

    folder: Path
    problem: Problem
    explained: Explanation
    assessment: Assessment
    record: ExplainRecord


@pytest.fixture(scope="session")
def explained_case(tmp_path_factory) -> Explained:
    """Every second press of the independent laboratory's case_b, explained with four effects.

    The inclusion's place is held, as so few presses cannot find it.
    """
    folder = tmp_path_factory.mktemp("explained")
    case = Path(__file__).parent / "data" / "lab" / "case_b"
    scan = read_scan(case / "scan.csv")
    points = np.round(scan.contact_points[:, :2], 6)
    keep = np.all([np.isin(points[:, a], np.unique(points[:, a])[::2]) for a in (0, 1)], axis=0)
    write_scan(scan.rows(keep[scan.press_index]), folder / "scan.csv")
    for name in ("study.toml", "truth.json"):
        shutil.copy(case / name, folder / name)
    study = load_study(folder / "study.toml")
    placement = place_scan(read_scan(study.scan), study)
    contacts, note = contacts_of(placement.scan.used(), sphere=False)
    size, nu = study.body.size_m, study.body.poisson_ratio
    coarse, finer = (
        PalpationModel(block_mesh(size, cells), nu, contacts) for cells in ((6, 6, 3), (8, 8, 4))
    )
    body = BodyModel(coarse, coarse, RefinedModel(coarse, finer), note)
    noise = scan_noise(placement.scan.used(), study.noise.displacement_m, study.noise.force_n)
    fit = fit_scan(
        placement.scan,
        coarse,
        noise=noise,
        fine_model=body.fine,
        start=GaussianMap(5300.0, (Inclusion(16000.0, 0.040, 0.058, 0.032, 0.010),)),
        free=["background_pa", "inclusion_1.weight_pa"],
    )
    wanted = ("viscoelasticity", "contact_offset", "force_drift", "hysteresis")
    problem = Problem(
        PlacedExperiment(placement.scan, body, noise, origin_m=placement.origin_m),
        Catalogue(effect for effect in CATALOGUE if effect.name in wanted),
        fit,
        *measurement_model(placement.scan, body, fit),
        study=study,
    )
    explained = forward_selection(problem.model, problem.start, problem.scan, problem.catalogue)
    assessment = assess(explained, problem.catalogue)
    record = explain_record(explained, problem, assessment)
    with RunFolder("explain", folder / "run", seed=0, inputs=[study.scan]) as run:
        record.write(run / "result.json")
        write_explain_files(run.path, problem, explained, assessment, record)
    return Explained(folder / "run", problem, explained, assessment, record)
