"""The start of an effect of one's own passes every check of the kit before it is changed."""

import pytest

from identify.catalogue import load_effect
from identify.effects.conformance import check_effect
from palpmap.result.own_effect import PATTERNS, write_own_effect


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_start_of_an_effect_passes_the_checks(tmp_path, pattern):
    path = tmp_path / "own_effect.py"
    write_own_effect(pattern, path)
    failed = [r for r in check_effect(load_effect(path)) if not r.passed]
    assert not failed


def test_an_effect_that_was_changed_stays(tmp_path):
    path = tmp_path / "own_effect.py"
    path.write_text("# mine\n")
    write_own_effect("force", path)
    assert path.read_text() == "# mine\n"
