"""A user's effect that raises, exits, never ends or returns nonsense is stopped in a sentence."""

import time

import numpy as np
import pytest

from identify.catalogue import guarded, load_effect
from identify.effects.conformance.example_scan import trial
from models.errors import InputError

HEAD = """
import sys
import numpy as np
from palpmap import Effect, EffectParameter, WorkedExample

class Own(Effect):
    name = title = summary = formula = source = gives_away = cure = "own"
    parameters = (EffectParameter("g", "", "size", null=0.0, typical=0.1, lower=0.0, upper=1.0),)
    examples = ()

    def response(self, readings, force_n, travel_m, *, g):
"""


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("raise KeyError('hold')", r"own\.py, line 12: KeyError: 'hold', raised by Own\.response"),
        ("sys.exit()", r"own\.py, line 12: Own\.response\(\) calls sys\.exit"),
        ("\n        while True: pass", r"own\.py, line 1\d: Own\.response\(\) has not ended after"),
        ("return travel_m[:-1]", r"Own\.response\(\) returns \(\d+,\), expected an array of shape"),
        ("return 'far'", r"Own\.response\(\) returns str, expected an array"),
        ("return None", r"Own\.response\(\) returns \(\), expected an array"),
    ],
)
def test_an_effect_that_fails_at_work_is_named_with_file_and_line(
    body, says, tmp_path, monkeypatch
):
    monkeypatch.setattr(guarded, "LONGEST_CALL_S", 0.2)
    file = tmp_path / "own.py"
    file.write_text(f"{HEAD}        {body}\n")
    effect, readings = load_effect(file), trial().readings
    begun = time.monotonic()
    with pytest.raises(InputError, match=says):
        effect.response(readings, np.ones(len(readings)), np.ones(len(readings)), g=0.1)
    assert time.monotonic() - begun < 5


def test_a_file_that_never_ends_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(guarded, "LONGEST_CALL_S", 0.2)
    file = tmp_path / "own.py"
    file.write_text("while True:\n    try:\n        pass\n    except Exception:\n        pass\n")
    with pytest.raises(InputError, match=r"own\.py, line \d: the file has not ended after 0\.2 s"):
        load_effect(file)
