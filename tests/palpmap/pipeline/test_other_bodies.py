"""The benchmark of bodies of other shapes: what it hides, and how it judges an answer."""

import numpy as np
import pytest

from benchmarks.other_bodies import KINDS, beside_map, body
from palpmap.blind.records import AnswerRecord
from sim.body import PAPER_SIZE_M


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_is_stiffer_or_softer_inside_and_positive_everywhere(kind):
    truth = body(kind, 5)
    points = np.random.default_rng(0).uniform(0, PAPER_SIZE_M, (20_000, 3))
    ratio = truth(points) / truth.background_pa
    least, most = (0.2, 1.001) if kind == "soft" else (0.999, 5.5)
    assert least < ratio.min()
    assert ratio.max() < most
    assert ratio.max() > 1.5 or ratio.min() < 0.6
    assert 0 < np.mean(np.abs(ratio - 1) > 0.2) < 0.5


@pytest.mark.parametrize(
    ("verdict", "added", "ambiguous", "left"),
    [
        ("explained", ("extra_inclusion",), (), ("nothing_missing", (), 0)),
        ("explained", ("inclusion_edge", "time_lag"), (), ("explained", ("time_lag",), 0)),
        ("ambiguous", (), (("inclusion_edge", "another_cause"),), ("nothing_missing", (), 0)),
        ("ambiguous", (), (("time_lag", "skin_layer"),), ("ambiguous", (), 1)),
        ("unexplained", ("extra_inclusion",), (), ("unexplained", (), 0)),
    ],
)
def test_names_of_the_maps_form_are_judged_apart(verdict, added, ambiguous, left):
    answer = beside_map(AnswerRecord(verdict=verdict, added=added, ambiguous=ambiguous))
    assert (answer.verdict, answer.added) == left[:2]
    assert len(answer.ambiguous) == left[2]
