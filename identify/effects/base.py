"""The base of effects: self-describing pieces of physics beyond the linear model.

The measurement chain of a reading, from the body to the robot's table:

    force    F = force(F_read)                acting force from the sensor's reading  (instrument)
    body     C = compliance of the body under a contact of given pressure             (body)
    contact  u = contact(C F)                 elastic travel of the tip               (contact)
    response u = response(u)                  travel with the history of loading      (response)
    reading  d = reading(u)                   travel as the robot reports it          (instrument)

Travel is counted from first touch; an effect of the instrument may give another force as the start
of the count, `touch`: u is then contact(C F) less contact(C touch).

An effect is an `Effect` with one hook, a method named after its step of the chain; the link follows
from the hook. The hook takes its parameters by name, as keyword arguments (protocols `BodyEffect`
to `TouchEffect`):

    def response(self, readings, force_n, travel_m, *, g, tau_s): ...

With all amplitudes at their null value an effect is the identity, to rounding; the conformance kit
(`identify.effects.conformance.kit`) checks this contract for built-in effects and for users' own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, TypeGuard

import numpy as np

from identify.body.state import BodyState
from identify.effects.readings import Readings
from identify.map.parameters import Parameter
from models import kinds_checked

Link = Literal["body", "contact", "response", "instrument"]
# Requirements of an effect on a scan, in the words of the sentence about a lack.
Need = Literal["time", "unloading", "hold", "several forces", "several presses"]
Values = Mapping[str, float]
Hook = Literal["force", "body", "contact", "response", "reading", "touch"]
LINKS: Mapping[Hook, Link] = {
    "body": "body",
    "contact": "contact",
    "response": "response",
    "force": "instrument",
    "reading": "instrument",
    "touch": "instrument",
}
COUNTED_FROM = {"touch": "each press's own touch", "plane": "the planned surface"}
EffectParameter = Parameter  # under the name that authors of effects import
Given = float | str | tuple[float, ...] | tuple[str, ...] | tuple[tuple[float, ...], ...]


@kinds_checked
@dataclass(frozen=True)
class WorkedExample:
    """An effect at work on numbers that can be followed by hand; `worked_example.work` does it.

    Attributes
    ----------
    says : the calculation in words
    values : of all parameters
    given : input of the hook, by name (`travel_m`, `time_s`, `phase`, ...). A single number
        stands for all readings
    expected : output, by name; checked to a relative 1e-4

    Examples
    --------
    >>> import palpmap as pm
    >>> example = pm.CATALOGUE["contact_offset"].examples[0]
    >>> sorted(example.values)
    ['offset_m']
    """

    says: str
    values: Values
    given: Mapping[str, Given]
    expected: Mapping[str, float | tuple[float, ...]]


@dataclass(frozen=True)
class Pressing:
    """The body under each reading's tip, as a contact effect sees it; all (m,).

    `compliance_m_per_n` C of the body under the model's contact, `modulus_pa` the local Young's
    modulus under the tip, `radius_m` the contact radius of the model. Under a ball,
    `curvature_per_m` is that of the body's surface, convex positive, and `growth` (a/C) dC/da by
    the contact radius; None is a body that is a half-space near the tip.
    """

    compliance_m_per_n: np.ndarray
    modulus_pa: np.ndarray
    radius_m: np.ndarray
    poisson_ratio: float
    profile: Literal["flat", "hertz"]
    curvature_per_m: np.ndarray | float = 0.0
    growth: np.ndarray | None = None


class Effect:
    """Base of all effects: its description. A derived class adds the one hook.

    Class attributes
    ----------------
    name, title : `force_drift`, "Drift of the force sensor"
    family : name of the simplest effect of the same cause, of which this one is another form (a
        drift that settles, creep with two times); its own name without one
    hooks, link : its hook, and with it the link of the chain; both follow from the methods
    order : place among the effects of its link, a smaller one acts first; a user's own act last
    summary : the physics, two sentences for an experimenter
    formula, latex : the same equation in plain text for the terminal, and in LaTeX for documents
    source : paper, book or derivation
    gives_away : its sign in the data, one sentence
    cure : remedy or separation in the experiment, one sentence
    parameters : amplitudes (with a null) first, then shape parameters (null None)
    needs : requirements on the scan
    counted_from : "touch" or "plane" for an effect that shows only in travel counted from each
        press's own touch, or only from the planned surface; empty for both
    contains : names of effects that are special cases of this one
    any_shape : its law is any smooth curve within a press; beside the course of an unknown cause it
        may be another part of that, and is not offered by name
    examples : at least one, away from the null

    Examples
    --------
    >>> import palpmap as pm
    >>> effect = pm.CATALOGUE["contact_offset"]
    >>> effect.title, [p.name for p in effect.parameters]
    ('Offset of first touch', ['offset_m'])
    """

    name: ClassVar[str]
    family: ClassVar[str]
    title: ClassVar[str]
    hooks: ClassVar[tuple[Hook, ...]] = ()
    link: ClassVar[Link]
    order: ClassVar[int] = 1000
    summary: ClassVar[str]
    formula: ClassVar[str]
    latex: ClassVar[str] = ""
    source: ClassVar[str]
    gives_away: ClassVar[str]
    cure: ClassVar[str]
    parameters: ClassVar[tuple[EffectParameter, ...]]
    needs: ClassVar[tuple[Need, ...]] = ()
    counted_from: ClassVar[Literal["", "touch", "plane"]] = ""
    contains: ClassVar[tuple[str, ...]] = ()
    any_shape: ClassVar[bool] = False
    examples: ClassVar[tuple[WorkedExample, ...]] = ()

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        if "name" in vars(cls) and "family" not in vars(cls):
            cls.family = cls.name
        cls.hooks = tuple(hook for hook in LINKS if callable(getattr(cls, hook, None)))
        if cls.hooks:
            cls.link = LINKS[cls.hooks[0]]

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        if isinstance(found, type) and issubclass(found, cls):
            return f"an instance of the class, {found.__name__}()"
        if str(found).endswith(".py"):
            return f"an instance of its class, or type `palpmap check-effect {found}`"
        return "pm.CATALOGUE['force_drift'], or MyEffect() of a class of your own"

    # ---- shape parameters ----------------------------------------------------------------

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Candidates of the shape parameters for this scan, one empty mapping if there are none.

        Fine enough that neighbouring candidates give almost the same pattern (cosine 0.9 and up).
        """
        return [{}]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Return the parameters with bounds and typical sizes for this scan and body."""
        return self.parameters

    # ---- words ---------------------------------------------------------------------------

    def evidence(self, values: Values, readings: Readings) -> str:
        """Return the evidence in the data, one sentence with the estimates, for a reader."""
        sizes = ", ".join(f"{p.name} {values[p.name]:.3g} {p.unit}" for p in self.parameters)
        return f"{self.gives_away.rstrip('.')} ({sizes})."

    def untestable(self, readings: Readings) -> str | None:
        """Return the reason why this scan cannot show the effect, or None.

        From `needs` and `counted_from`.
        """
        if self.counted_from and readings.travel_from not in ("", self.counted_from):
            return f"travel counts from {COUNTED_FROM[readings.travel_from]}"
        return readings.lacks(self.needs)

    # ---- conveniences --------------------------------------------------------------------

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The parameters that have a null value."""
        return tuple(p for p in self.parameters if p.null is not None)

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """The parameters without meaning at the null."""
        return tuple(p for p in self.parameters if p.null is None)

    @property
    def one_sided(self) -> bool:
        """Whether the effect has a single amplitude that can only be on one side of its null."""
        first, *others = self.amplitudes
        return not others and first.null in (first.lower, first.upper)

    @property
    def null(self) -> dict[str, float]:
        """Values of the amplitudes at which the effect is absent."""
        return {p.name: p.null for p in self.amplitudes if p.null is not None}


