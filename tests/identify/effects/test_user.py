"""A user's own effect from a file, and the two commands about effects."""

import json
import re

import pytest
from typer.testing import CliRunner

from identify import select
from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.user_effect import load_effect
from identify.effects.conformance.kit import check_effect, failures
from identify.select import NOT_PLANTED
from models.errors import InputError
from palpmap.__main__ import app
from tests.paths import ROOT

WARM_UP = ROOT / "examples" / "own_effect" / "warm_up.py"
HEAD = (
    "from identify.effects.base import Effect\nfrom identify.catalogue.breathing import Breathing\n"
)


def palpmap(*words: object, columns: int = 100):
    return CliRunner().invoke(app, [*map(str, words)], env={"COLUMNS": str(columns)})


def test_the_example_is_loaded_and_keeps_to_the_kit():
    effect = load_effect(WARM_UP)
    assert effect.name == "warm_up"
    assert failures(check_effect(effect)) == []


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("", "defines no effect"),
        ("x = 1 +\n", "line 1"),
        ("\nraise RuntimeError('oh')\n", "line 2: RuntimeError: oh"),
        ("import nothing_of_that_name\n", "line 1: ModuleNotFoundError"),
        ("import sys\nsys.exit()\n", "SystemExit"),
        ("class A(Effect):\n    name = 'a'\nclass B(A):\n    name = 'b'\n", "2 effects (A, B)"),
        ("class A(Effect):\n    name = 'a'\n", "A has no title, summary"),
        ("class A(Breathing):\n    pass\n", "called 'breathing', as a built-in effect is"),
        (
            "class A(Breathing):\n    name = 'a'\n    def reading(self, readings, force_n, "
            "travel_m, values):\n        pass\n",
            "own.py: reading(self, readings, force_n, travel_m, values) is the old form: write "
            "reading(self, readings, force_n, travel_m, *, sine_m, cosine_m, frequency_hz)",
        ),
        (
            "class A(Breathing):\n    name = 'a'\n    def __init__(self, x):\n        pass\n",
            "made without arguments",
        ),
    ],
)
def test_a_file_that_is_no_effect_is_refused_with_the_reason(source, says, tmp_path):
    file = tmp_path / "own.py"
    file.write_text(source if source.startswith(("x", "\n", "import")) else HEAD + source)
    with pytest.raises(InputError, match=re.escape(says)) as refused:
        load_effect(file)
    assert "own.py" in str(refused.value)


@pytest.mark.parametrize(
    ("needs", "found"), [('("time")', "t"), ('("many presses",)', "many presses")]
)
def test_needs_that_there_are_not_are_said_with_those_that_there_are(needs, found, tmp_path):
    path = tmp_path / "own.py"
    path.write_text(f"{HEAD}class Own(Breathing):\n    name = 'own'\n    needs = {needs}\n")
    says = next(
        r.says for r in check_effect(load_effect(path)) if r.check == "says what a scan lacks"
    )
    assert f'needs: found \'{found}\', expected a tuple of "time", "unloading"' in says


@pytest.mark.parametrize(
    ("name", "says"), [("own.txt", "expected a Python file"), ("o.py", "no such")]
)
def test_a_wrong_path_is_said(name, says, tmp_path):
    with pytest.raises(InputError, match=says):
        load_effect(tmp_path / name)


def test_the_table_names_every_effect_and_fits_the_terminal():
    for columns in (80, 100):
        shown = palpmap("effects", columns=columns)
        assert shown.exit_code == 0
        assert max(map(len, shown.stdout.splitlines())) <= columns
        for effect in CATALOGUE:
            assert re.search(rf"^ ?{effect.name} +{effect.link}", shown.stdout, re.MULTILINE)
        assert "…" not in shown.stdout  # no word is cut


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_a_page_tells_all_of_an_effect_in_80_columns(effect):
    shown = palpmap("effects", effect.name, columns=80)
    assert shown.exit_code == 0
    assert max(map(len, shown.stdout.splitlines())) <= 80
    words = " ".join(shown.stdout.split())
    for text in (effect.title, effect.summary, effect.formula, effect.gives_away, effect.source):
        said = " ".join(text.replace("`", "").split())
        assert said in words or said[0].upper() + said[1:] in words


def test_the_json_of_an_effect_says_its_parameters():
    said = json.loads(palpmap("effects", "viscoelasticity", "--json").stdout)
    assert [p["name"] for p in said["parameters"]] == ["g", "tau_s"]
    assert said["parameters"][1]["null"] is None
    every = json.loads(palpmap("effects", "--json").stdout)
    assert [e["name"] for e in every["effects"]] == [effect.name for effect in CATALOGUE]


def test_an_unknown_effect_is_bad_input():
    refused = palpmap("effects", "viscoelastic")
    assert refused.exit_code == 2
    assert "did you mean 'viscoelasticity'?" in refused.stderr


def test_an_own_effect_has_a_page_too():
    shown = palpmap("effects", WARM_UP)
    assert shown.exit_code == 0
    assert "Warm-up of the force sensor" in shown.stdout


def test_a_sound_effect_passes_the_command():
    done = palpmap("check-effect", WARM_UP, "--json")
    assert done.exit_code == 0
    said = json.loads(done.stdout)
    assert said["passed"] is True
    assert all(finding["passed"] for finding in said["findings"])


def test_a_check_that_was_not_made_is_not_said_to_be_kept(monkeypatch):
    why = NOT_PLANTED + "the stiffness map absorbs it entirely"
    monkeypatch.setattr(select, "plant_and_recover", lambda effect, own: why)
    done = palpmap("check-effect", WARM_UP)
    assert done.exit_code == 0
    assert re.search(r"^ *- +planted and found", done.stdout, re.MULTILINE)
    assert "keeps to the 16 checks that were made; not made: planted and found." in done.stdout
    said = json.loads(palpmap("check-effect", WARM_UP, "--json").stdout)
    assert said["not_made"] == ["planted and found"]
    assert [f["check"] for f in said["findings"] if not f["made"]] == said["not_made"]


def test_a_faulty_effect_fails_the_command(tmp_path):
    faulty = tmp_path / "faulty.py"
    faulty.write_text(WARM_UP.read_text().replace("0.2873576", "0.29"))
    done = palpmap("check-effect", faulty)
    assert done.exit_code == 1
    assert re.search(r"FAULT +worked examples come out", done.stdout)
    assert "1 of 17 checks" in done.stdout


def test_a_missing_file_is_bad_input():
    refused = palpmap("check-effect", "nowhere.py")
    assert refused.exit_code == 2
    assert "no such file" in refused.stderr


@pytest.mark.parametrize("command", ["effects", "check-effect"])
def test_help_warns_that_the_file_is_executed(command):
    assert "executed" in palpmap(command, "--help").stdout
