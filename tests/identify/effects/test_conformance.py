"""The conformance kit finds out effects that break their promises."""

from dataclasses import replace

import numpy as np
import pytest

from identify.catalogue.breathing import Breathing
from identify.catalogue.viscoelasticity import Viscoelasticity
from identify.effects.base import Effect, EffectParameter, WorkedExample
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.kit import check_effect, failures

OFFSET = EffectParameter("offset_m", "m", "of all readings", 0.0, -1.0, 1.0, 1e-4)


class Sound(Effect):
    """An offset that keeps to all; each broken effect below differs from it in one thing."""

    name, title, link = "sound", "Sound", "instrument"
    summary, formula, source = "One. Two.", "d = u + offset", "derivation"
    gives_away, cure = "all is shifted", "Zero it."
    parameters = (OFFSET,)
    examples = (
        WorkedExample(
            "1 mm and 0.1 mm.",
            {"offset_m": 1e-4},
            {"travel_m": 1e-3},
            {"displacement_m": 1.1e-3},
        ),
    )

    def reading(self, readings, force_n, travel_m, values):
        """Shift."""
        return travel_m + values["offset_m"]


class NoSource(Sound):
    source = " "


class Capital(Sound):
    name = "Sound"


class NoAmplitude(Sound):
    parameters = (EffectParameter("tau_s", "s", "time", None, 0.1, 10.0, 1.0),)


class NullOutside(Sound):
    parameters = (replace(OFFSET, lower=1e-5),)


class NoUnit(Sound):
    parameters = (replace(OFFSET, unit=""),)


class WrongEnding(Sound):
    parameters = (replace(OFFSET, name="offset_mm"),)


class LogOfAnAmplitude(Sound):
    parameters = (replace(OFFSET, log=True),)


class OtherLink(Sound):
    link = "body"


class TwoHooks(Sound):
    def force(self, readings, force_n, values):
        return force_n + values["offset_m"]


class NoHook(Sound):
    reading = Effect.reading


class NoExample(Sound):
    examples = ()


class WrongExample(Sound):
    examples = (replace(Sound.examples[0], expected={"displacement_m": 1.2e-3}),)


class ExampleAtTheNull(Sound):
    examples = (
        replace(Sound.examples[0], values={"offset_m": 0.0}, expected={"displacement_m": 1e-3}),
    )


class ChangesAtTheNull(Sound):
    def reading(self, readings, force_n, travel_m, values):
        return travel_m * (1 + 1e-9) + values["offset_m"]


class Random(Sound):
    def reading(self, readings, force_n, travel_m, values):
        noise = np.random.default_rng().normal(size=len(travel_m))
        return travel_m + values["offset_m"] * (1 + 1e-9 * noise)


class WritesToItsInput(Sound):
    def reading(self, readings, force_n, travel_m, values):
        out = travel_m
        out += values["offset_m"]
        return out


class NotFinite(Sound):
    def reading(self, readings, force_n, travel_m, values):
        with np.errstate(invalid="ignore"):
            return travel_m + values["offset_m"] * np.sqrt(force_n)


class WrongShape(Sound):
    def reading(self, readings, force_n, travel_m, values):
        return (travel_m + values["offset_m"])[:, None]


class MovesNothing(Sound):
    parameters = (OFFSET, replace(OFFSET, name="idle_m"))
    examples = (replace(Sound.examples[0], values={"offset_m": 1e-4, "idle_m": 0.0}),)


class Jumps(Sound):
    def reading(self, readings, force_n, travel_m, values):
        step = np.floor(travel_m * 1e7)
        return travel_m + values["offset_m"] * (1 + 10 * np.mod(step, 2))


class HidesItsNeed(Sound):
    def reading(self, readings, force_n, travel_m, values):
        return travel_m + values["offset_m"] * np.ones_like(readings.elapsed_s)


class AcceptsTooMuch(Sound):
    needs = ("unloading",)

    def untestable(self, readings):
        return None


class RefusesAll(Sound):
    def untestable(self, readings):
        return "never"


class NoNumber(Sound):
    def evidence(self, values, readings):
        return "All is shifted."


class Creep(Viscoelasticity):
    name = "creep"


class CoarseGrid(Breathing):
    name = "coarse"

    def grid(self, readings, state):
        return super().grid(readings, state)[::4]


class GridOutside(Viscoelasticity):
    name = "outside"

    def grid(self, readings, state):
        return [{"tau_s": 1e5}]


class EmptyGrid(Viscoelasticity):
    name = "empty"

    def grid(self, readings, state):
        return []


@pytest.mark.parametrize("kind", [Sound, Creep])
def test_a_sound_effect_passes(kind):
    assert failures(check_effect(kind())) == []


@pytest.mark.parametrize(
    ("kind", "check", "says"),
    [
        (NoSource, "described", "no source"),
        (Capital, "described", "'Sound'"),
        (NoAmplitude, "parameters with units and bounds", "no amplitude"),
        (NullOutside, "parameters with units and bounds", "null 0.0 is not between"),
        (NoUnit, "parameters with units and bounds", "no unit"),
        (WrongEnding, "parameters with units and bounds", "should end with _m"),
        (LogOfAnAmplitude, "parameters with units and bounds", "logarithm"),
        (OtherLink, "one hook, that of its link", "overrides reading, expected body"),
        (TwoHooks, "one hook, that of its link", "overrides force, reading"),
        (NoHook, "one hook, that of its link", "overrides nothing"),
        (NoExample, "worked examples come out", "no worked example"),
        (WrongExample, "worked examples come out", "0.0011"),
        (ExampleAtTheNull, "worked examples come out", "at the null"),
        (ChangesAtTheNull, "identity at the null", "1.0e-09"),
        (Random, "deterministic", "second call differs"),
        (WritesToItsInput, "inputs untouched", "writes to travel_m"),
        (NotFinite, "finite and shaped", "not finite"),
        (WrongShape, "finite and shaped", "returns shape (550, 1)"),
        (MovesNothing, "every parameter moves a reading", "idle_m moves no reading"),
        (Jumps, "no jumps", "changes a reading by"),
        (HidesItsNeed, "says what a scan lacks", "no time stamps"),
        (AcceptsTooMuch, "says what a scan lacks", "needs unloading"),
        (RefusesAll, "says what a scan lacks", "is refused: never"),
        (NoNumber, "evidence in words and numbers", "no number"),
        (CoarseGrid, "neighbouring candidates alike", "take a finer grid"),
        (GridOutside, "candidates within bounds", "tau_s = 1e+05"),
        (EmptyGrid, "candidates within bounds", "no candidate"),
    ],
)
def test_a_broken_effect_is_found_out(kind, check, says):
    findings = {finding.check: finding for finding in failures(check_effect(kind()))}
    assert check in findings
    assert says in findings[check].says


def test_further_checks_are_run_and_named():
    def refuse(effect, own):
        raise Fault(f"{effect.name} is refused")

    *_, last = check_effect(Sound(), {"a further one": refuse})
    assert (last.check, last.passed, last.says) == ("a further one", False, "sound is refused")