class Advice:
    """Optional advice to the model selection: `class MyEffect(Advice, Effect)`.

    Class attributes
    ----------------
    refitted_from : values from which the effect is refitted whatever its score; for an effect
        without which the map may end so far off that the score there is meaningless, else empty

    Examples
    --------
    >>> import palpmap as pm
    >>> [effect.name for effect in pm.CATALOGUE if isinstance(effect, pm.Advice)][:2]
    ['inclusion_edge', 'skin_layer']
    """

    refitted_from: ClassVar[Values] = {}

    def levels(self, state: BodyState) -> tuple[float, ...]:
        """Amplitudes at which the pattern of a body effect differs from that at its null.

        The scores look for these patterns too; each costs a solution of the body for each candidate
        of the shape. An effect with levels has one amplitude.
        """
        return ()

    def columns(self, readings: Readings, shapes: Sequence[Values]) -> np.ndarray | None:
        """Return derivatives (g, m, q) of the displacement by q amplitudes at g shapes, or None.

        For an effect of the measured travel that adds to it whatever forces and travel are, and
        whose grid has thousands of shapes: they come at once.
        """
        return None

    def around(self, shape: Values, readings: Readings) -> Sequence[Values]:
        """Return shapes beyond the grid, to be scored around the best one if that is certain."""
        return ()

    def redundant(self, profile: str, nonlinear: bool) -> str | None:
        """Return the reason why the effect adds nothing to a model, or None.

        Parameters
        ----------
        profile : "flat" or "hertz" (a ball), the tip in the study
        nonlinear : travel and force are not proportional within a press
        """
        return None

    def doubt(self, values: Values, readings: Readings) -> str | None:
        """Return the reason why estimates are implausible, or None."""
        return None


_NO_ADVICE = Advice()


def advice(effect: Effect) -> Advice:
    """Return the effect's advice to the model selection, the default one if it gives none."""
    return effect if isinstance(effect, Advice) else _NO_ADVICE


def changes_body(effect: object) -> "TypeGuard[Any]":
    """Return True for an effect whose hook is that of the body: it is a `BodyEffect`."""
    return "body" in getattr(effect, "hooks", ())


# ---- hooks; an effect has one of them --------------------------------------------------------


class ForceEffect(Protocol):
    """Instrument: the reading of the force sensor."""

    def force(self, readings: Readings, force_n: np.ndarray, **parameters: float) -> np.ndarray:
        """Acting force (m,) from the force (m,) of the sensor."""
        ...


class BodyEffect(Protocol):
    """Body: its stiffness, shape and support."""

    def body(self, state: BodyState, **parameters: float) -> BodyState:
        """Return the changed body."""
        ...


class ContactEffect(Protocol):
    """Contact: the tip against the surface."""

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        **parameters: float,
    ) -> np.ndarray:
        """Elastic travel (m,) of the tip from that of the model's fixed contact, C F."""
        ...


class ResponseEffect(Protocol):
    """Response: the history of loading."""

    def response(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, **parameters: float
    ) -> np.ndarray:
        """Travel (m,) with the history of loading, from the elastic one."""
        ...


class ReadingEffect(Protocol):
    """Instrument: the travel as the robot reports it."""

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, **parameters: float
    ) -> np.ndarray:
        """Displacement (m,) reported by the robot for a travel of the tip."""
        ...


class TouchEffect(Protocol):
    """Instrument: the start of the travel's count."""

    def touch(self, readings: Readings, **parameters: float) -> float:
        """Force, N, from which on the robot counts the travel."""
        ...
