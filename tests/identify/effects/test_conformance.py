"""The conformance kit finds out effects that break their promises."""

from dataclasses import replace

import numpy as np
import pytest

from identify.catalogue.breathing import Breathing
from identify.catalogue.viscoelasticity import Viscoelasticity
from identify.effects.base import Effect, EffectParameter, WorkedExample
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.kit import check_effect, failures

HOOK = "one hook, parameters by name"
RIGHT = "form: write reading(self, readings, force_n, travel_m, *, offset_m)"
OFFSET = EffectParameter("offset_m", "m", "of all readings", 0.0, -1.0, 1.0, 1e-4)


class Sound(Effect):
    """An offset that keeps to all; each broken effect below differs from it in one thing."""

    name, title = "sound", "Sound"
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

    def reading(self, readings, force_n, travel_m, *, offset_m):
        """Shift."""
        return travel_m + offset_m


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


class OldForm(Sound):
    def reading(self, readings, force_n, travel_m, values):
        return travel_m + values["offset_m"]


class NamesNothing(Sound):
    def reading(self, readings, force_n, travel_m, **values):
        return travel_m + values["offset_m"]


class MissesAParameter(Sound):
    def reading(self, readings, force_n, travel_m):
        return travel_m


class NamesAnUnknown(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m, slope):
        return travel_m + offset_m + slope


class TakesByPlace(Sound):
    def reading(self, readings, force_n, travel_m, offset_m):
        return travel_m + offset_m


class GivenTooLittle(Sound):
    def reading(self, readings, travel_m, *, offset_m):
        return travel_m + offset_m


class TwoHooks(Sound):
    def force(self, readings, force_n, *, offset_m):
        return force_n + offset_m


class NoHook(Sound):
    reading = None


class NoExample(Sound):
    examples = ()


class WrongExample(Sound):
    examples = (replace(Sound.examples[0], expected={"displacement_m": 1.2e-3}),)


class ExampleAtTheNull(Sound):
    examples = (
        replace(Sound.examples[0], values={"offset_m": 0.0}, expected={"displacement_m": 1e-3}),
    )


class ChangesAtTheNull(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        return travel_m * (1 + 1e-9) + offset_m


class Random(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        noise = np.random.default_rng().normal(size=len(travel_m))
        return travel_m + offset_m * (1 + 1e-9 * noise)


class WritesToItsInput(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        out = travel_m
        out += offset_m
        return out


class NotFinite(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        with np.errstate(invalid="ignore"):
            return travel_m + offset_m * np.sqrt(force_n)


class WrongShape(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        return (travel_m + offset_m)[:, None]


class MovesNothing(Sound):
    parameters = (OFFSET, replace(OFFSET, name="idle_m"))
    examples = (replace(Sound.examples[0], values={"offset_m": 1e-4, "idle_m": 0.0}),)

    def reading(self, readings, force_n, travel_m, *, offset_m, idle_m):
        return travel_m + offset_m


class Jumps(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        step = np.floor(travel_m * 1e7)
        return travel_m + offset_m * (1 + 10 * np.mod(step, 2))


class HidesItsNeed(Sound):
    def reading(self, readings, force_n, travel_m, *, offset_m):
        return travel_m + offset_m * np.ones_like(readings.elapsed_s)


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


class ColumnsOfAnother(Breathing):
    def reading(self, readings, force_n, travel_m, *, sine_m, cosine_m, frequency_hz):
        late = self.moved(readings, frequency_hz, (-cosine_m, sine_m))
        return travel_m + late


class ColumnsOfAnotherShape(Breathing):
    def columns(self, readings, shapes):
        return super().columns(readings, shapes)[..., :1]


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
        (TwoHooks, HOOK, "has the hooks force, reading"),
        (NoHook, HOOK, "has no hook: write one of body, "),
        (OldForm, HOOK, f"reading(self, readings, force_n, travel_m, values) is the old {RIGHT}"),
        (NamesNothing, HOOK, f"reading() does not name its parameters{RIGHT[4:]}"),
        (MissesAParameter, HOOK, f"reading() misses the parameter offset_m{RIGHT[4:]}"),
        (NamesAnUnknown, HOOK, f"takes slope, which is none of its parameters{RIGHT[4:]}"),
        (TakesByPlace, HOOK, f"takes offset_m by place, not by name alone{RIGHT[4:]}"),
        (GivenTooLittle, HOOK, f"is given 3 arguments before its parameters{RIGHT[4:]}"),
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
        (ColumnsOfAnother, "patterns of many shapes at once", "not what sine_m changes"),
        (ColumnsOfAnotherShape, "patterns of many shapes at once", "expected (7, 550, 2)"),
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
