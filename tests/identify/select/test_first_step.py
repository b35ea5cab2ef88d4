"""The first step of a selection, from the contact law of the presses."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.select import first_step
from identify.select.settings import SELECTION


@dataclass(frozen=True)
class _Model:
    effects: tuple


def test_pairs_that_do_as_well_as_an_effect_leave_its_cause_undecided(monkeypatch):
    fit: Any = SimpleNamespace(map=None, model=_Model((SimpleNamespace(effect=CATALOGUE["play"]),)))
    pairs = [(("hysteresis", other), fit) for other in ("time_lag", "contact_offset")]
    fit.chi2, fit.between = 940.0, 5.0
    law: Any = SimpleNamespace(
        plain=SimpleNamespace(parts=()), found=fit, names=("play",), criterion=lambda _: 958.0,
        candidates=lambda _: [], splits=lambda _: pairs, range_of=lambda _: {},
    )  # fmt: skip
    tried: list[str] = []
    monkeypatch.setattr(first_step, "_joint_fit", lambda *_: fit)
    (play,) = first_step._accepted(law, fit, tried.append, SELECTION)
    both = ("hysteresis with time_lag", "hysteresis with contact_offset")
    assert play.group == ("play", *both)
    assert [c.chi2 for c in play.candidates] == [945.0] * 3  # with that of places pressed again
    assert not play.decided
    assert tried == [f"trying {names}" for names in both]
    law.splits = lambda _: []
    (play,) = first_step._accepted(law, fit, tried.append, SELECTION)
    assert play.decided


@dataclass(frozen=True)
class _Presses:
    """Fit of the presses alone."""

    names: tuple[str, ...]
    middle_misfit: float
    between: float = 0.0
    again: int = 0


@dataclass(frozen=True)
class _Law:
    """The presses call for play, and for two others nearly as well."""

    found: Any
    others: tuple
    names = ("play",)
    partial = None

    def candidates(self, name: str) -> list:
        return [("hysteresis", self.others[0])]

    def splits(self, name: str) -> list:
        return [(("hysteresis", "contact_offset"), self.others[1])]


@pytest.mark.parametrize("leaves", ["noise", "structure", "few presses", "map error"])
def test_laws_that_do_as_well_are_tried_where_the_first_leaves_structure(monkeypatch, leaves):
    play, loop, pair = (
        _Presses((name,), misfit)
        for name, misfit in (("play", 1.0), ("hysteresis", 1.3), ("pair", 1.05))
    )
    tried: list[str] = []

    def follow(law: Any, *_: Any) -> Any:
        tried.append(law.found.names[0])
        return law.found, []

    noise = {"noise": (play, pair)}.get(leaves, (pair,))
    few = np.array([leaves == "few presses"])
    monkeypatch.setattr(first_step, "follow", follow)
    monkeypatch.setattr(first_step, "_is_noise", lambda fit, *_: fit in noise)
    monkeypatch.setattr(first_step, "few_presses", lambda *_: few)
    monkeypatch.setattr(
        first_step, "forward_selection",
        lambda *_, policy, **__: policy.first(SimpleNamespace(), print),
    )  # fmt: skip
    error = 0.01 * (leaves == "map error")
    start: Any = SimpleNamespace(
        law=_Law(play, (loop, pair)), start=None, scan=None, catalogue=(), joint=None,
        model=SimpleNamespace(press_error=error), experiment=SimpleNamespace(say=print),
    )  # fmt: skip
    answer: Any = first_step.selected(start, 0, None, SELECTION)
    another = leaves == "structure"
    assert answer[0] is (pair if another else play)
    # The loop alone is no law of the presses
    assert tried == (["play", "pair"] if another else ["play"])
