"""Effects: base class, parameters and readings."""

from identify.effects.base import (
    COUNTED_FROM,
    Advice,
    Effect,
    EffectParameter,
    WorkedExample,
    advice,
    changes_body,
)
from identify.effects.initial import lacking_in
from identify.effects.readings import Readings
from identify.effects.units import digits, force, length, more, percent
from identify.effects.unknown_course import COURSES, UNKNOWN

__all__ = [
    "COUNTED_FROM",
    "COURSES",
    "UNKNOWN",
    "Advice",
    "Effect",
    "EffectParameter",
    "Readings",
    "WorkedExample",
    "advice",
    "changes_body",
    "digits",
    "force",
    "lacking_in",
    "length",
    "more",
    "percent",
]
