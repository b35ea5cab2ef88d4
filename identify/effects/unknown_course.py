"""Causes without a name: a smooth function of one argument, as one quantity.

Where no effect of the catalogue removes the structure of a residual, a course stands in for the
cause that the catalogue lacks: it goes along something (the time of the session, the time within a
press, the force, the force on the way back, the place) and acts as something (a length, a force, a
share of the travel). It describes the cause, keeps it out of the map, and competes with the effects
of the catalogue, so that none is taken for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Need, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import KNOTS, natural_spline, smooth_in_time
from identify.effects.units import force, length, percent

UNKNOWN = "unknown"  # family of all courses


class _Argument(NamedTuple):
    """Quantity along which a course goes.

    `course` (m,) at forces (m,) by its amplitudes (q,), `words` for a sentence, `needs`; for a
    picture `axis`, its name and unit, and the places `at` (m,) on it, NaN where the course is
    nothing.
    """

    course: Callable[[Readings, np.ndarray, Sequence[float]], np.ndarray]
    words: str
    needs: tuple[Need, ...]
    axis: tuple[str, str] = ("", "")
    at: Callable[[Readings], np.ndarray] | None = None


def _session(readings: Readings, force_n: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    return smooth_in_time(readings, sizes)


def _within(readings: Readings, force_n: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    # Creep begins fast
    share = np.sqrt(readings.since_touch_s / max(readings.scales.press_s, 1e-9))
    return natural_spline(share, (0.0, *sizes))


def _force(readings: Readings, force_n: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    share = np.clip(force_n / max(readings.scales.force_n, 1e-12), 0.0, 1.0)
    return natural_spline(share, (0.0, *sizes))


def _back(readings: Readings, force_n: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    return _force(readings, force_n, sizes) * (readings.phase == "unload")


def _place(readings: Readings, force_n: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    x, y = readings.in_plane.T
    return np.column_stack([x, y, x * x, x * y, y * y]) @ np.asarray(sizes)


_ARGUMENTS = {
    "session": _Argument(
        _session,
        "the time of the session, smoothly, the same at all places",
        ("time", "several presses"),
        ("time of the session", "s"),
        lambda readings: readings.elapsed_s,
    ),
    "within": _Argument(
        _within,
        "the time within a press, alike in all presses",
        ("time",),
        ("time since touch", "s"),
        lambda readings: readings.since_touch_s,
    ),
    "force": _Argument(
        _force,
        "the force, alike in all presses",
        ("several forces",),
        ("force", "N"),
        lambda readings: readings.force_n,
    ),
    "back": _Argument(
        _back,
        "the force on the way back, alike in all presses",
        ("unloading", "several forces"),
        ("force on the way back", "N"),
        lambda readings: np.where(readings.phase == "unload", readings.force_n, np.nan),
    ),
    "place": _Argument(
        _place, "the place on the surface, smoothly, whenever it is pressed", ("several presses",)
    ),
}


class UnknownCourse(Effect):
    """A smooth function of one argument with five amplitudes; a class by argument and quantity."""

    family = UNKNOWN
    argument: _Argument
    quantity: str
    as_what: str
    largest, typical = 1.0, 0.03
    summary = (
        "Something that is in no effect of the catalogue. It is described by what it goes along "
        "and by the quantity that it changes; whoever knows the set-up may recognise it."
    )
    source = (
        "P. J. Green, B. W. Silverman, Nonparametric Regression and Generalized Linear Models, "
        "Chapman and Hall 1994, ch. 2 (natural cubic splines)"
    )
    gives_away = "the residual goes along it, and follows no effect of the catalogue"
    cure = "Find what changes along it, and write it as an effect of your own."
    examples: tuple[WorkedExample, ...] = ()

    def course(self, readings: Readings, force_n: np.ndarray, values: Values) -> np.ndarray:
        """Return the course (m,) at acting forces (m,), in the unit of its quantity."""
        return self.argument.course(readings, force_n, [values[p.name] for p in self.parameters])

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say along what it goes, as what, and how far."""
        said = {"length": length, "force": force, "share": percent}[self.quantity]
        size = said(float(np.ptp(self.course(readings, readings.force_n, values))))
        how = f"{self.argument.words}, as {self.as_what}, up to {size}"
        return f"What is missing goes with {how}."


class _Length(UnknownCourse):
    quantity, largest, typical = "length", 0.05, 1e-4

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, **values: float
    ) -> np.ndarray:
        """Add the course."""
        return travel_m + self.course(readings, force_n, values)


class _Force(UnknownCourse):
    quantity = "force"

    def force(self, readings: Readings, force_n: np.ndarray, **values: float) -> np.ndarray:
        """Take the course off."""
        return force_n - self.course(readings, force_n, values)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound each amplitude by the largest force."""
        most = max(readings.largest_force_n, 1e-3)
        return tuple(
            replace(p, lower=-most, upper=most, typical=0.03 * most) for p in self.parameters
        )


class _Share(UnknownCourse):
    quantity = "share"

    def response(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, **values: float
    ) -> np.ndarray:
        """Add the course's share of the travel."""
        return travel_m * (1 + self.course(readings, force_n, values))


_QUANTITIES: dict[str, tuple[type[UnknownCourse], str, str]] = {
    "length": (_Length, "a length", "m"),
    "force": (_Force, "a force", "N"),
    "share": (_Share, "a share of the travel", "1"),
}


def _named(along: str, quantity: str) -> UnknownCourse:
    base, as_what, unit = _QUANTITIES[quantity]
    argument = _ARGUMENTS[along]
    what = argument.words.partition(",")[0]
    own: dict[str, Any] = {
        "name": f"unknown_{along}_{quantity}",
        "family": UNKNOWN,
        "argument": argument,
        "as_what": as_what,
        "title": f"Unknown cause that goes with {what}, as {as_what}",
        "formula": f"{as_what} that is a smooth function of {what}",
        "needs": argument.needs,
        "parameters": tuple(
            EffectParameter(f"c{i + 1}", unit, f"amplitude {i + 1} of the course", 0.0,
                            -base.largest, base.largest, base.typical)
            for i in range(KNOTS)
        ),
    }  # fmt: skip
    return type(f"{base.__name__}Over{along.title()}", (base,), own)()


COURSES: tuple[UnknownCourse, ...] = tuple(
    _named(along, quantity)
    for along, quantities in (
        ("session", ("length", "force", "share")),
        ("within", ("length", "force", "share")),
        ("force", ("length", "share")),
        ("back", ("length", "force", "share")),
        ("place", ("length", "force")),
    )
    for quantity in quantities
)
"""All courses; of the place, a share of the travel is a map."""
