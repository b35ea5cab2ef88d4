"""Mutated studies and scans: an answer or one sentence; no traceback, no hang, little memory."""

import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from palpmap.__main__ import app
from tests.fuzz.mutations import mutate

RUN = CliRunner()
LONGEST_S = 60.0
MOST_BYTES = 4e9
LONGEST_SENTENCE = 2500
HEALTH = list(HealthCheck)


def peak_bytes() -> float:
    if sys.platform == "win32":
        return 0.0
    import resource

    kilo = 1 if sys.platform == "darwin" else 1024
    return float(kilo * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def stopped(*_: object) -> None:
    raise TimeoutError(f"took more than {LONGEST_S:g} s")


def check_of_a_mutation(seed: int) -> None:
    """Run `palpmap check` on the mutation of a seed."""
    before, begun = peak_bytes(), time.monotonic()
    if hasattr(signal, "alarm"):
        signal.signal(signal.SIGALRM, stopped)
        signal.alarm(int(LONGEST_S))
    try:
        with tempfile.TemporaryDirectory() as folder:
            study = mutate(Path(folder), np.random.default_rng(seed))
            done = RUN.invoke(app, ["check", str(study)])
    finally:
        if hasattr(signal, "alarm"):
            signal.alarm(0)
    assert time.monotonic() - begun < LONGEST_S, seed
    assert done.exit_code in (0, 2), (seed, done.output[-500:], done.exception)
    if done.exit_code == 2:
        said = done.stderr.strip()
        assert said.startswith("palpmap: "), (seed, said[:500])
        assert "\n" not in said, (seed, said[:500])
        assert len(said) < LONGEST_SENTENCE, (seed, len(said), said[:300])
    assert peak_bytes() <= max(before, MOST_BYTES), seed


@given(seed=st.integers(0, 2**32))
@settings(max_examples=200, deadline=None, derandomize=True, suppress_health_check=HEALTH)
def test_mutated_studies_and_scans_get_an_answer_or_one_sentence(seed):
    check_of_a_mutation(seed)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32))
@settings(max_examples=2000, deadline=None, suppress_health_check=HEALTH)
def test_many_mutated_studies_and_scans_get_an_answer_or_one_sentence(seed):
    check_of_a_mutation(seed)
