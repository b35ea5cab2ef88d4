"""The measurement chain with its effects, from forces to the displacement of the robot.

d = reading(response(contact(C force(F)))), see `identify.effects.base`. Under a ball (profile
"hertz") the contact grows with the force (`identify.effects.sphere`). Everything beyond the
body's compliances is arithmetic on the m readings, so that its derivatives are difference
quotients: one more evaluation each, at no cost beside the finite elements.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from identify.effects.base import Effect, Hook, Pressing, Values
from identify.effects.readings import Readings
from identify.effects.sphere import ElasticTravel, ball_travel

_STEP = 1e-4  # of compliance, local modulus and typical sizes, for difference quotients
_PREDICTIONS = 24 * 24  # readings of a press times changes of the force, in a chain with a memory
_TOUCHED = 8  # travels up to the touch that are kept
_BALLS = 2  # travels of a ball that are kept
_HOOKS: dict[str, Hook] = {
    "_forces": "force",
    "_contacts": "contact",
    "_responses": "response",
    "_readings": "reading",
    "_touches": "touch",
}


class OperatingPoint(NamedTuple):
    """Where a chain of j presses and m readings is evaluated.

    Attributes
    ----------
    compliance, modulus : (j,) of the body, m/N, and under the tip, Pa
    force_n : (m,)
    values : parameters' values by the name of each effect
    """

    compliance: np.ndarray
    modulus: np.ndarray
    force_n: np.ndarray
    values: Mapping[str, Values]


@dataclass(frozen=True)
class Chain:
    """The links beyond the body, for m readings of j presses.

    Attributes
    ----------
    readings : of the scan
    effects : acting ones, within a link by their `order`, not by their order in the model
    radius_m : (j,) contact radius of the body's model
    profile : "flat", a flat tip of that radius, or "hertz", a ball of the probe's radius
    poisson_ratio : of the body
    curvature_per_m, growth : (j,) under a ball, see `Pressing`
    """

    readings: Readings
    effects: Sequence[Effect]
    radius_m: np.ndarray
    profile: str
    poisson_ratio: float
    curvature_per_m: np.ndarray | float = 0.0
    growth: np.ndarray | None = None
    _under: tuple[Any, Any, Any] = field(init=False, repr=False, compare=False)
    _forces: list[Any] = field(init=False, repr=False, compare=False)
    _contacts: list[Any] = field(init=False, repr=False, compare=False)
    _responses: list[Any] = field(init=False, repr=False, compare=False)
    _readings: list[Any] = field(init=False, repr=False, compare=False)
    _later: list[tuple[str, Callable[..., np.ndarray]]] = field(
        init=False, repr=False, compare=False
    )  # hooks beyond the elastic travel, with the names of their effects
    _touches: list[Any] = field(init=False, repr=False, compare=False)
    _touched: dict[Any, np.ndarray] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _balls: dict[Any, ElasticTravel] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        acting = sorted(self.effects, key=attrgetter("order"))
        object.__setattr__(self, "effects", acting)
        for name, hook in _HOOKS.items():
            object.__setattr__(self, name, [e for e in acting if hook in e.hooks])
        later = [(e.name, e.response) for e in self._responses]
        later += [(e.name, e.reading) for e in self._readings]
        object.__setattr__(self, "_later", later)
        each = self.readings.press
        curvature = np.broadcast_to(self.curvature_per_m, len(self.radius_m))[each]
        growth = None if self.growth is None else self.growth[each]
        object.__setattr__(self, "_under", (self.radius_m[each], curvature, growth))

    def predict(self, at: OperatingPoint) -> np.ndarray:
        """Displacement (m,)."""
        force_n = self._acting(at.force_n, at.values)
        acting = at._replace(force_n=force_n)
        return self._beyond(force_n, self._from_touch(acting), at.values)

    def _acting(self, force_n: np.ndarray, values: Mapping[str, Values]) -> np.ndarray:
        """Return the forces (m,) that act on the body, by those that the sensor reads."""
        for effect in self._forces:
            force_n = effect.force(self.readings, force_n, **values[effect.name])
        return force_n

    def _from_touch(self, at: OperatingPoint) -> np.ndarray:
        """Elastic travel (m,) under the acting forces (m,), counted from the touch."""
        return self._since_touch(at, self._elastic(at))

    def _since_touch(self, at: OperatingPoint, travel: np.ndarray) -> np.ndarray:
        """Elastic travel (m,), counted from the touch."""
        own = at.values
        touch = sum(effect.touch(self.readings, **own[effect.name]) for effect in self._touches)
        return travel - self._up_to(touch, at) if touch else travel

    def _up_to(self, touch_n: float, at: OperatingPoint) -> np.ndarray:
        """Elastic travel (m,) up to the force of touch; the last ones are kept.

        The forces of the readings, by which most predictions differ, have no part in it.
        """
        own = tuple(tuple(at.values[effect.name].values()) for effect in self._contacts)
        key = (touch_n, at.compliance.tobytes(), at.modulus.tobytes(), own)
        if key not in self._touched:
            if len(self._touched) >= _TOUCHED:
                self._touched.clear()
            start = np.full(len(self.readings), touch_n)
            self._touched[key] = self._elastic(at._replace(force_n=start))
        return self._touched[key]

    def _beyond(
        self, force_n: np.ndarray, travel: np.ndarray, values: Mapping[str, Values]
    ) -> np.ndarray:
        """Displacement (m,) for acting forces (m,) and the elastic travels (m,) under them."""
        for name, hook in self._later:
            travel = hook(self.readings, force_n, travel, **values[name])
        return travel

    @property
    def nonlinear(self) -> bool:
        """True if travel is not proportional to force within a press."""
        return self.profile == "hertz" or bool(self._contacts)

    def _elastic(self, at: OperatingPoint) -> np.ndarray:
        """Elastic travel (m,) of the tip under the acting forces (m,)."""
        return self._contacted(at, self._bare(at).travel_m)

    def _pressing(self, at: OperatingPoint) -> Pressing:
        each, ball = self.readings.press, self.profile == "hertz"
        radius, curvature, growth = self._under
        return Pressing(
            at.compliance[each], at.modulus[each], radius, self.poisson_ratio,
            "hertz" if ball else "flat", curvature, growth,
        )  # fmt: skip

    def _bare(self, at: OperatingPoint) -> ElasticTravel:
        """Elastic travel under the acting forces without effects of the contact; the last is kept.

        Of a ball it is the dearest part of a prediction, and several derivatives share it.
        """
        if self.profile != "hertz":
            compliance = at.compliance[self.readings.press]
            travel = compliance * at.force_n
            return ElasticTravel(travel, compliance, travel)
        key = (at.force_n.tobytes(), at.compliance.tobytes(), at.modulus.tobytes())
        if key not in self._balls:
            if len(self._balls) >= _BALLS:
                self._balls.clear()
            self._balls[key] = ball_travel(self.readings, self._pressing(at), at.force_n)
        return self._balls[key]

    def _contacted(self, at: OperatingPoint, travel: np.ndarray) -> np.ndarray:
        """Elastic travel (m,) with the effects of the contact, by that without."""
        if not self._contacts:
            return travel
        pressing = self._pressing(at)
        for effect in self._contacts:
            own = at.values[effect.name]
            travel = effect.contact(self.readings, pressing, at.force_n, travel, **own)
        return travel

    def by_force(self, at: OperatingPoint) -> np.ndarray:
        """Return the derivative (m,) of each displacement by its own force, m/N.

        An effect with a memory, creep for one, passes a force on to the readings after it. Few
        readings of a press are then changed at a time, of up to 24 one alone: changed together, the
        noise expected beside creep of two times was 3 % too small, beside that of one 2 %, and the
        wrong law won. Of more readings the changes go up and down in turn, so that
        the memory of small steps in time cancels.
        """
        step = _STEP * max(float(np.abs(at.force_n).max()), 1e-12)
        layers = self.readings.layers
        changed = self._changed(at, step)
        unchanged = changed(np.zeros(len(at.force_n)))
        remembers = self._remembers(changed, unchanged, step)
        apart = min(max(_PREDICTIONS // len(layers), 2), len(layers)) if remembers else 1
        slope = np.empty(len(at.force_n))
        for first in range(apart):
            change = np.zeros(len(at.force_n))
            for turn, rows in enumerate(layers[first::apart]):
                change[rows] = step if turn % 2 == 0 else -step
            rows = change != 0
            slope[rows] = (changed(change) - unchanged)[rows] / change[rows]
        return slope

    def _changed(self, at: OperatingPoint, step_n: float) -> Callable[[np.ndarray], np.ndarray]:
        """Return the prediction by small changes (m,) of the forces.

        The elastic travel has no memory: it goes along its slope, found once for all changes.
        """
        acting_n = self._acting(at.force_n, at.values)
        here = self._from_touch(at._replace(force_n=acting_n))
        slope = self._elastic_slope(at._replace(force_n=acting_n), step_n)

        def changed(change: np.ndarray) -> np.ndarray:
            force_n = self._acting(at.force_n + change, at.values)
            return self._beyond(force_n, here + slope * (force_n - acting_n), at.values)

        return changed

    def _elastic_slope(self, acting: OperatingPoint, step_n: float) -> np.ndarray:
        """Return the derivative (m,) of the elastic travel by its own acting force, m/N."""
        bare = self._bare(acting)
        if not self._contacts:
            return bare.by_force
        up, down = (
            self._contacted(
                acting._replace(force_n=acting.force_n + step), bare.travel_m + bare.by_force * step
            )
            for step in (step_n, -step_n)
        )
        return (up - down) / (2 * step_n)

    def elastic_slope(self, at: OperatingPoint) -> np.ndarray:
        """Return the derivative (m,) of the elastic travel by each acting force, m/N."""
        step = _STEP * max(float(np.abs(at.force_n).max()), 1e-12)
        return self._elastic_slope(at._replace(force_n=self._acting(at.force_n, at.values)), step)

    @property
    def feels_others(self) -> bool:
        """A link may let a reading feel the forces of others."""
        return bool(self._responses or self._forces)

    def _remembers(
        self,
        changed: Callable[[np.ndarray], np.ndarray],
        unchanged: np.ndarray,
        step_n: float,
    ) -> bool:
        """Return whether any reading feels the force of another one."""
        if not self.feels_others or len(self.readings.layers) == 1:
            return False
        rows = np.concatenate(self.readings.layers[::2])
        change = np.zeros(len(self.readings))
        change[rows] = step_n
        return bool(np.any(np.delete(changed(change) - unchanged, rows)))

    def by_body(self, at: OperatingPoint) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives (m,) by compliance and local modulus of the reading's press."""
        press = self.readings.press
        up, down = (
            self.predict(at._replace(compliance=factor * at.compliance))
            for factor in (1 + _STEP, 1 - _STEP)
        )
        by_compliance = (up - down) / (2 * _STEP * at.compliance[press])
        if not self.nonlinear:
            return by_compliance, np.zeros_like(by_compliance)
        up, down = (
            self.predict(at._replace(modulus=factor * at.modulus))
            for factor in (1 + _STEP, 1 - _STEP)
        )
        return by_compliance, (up - down) / (2 * _STEP * at.modulus[press])

    def by_log_compliance(self, at: OperatingPoint) -> np.ndarray:
        """Return the derivative (m,) by ln C of the reading's press, in an even body: E ~ 1/C."""
        force_n = self._acting(at.force_n, at.values)
        bare, sides = self._bare(at._replace(force_n=force_n)), []
        for step in (_STEP, -_STEP):
            factor = np.exp(step)
            there = OperatingPoint(at.compliance * factor, at.modulus / factor, force_n, at.values)
            travel = self._contacted(there, bare.travel_m + step * bare.by_log_compliance)
            sides.append(self._beyond(force_n, self._since_touch(there, travel), at.values))
        return (sides[0] - sides[1]) / (2 * _STEP)

    def by_growth(self, at: OperatingPoint) -> np.ndarray:
        """Return the derivative (m,) by the growth of the reading's press, m."""
        assert self.growth is not None
        up, down = (
            replace(self, growth=self.growth + step).predict(at) for step in (_STEP, -_STEP)
        )
        return (up - down) / (2 * _STEP)
