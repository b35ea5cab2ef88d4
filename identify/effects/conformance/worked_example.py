"""Run a worked example: its few readings, its hook, its output."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, Pressing, WorkedExample, changes_body
from identify.effects.readings import Readings
from identify.map.gaussian_map import Inclusion

_BOX_M = ((0.0, 0.0, 0.0), (0.096, 0.096, 0.048))
_PER_READING = {
    "press", "time_s", "phase", "point_m", "force_n", "travel_m", "compliance_m_per_n",
    "modulus_pa", "radius_m", "contact_radius_m",
}  # fmt: skip
_INCLUSION = Inclusion(1.0, 0.0, 0.0, 0.0, 0.01)
_GIVEN = _PER_READING | {"order", "poisson_ratio"}
_BY_HOOK = {
    "force": "force_n",
    "contact": "travel_m",
    "response": "travel_m",
    "reading": "displacement_m",
    "touch": "displacement_m",
}


def work(effect: Effect, example: WorkedExample) -> dict[str, np.ndarray]:
    """Return the output of the effect's hook, under the names of `example.expected`.

    Input, one value for each of the m readings or one for all: `press`, `time_s`, `phase`,
    `point_m`, `force_n`, `travel_m`, and for the contact `radius_m` (of the probe),
    `contact_radius_m`, `compliance_m_per_n`, `modulus_pa`; besides, `order` of the presses and
    `poisson_ratio`. The default is one press loading at the origin, 0.3 N, 1 mm, a tip of 5 mm,
    6 kPa. Output of body effects: at the points `point_m`, `factor`, `added_pa` and `inclusion`
    (share of the weight of an inclusion of 10 mm at the origin), or any attribute of `BodyState`.

    Raises
    ------
    ValueError
        The example gives or expects something unknown.
    """
    unknown = set(example.given) - _GIVEN
    if unknown:
        raise ValueError(f"an example cannot give {sorted(unknown)}; it can: {sorted(_GIVEN)}")
    inputs = Inputs(example.given)
    if changes_body(effect):
        nu = float(inputs.get("poisson_ratio", 0.49)[0])
        return _body(effect.body(BodyState(_BOX_M, nu), **example.values), inputs, example)
    out = apply(
        effect, inputs.readings(), inputs.pressing(), inputs.get("travel_m", 1e-3), example.values
    )
    (hook,) = effect.hooks
    if set(example.expected) != {_BY_HOOK[hook]}:
        raise ValueError(f"an example of a '{hook}' expects {_BY_HOOK[hook]} and nothing else")
    return {_BY_HOOK[hook]: out}


def apply(
    effect: Effect,
    readings: Readings,
    pressing: Pressing,
    travel_m: np.ndarray,
    values: Mapping[str, float],
) -> np.ndarray:
    """Return the output of the effect's hook: forces or travels (m,). Not for bodies."""
    force, hooks = readings.force_n, cast(Any, effect)
    match effect.hooks:
        case ("force",):
            return hooks.force(readings, force, **values)
        case ("contact",):
            return hooks.contact(readings, pressing, force, travel_m, **values)
        case ("response",):
            return hooks.response(readings, force, travel_m, **values)
        case ("touch",):  # a linear contact
            return travel_m - pressing.compliance_m_per_n * hooks.touch(readings, **values)
    return hooks.reading(readings, force, travel_m, **values)


class Inputs:
    """Input of an example, spread over its m readings."""

    def __init__(self, given: Mapping[str, object]):
        self._given = given
        sizes = [len(np.atleast_1d(v)) for k, v in given.items() if k in _PER_READING]  # type: ignore[arg-type]
        self._size = max(sizes, default=1)

    def get(self, name: str, otherwise: object) -> np.ndarray:
        """Return the values of a name, (m,) or (m, 3); one for each press for `order`."""
        value = np.asarray(self._given.get(name, otherwise))
        if name not in _PER_READING:
            return np.atleast_1d(value)
        shape = (self._size, 3) if name == "point_m" else (self._size,)
        return np.broadcast_to(value, shape).copy()

    def readings(self) -> Readings:
        """Return the readings."""
        press = self.get("press", 0).astype(int)
        presses = int(press.max()) + 1
        return Readings(
            press=press,
            order=self.get("order", np.arange(presses)),
            time_s=self.get("time_s", 0.0) if "time_s" in self._given else None,
            phase=self.get("phase", "load"),
            point_m=self.get("point_m", (0.0, 0.0, 0.0)),
            direction=np.tile((0.0, 0.0, -1.0), (self._size, 1)),
            force_n=self.get("force_n", 0.3),
            radius_m=self.get("radius_m", 5e-3),
        )

    def pressing(self) -> Pressing:
        """Return the body under each reading's tip."""
        return Pressing(
            compliance_m_per_n=self.get("compliance_m_per_n", 0.01),
            modulus_pa=self.get("modulus_pa", 6000.0),
            radius_m=self.get("contact_radius_m", 5e-3),
            poisson_ratio=float(self.get("poisson_ratio", 0.49)[0]),
            profile="flat",
        )


def _body(state: BodyState, inputs: Inputs, example: WorkedExample) -> dict[str, np.ndarray]:
    points = inputs.get("point_m", (0.0, 0.0, 0.0))
    fields = {
        "factor": state.factor,
        "added_pa": state.added_pa,
        "inclusion": lambda points: state.inclusion_shape.added(_INCLUSION, points)[0],
    }
    found = {}
    for name in example.expected:
        if name in fields:
            found[name] = fields[name](points)
        elif hasattr(state, name):
            found[name] = np.atleast_1d(getattr(state, name))
        else:
            raise ValueError(f"an example cannot expect '{name}' of a body")
    return found
