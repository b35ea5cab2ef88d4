"""Hidden effects: the link of the bench on which each acts, and its possible size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from sim.body.true_body import HiddenBody
from sim.planted.bench import Bench

Category = Literal["structured", "compliance", "form", "outsider"]
"""Difficulty of an effect: `structured` ones leave a pattern in time, force or place of their
own, those of `compliance` look like another body, a `form` is a cause of the catalogue by another
law than any there, and outsiders are in no catalogue."""

Values = Mapping[str, float]
Draw = Callable[[Bench, np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class HiddenEffect:
    """An effect to be hidden in a scan; it acts on one of the bench's links and leaves the others.

    Attributes
    ----------
    name : as in the identifier's catalogue; of an outsider, a name of its own
    category : see `Category`
    law : formula, in one line
    amplitude : name of the value that is searched for the wanted size; the effect is absent at 0
    typical : an ordinary amplitude, where the search begins
    limit : largest sensible amplitude
    two_sided : true if the amplitude may be negative too
    kin : of an outsider, the nearest effects of the catalogue; of a form, its family
    draw : all values but the amplitude, for a bench and a random generator
    body : the changed body, from the body and the values
    contact : elastic travel (j, t) m, from the bench, that of the flat tip on the linear body and
        the values
    response : travel (j, t) m with its history, from the bench, the elastic travel and the values
    sensor : reported force and travel, both (j, t), from the bench, the true ones and the values
    """

    name: str
    category: Category
    law: str
    amplitude: str
    typical: float
    limit: float = np.inf
    two_sided: bool = False
    kin: tuple[str, ...] = ()
    draw: Draw = lambda bench, rng: {}
    body: Callable[[HiddenBody, Values], HiddenBody] = lambda body, values: body
    contact: Callable[[Bench, np.ndarray, Values], np.ndarray] = lambda bench, travel_m, v: travel_m
    response: Callable[[Bench, np.ndarray, Values], np.ndarray] = lambda bench, travel_m, v: (
        travel_m
    )
    sensor: Callable[[Bench, np.ndarray, np.ndarray, Values], tuple[np.ndarray, np.ndarray]] = (
        lambda bench, force_n, travel_m, v: (force_n, travel_m)
    )


def _acts_on(
    link: str, category: Category, law: str, amplitude: str, typical: float, **more: Any
) -> Callable[[Callable], HiddenEffect]:
    """Make the decorated function the effect of its name; arguments as in `HiddenEffect`."""

    def effect(act: Callable) -> HiddenEffect:
        more[link] = act
        return HiddenEffect(act.__name__, category, law, amplitude, typical, **more)

    return effect


on_body = partial(_acts_on, "body")
on_contact = partial(_acts_on, "contact")
on_response = partial(_acts_on, "response")
on_sensor = partial(_acts_on, "sensor")


def any_direction(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw a horizontal direction that points somewhere."""
    return {"angle_rad": float(rng.uniform(0, 2 * np.pi))}


def any_axis(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw a horizontal line without a sense."""
    return {"angle_rad": float(rng.uniform(0, np.pi))}
