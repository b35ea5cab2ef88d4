"""The planted effects as mechanisms of the robot's loop, each where it acts.

The bench (`sim.planted.effect`) computes an effect on finished arrays by its formula; here the same
cause is stepped through time with the arm: a body law inside the contact, a part that creeps, a
sensor that reads otherwise, a surface that moves. The force control reacts to all of them.
"""

from __future__ import annotations

from sim.planted.body_in_loop import LawOnBody, Part
from sim.planted.body_parts import BUILD, OTHER_SOLUTIONS, PARTS, Values
from sim.planted.instrument_in_loop import PlantScene, on_sensor, on_surface
from sim.planted.instrument_mechanisms import OTHERS, READINGS, SINKING
from sim.robot.mechanism import Mechanism

FIELDS = (
    "extra_inclusion", "inclusion_edge", "inclusion_stretch", "side_gradient",
    "stiffness_gradient", "poisson_ratio",
)  # fmt: skip
"""Effects that act in the pressed body's own finite elements."""

SOLVED_ANEW = (*FIELDS, *BUILD, *OTHER_SOLUTIONS)
"""Effects for which a block is solved once more: with another field, build or contact."""


def mechanism(name: str, scene: PlantScene, v: Values) -> Mechanism:
    """Return a planted effect as a mechanism of the loop.

    Parameters
    ----------
    name : of `sim.planted.catalogue.HIDDEN`
    scene : the scan in which it acts
    v : its values, by name

    Raises
    ------
    KeyError
        An effect that has no mechanism; there is none in the catalogue.
    """
    if name in FIELDS:
        return Mechanism(name)
    if name in PARTS:
        return _on_body(name, PARTS[name](scene, v))
    if name in READINGS:
        return on_sensor(name, scene, READINGS[name](scene, v))
    if name in SINKING:
        from_touch = name.endswith("_from_touch")
        return on_surface(name, scene, SINKING[name](scene, v), from_touch)
    return OTHERS[name](name, scene, v)


def _on_body(name: str, part: Part) -> Mechanism:
    return Mechanism(
        name,
        begin=lambda press, time_s: part.begin(press),
        attach=part.attach,
        body=lambda below: LawOnBody(below, part),
    )
