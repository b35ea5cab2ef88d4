"""Input and disks beyond all reason: one sentence, exit code 2, no file half written."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from identify.fit import posterior
from models.errors import InputError
from palpmap.__main__ import app
from palpmap.study import cell_size
from palpmap.study.body import Body
from palpmap.study.study import load_study
from tests.paths import LAB, TWELVE

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs limits of a process")


def refused(*words: object) -> str:
    """Return the one sentence of a command that exits with 2."""
    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exit_code == 2, (done.output, done.exception)
    assert "Traceback" not in done.output
    return done.stderr.strip()


@pytest.fixture
def study(tmp_path) -> Path:
    shutil.copytree(TWELVE, tmp_path / "study")
    return tmp_path / "study" / "study.toml"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("background_pa = 5200.0", "background_pa = 1e300", "a size up to 1e+12 for 'back"),
        ("background_pa = 5200.0", f"background_pa = 1{'0' * 400}", "a size up to 1e+12 for 'back"),
        ("background_pa = 5200.0", f"background_pa = 1{'0' * 9000}", "text that is not TOML"),
        ("inclusions = 1", "inclusions = 10000000", "a whole number from 0 to 100, or"),
        ('name = "twelve_presses"', 'name = ""', "found '', expected text that is not empty"),
        ("inclusions = 1", 'kind = "free"\ninclusions = 1', "no key 'inclusions', as kind is"),
        ("[body]", "[uncertainty]\nsamples = -5\n[body]", "a whole number from 1000 to 1000000"),
        ("[body]", "[uncertainty]\nsamples = 'many'\n[body]", "found 'many', expected a whole"),
        ("cell_size_m = 0.01", "cell_size_m = 1e-110", "key body.cell_size_m: found 1e-110 m"),
        ('name = "twelve_presses"', f"name = {'[' * 5000}{']' * 5000}", "nested too deep"),
        ('name = "twelve_presses"', f"{'a.' * 3000}b = 1", "key study.a: unknown key"),
        ('"scan.csv"', f'"{"a" * 300}.csv"', "cannot be read or written (File name too long)"),
    ],
)
def test_a_study_beyond_all_reason_is_refused_in_a_sentence(study, old, new, says):
    text = study.read_text()
    assert old in text
    study.write_text(text.replace(old, new))
    said = refused("check", study)
    assert says in said
    assert len(said) < 1000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("new", "s.csv", "--poisson", "0,49"), "found '0,49', expected a number, such as 0.49"),
        (("new", "s.csv", "--out", "n", "--size", "1,2"), "'--size': found '1,2', expected three"),
        (("new", "s.csv", "--out", "n", "--origin", "0"), "'--origin': found '0', expected three"),
        (("demo", "--seed", "x"), "found 'x', expected a whole number"),
        (("demo", "--seed", "-1"), "found '-1', expected greater than or equal to 0"),
    ],
)
def test_a_value_of_an_option_is_refused_in_plain_words(words, says):
    said = refused(*words)
    assert says in said
    assert "Input" not in said


@pytest.mark.parametrize("plant", ["force_drift=3", ":3", "force_drift:x"])
def test_a_plant_in_another_form_is_answered_by_the_form(plant):
    assert "expected NAME, NAME:3 (percent) or FILE.py" in refused("scan", "--plant", plant)


def test_a_scan_in_place_of_a_study_is_answered_by_the_command_that_makes_one():
    scan = TWELVE / "scan.csv"
    assert f"`palpmap new {scan} --out FOLDER` makes one" in refused("fit", scan)


def test_samples_that_cannot_be_drawn_are_refused_before_the_fit(study, monkeypatch):
    assert "found '-5', expected a whole number" in refused("fit", study, "--samples", "-5")
    out = study.parent / "run"
    assert "from 1000 to 1000000" in refused("fit", study, "--samples", "7", "--out", out)
    with monkeypatch.context() as without:
        without.setattr(posterior, "find_spec", lambda name: None)
        said = refused("fit", study, "--samples", "2000", "--out", out)
        assert "pip install 'palpmap[posterior]'" in said
    free = study.read_text().replace("inclusions = 1", 'kind = "free"')
    free = re.sub(r"\[map\.(initial|fixed)\][^\[]*", "", free)
    study.write_text(free)
    said = refused("fit", study, "--samples", "2000", "--out", out)
    assert 'kind = "free" is given with its standard deviation' in said
    assert not out.exists()


def test_a_path_of_300_letters_is_refused(study):
    long = study.parent / ("a" * 300)
    for words in (("check", f"{long}.toml"), ("join", LAB / "case_a" / "scan.csv", f"{long}.csv",
                   "--out", study.parent / "both.csv")):  # fmt: skip
        assert "File name too long); choose a shorter name" in refused(*words)


@pytest.mark.parametrize("size", [(0.9, 0.9, 0.0001), (0.3, 0.3, 0.002)])
def test_a_body_too_thin_and_wide_for_the_memory_is_refused_before_it_is_meshed(size):
    body = Body(shape="block", size_m=size, poisson_ratio=0.45)
    with pytest.raises(InputError, match=r"body\.size_m: found 0\..* 4 GB of memory"):
        cell_size.cell_size_m(body)
    with pytest.raises(InputError, match=r"body\.size_m: found 0\..* 4 GB of memory"):
        cell_size.cell_size_m(body.model_copy(update={"cell_size_m": size[2] / 3}))


def test_cells_that_are_advised_are_never_refused():
    for size in [(0.1, 0.1, 0.05), (0.2, 0.2, 0.005), (0.25, 0.18, 0.06), (0.1, 0.02, 0.02)]:
        body = Body(shape="block", size_m=size, poisson_ratio=0.45)
        least = cell_size.smallest_cell_m(body)
        if least <= min(size) / 2:
            assert cell_size.cell_size_m(body.model_copy(update={"cell_size_m": least})) == least


def test_more_presses_than_the_memory_holds_are_refused_with_the_bytes(study, monkeypatch):
    monkeypatch.setattr(cell_size, "_memory_bytes", lambda: 8e9)
    body = load_study(study).body
    cell_size.refuse_too_large(body, 400)
    with pytest.raises(InputError, match=r"5000 presses need about 23\.\d GB .* the 8\.0 GB"):
        cell_size.refuse_too_large(body, 5000)


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
from palpmap.__main__ import app
app(sys.argv[2:])
"""


