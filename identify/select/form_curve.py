"""The form of an effect with its 95 % band: the course of a drift, a bent law, creep, a surface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from identify.effects.base import Effect
from identify.effects.unknown_course import UnknownCourse
from identify.fit.profile_intervals import NORMAL_95
from identify.fit.result import FitResult
from identify.measurement.traced_chain import TracedChain
from identify.select.form_average import posterior_covariance

_OF_PLACE = "surface_tilt"  # family of what goes with the place
_MOST = 60  # points of a curve
_STEP = 1e-3  # of a scaled parameter, for difference quotients


@dataclass(frozen=True)
class FormCurve:
    """Contribution of an effect, along its argument or over the surface.

    Attributes
    ----------
    effect : name
    along, at_unit : argument in words, and its unit
    of, unit : quantity in words, and its unit
    at, value, lower95, upper95 : (p,)
    places_m : (p, 3) of a contribution that goes with the place, else empty; `at` counts presses
    """

    effect: str
    along: str
    at_unit: str
    of: str
    unit: str
    at: tuple[float, ...]
    value: tuple[float, ...]
    lower95: tuple[float, ...]
    upper95: tuple[float, ...]
    places_m: tuple[tuple[float, ...], ...] = ()


def form_curves(fit: FitResult) -> tuple[FormCurve, ...]:
    """Return the curve of each effect of a fit that has one: those of the body have none."""
    curves = (form_curve(fit, part.effect) for part in fit.model.effects)
    return tuple(curve for curve in curves if curve is not None)


def form_curve(fit: FitResult, effect: Effect) -> FormCurve | None:
    """Return what an effect adds along the session, the force or a press; None of other effects."""
    drawn = _drawn(fit, effect)
    if drawn is None:
        return None
    (along, at_unit, of, unit), at, added = drawn
    places = _places(fit) if effect.family == _OF_PLACE else np.zeros((0, 3))
    names = list(fit.model.names)
    own = [names.index(f"{effect.name}.{p.name}") for p in effect.parameters]
    parameters = [fit.model.unknowns.unknowns[i] for i in own]

    def course(u: np.ndarray) -> np.ndarray:
        values = [p.to_value(float(x)) for p, x in zip(parameters, u, strict=True)]
        return added(**{p.name: v for p, v in zip(effect.parameters, values, strict=True)})

    u = fit.u[own]
    value = course(u)
    slopes = np.column_stack([(course(u + h) - course(u - h)) / (2 * _STEP)
                              for h in _STEP * np.eye(len(own))])  # fmt: skip
    covariance = posterior_covariance(fit)[np.ix_(own, own)]
    reach = NORMAL_95 * np.sqrt(np.einsum("pi,ij,pj->p", slopes, covariance, slopes))
    ends = (value, value - reach, value + reach)
    middle, low, high = (tuple(end.tolist()) for end in ends)
    return FormCurve(effect.name, along, at_unit, of, unit, tuple(at.tolist()), middle, low, high,
                     tuple(tuple(place) for place in places.tolist()))  # fmt: skip


Words = tuple[str, str, str, str]
Drawn = tuple[Words, np.ndarray, Callable[..., np.ndarray]]


def _drawn(fit: FitResult, effect: Effect) -> Drawn | None:
    """Words of both axes, places (p,) and what the effect adds there by its parameters."""
    readings, hooks = fit.model.readings, cast(Any, effect)
    none = np.zeros(len(readings))
    if isinstance(effect, UnknownCourse):
        if effect.argument.at is None:
            return None
        places = effect.argument.at(readings)
        rows = np.flatnonzero(np.isfinite(places))
        rows = rows[_spread(places[rows])]
        words = (*effect.argument.axis, f"added, as {effect.as_what}", effect.parameters[0].unit)
        force = readings.force_n
        return words, places[rows], lambda **p: effect.course(readings, force, p)[rows]
    if effect.family in ("force_drift", "displacement_drift"):
        if readings.time_s is None:
            return None
        rows = _spread(readings.elapsed_s)
        at, along = readings.elapsed_s[rows], ("time of the session", "s")
        if "reading" in effect.hooks:
            words = (*along, "added to the displacement", "m")
            return words, at, lambda **p: hooks.reading(readings, none, none, **p)[rows]
        words = (*along, "added to the force", "N")
        return words, at, lambda **p: -hooks.force(readings, none, **p)[rows]
    if effect.family == _OF_PLACE:
        words = ("press", "", "added to the displacement", "m")
        return (
            words,
            1.0 + np.arange(readings.presses),
            lambda **p: hooks.reading(readings, none, none, **p)[readings.first],
        )
    what = ("added to the travel, as a share of the press's largest", "1")
    if effect.link == "contact" or effect.family == "force_saturation":
        rows, share = _along_force(fit, effect)
        return ("force, in one press", "N", *what), fit.at.latent_force_n[rows], share
    if "response" not in effect.hooks:
        return None
    force, travel = fit.at.latent_force_n, fit.at.body.compliance[readings.press]
    travel = travel * force
    largest = np.maximum(readings.peak_of(travel), 1e-12)

    def share(**parameters: float) -> np.ndarray:
        return (hooks.response(readings, force, travel, **parameters) - travel) / largest

    if effect.family == "preconditioning":
        steady = np.array([np.argmax(np.where(readings.press == j, force, -np.inf))
                           for j in range(readings.presses)])  # fmt: skip
        rows = steady[_spread(readings.order.astype(float))]
        at = readings.order[readings.press[rows]].astype(float)
        return ("press, in the order of making", "", *what), at, lambda **p: share(**p)[rows]
    # Of the press to which the effect adds most
    added = np.abs(share(**fit.at.values[effect.name]))
    rows = np.flatnonzero(readings.press == readings.press[int(np.argmax(added))])
    if readings.time_s is None:
        return (
            ("reading of a press", "", *what),
            np.arange(len(rows)) + 1.0,
            (lambda **p: share(**p)[rows]),
        )
    at = readings.time_s[rows] - readings.touch_time_s[readings.press[rows[0]]]
    return ("time since touch, in one press", "s", *what), at, lambda **p: share(**p)[rows]


def _places(fit: FitResult) -> np.ndarray:
    """Contact points (j, 3) m of all presses."""
    readings = fit.model.readings
    return readings.point_m[readings.first]


def _along_force(fit: FitResult, effect: Effect) -> tuple[np.ndarray, Callable[..., np.ndarray]]:
    """Rows of the way in of the press to which an effect adds most, and what it adds there."""
    at, readings, own = fit.at, fit.model.readings, fit.at.values[effect.name]
    chain = TracedChain(fit.model.chain, at.point)
    absent = chain.with_values(effect.name, {**own, **effect.null})
    largest = np.maximum(readings.peak_of(absent), 1e-12)

    def share(**parameters: float) -> np.ndarray:
        return (chain.with_values(effect.name, parameters) - absent) / largest

    press = readings.press[int(np.argmax(np.abs(share(**own))))]
    rows = np.flatnonzero((readings.press == press) & (readings.phase != "unload"))
    rows = rows[_spread(at.latent_force_n[rows])]  # without the noise of the reading
    return rows, lambda **parameters: share(**parameters)[rows]


def _spread(at: np.ndarray) -> np.ndarray:
    """Return indices of at most `_MOST` values, evenly through their order."""
    order = np.argsort(at, kind="stable")
    return order[np.unique(np.linspace(0, len(order) - 1, _MOST).round().astype(int))]
