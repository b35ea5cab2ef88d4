"""The first step of a selection, from the contact law of the presses."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from identify.catalogue.catalogue import CATALOGUE
from identify.select import first_step
from identify.select.settings import SELECTION


@dataclass(frozen=True)
class _Model:
    effects: tuple


def test_pairs_that_do_as_well_as_an_effect_leave_its_cause_undecided(monkeypatch):
    fit: Any = SimpleNamespace(map=None, model=_Model((SimpleNamespace(effect=CATALOGUE["play"]),)))
    pairs = [(("hysteresis", other), fit) for other in ("time_lag", "contact_offset")]
    fit.chi2 = 940.0
    law: Any = SimpleNamespace(
        plain=SimpleNamespace(parts=()), found=fit, names=("play",), criterion=lambda _: 958.0,
        candidates=lambda _: [], splits=lambda _: pairs, range_of=lambda _: {},
    )  # fmt: skip
    tried: list[str] = []
    monkeypatch.setattr(first_step, "_joint_fit", lambda *_: fit)
    (play,) = first_step._accepted(law, fit, tried.append, SELECTION)
    both = ("hysteresis with time_lag", "hysteresis with contact_offset")
    assert play.group == ("play", *both)
    assert not play.decided
    assert tried == [f"trying {names}" for names in both]
    law.splits = lambda _: []
    (play,) = first_step._accepted(law, fit, tried.append, SELECTION)
    assert play.decided