@posix
def test_a_disk_that_is_full_leaves_no_half_written_scan(study):
    scans = [LAB / name / "scan.csv" for name in ("case_a", "case_b")]
    out = study.parent / "both.csv"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, "4096", "join", *map(str, scans), "--pause", "60",
         "--out", str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    said = " ".join(done.stderr.split())
    assert done.returncode == 2, said
    assert re.search(r"both\.csv: cannot be read or written \(File too large\); free some", said)
    assert not list(study.parent.glob("both*"))


@posix
@pytest.mark.slow
@pytest.mark.parametrize(("command", "limit"), [("fit", 8000), ("add", 400)])
def test_a_disk_that_is_full_stops_fit_and_add_in_a_sentence(study, command, limit):
    before = {path.name: path.read_bytes() for path in study.parent.iterdir()}
    words = {"fit": ["--out", str(study.parent / "run")], "add": ["contact_offset"]}[command]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(limit), command, str(study), *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "cannot be read or written (File too large)" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    files = {path.name: path.read_bytes() for path in study.parent.iterdir() if path.is_file()}
    assert files == before


def test_a_folder_in_place_of_its_study_is_refused_with_the_studys_name(study, tmp_path):
    assert refused("fit", study.parent).endswith(f"expected a study file (.toml); give {study}")
    assert refused("fit", tmp_path).endswith("expected a study file (.toml); check the path")


def test_what_a_scan_cannot_use_is_said_before_a_folder_is_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = refused("scan", "--plant", "force_drft")
    assert said.endswith("'force_drft'; the nearest right name is 'force_drift', or give a file of "
                         "hooks that ends with .py")  # fmt: skip
    for option, what in (("--truth", "true map"), ("--lab", "laboratory")):
        said = refused("scan", option, "none.toml")
        assert (
            said == f"palpmap: none.toml: no such file, expected a {what} (.toml); check the path"
        )
    assert not list(tmp_path.iterdir())
