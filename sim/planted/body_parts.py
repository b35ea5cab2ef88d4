"""The planted effects of contact and body as parts of the body's law in the loop.

A travel by another law, a part that creeps, a body built otherwise, whose compliances by the finite
elements stand over those of the body as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import gamma

from sim.planted.bench import Bench
from sim.planted.body_in_loop import (
    Cooling,
    Creep,
    Law,
    Loop,
    Part,
    Play,
    RecoveringCreep,
    Softening,
    Sticky,
)
from sim.planted.catalogue import HIDDEN
from sim.planted.contact import STIFFENED, levelling, sphere_travel
from sim.planted.foreign_forms import of_locking, of_square, of_toe, rising
from sim.planted.instrument_in_loop import PlantScene
from sim.planted.jumps import on_side
from sim.planted.response import half_space_nearness, hyperbola, softened_nearby

Values = Mapping[str, float]
TABLE = 40
"""Forces at which the travel of a sphere is solved."""

BUILD = ("body_shift", "skin_layer", "anisotropy", "base_compliance", "base_sliding")
"""Effects that another mesh, law or support of the finite elements gives."""

OTHER_SOLUTIONS = ("rigid_tip", "mesh_error", "spherical_tip", "outside_creeping_inclusion")
"""Effects whose law needs the body's compliances under another contact, mesh or map."""


def _finite_strain(scene: PlantScene, v: Values, press: int, force: float, u: float) -> float:
    x = u / scene.radius_m[press]
    return u * (1 + v["size"] * x * (0.076 + 0.08 * x))


def _stiffening(scene: PlantScene, v: Values, press: int, force: float, u: float) -> float:
    b = v["exponent"] / scene.radius_m[press]
    return math.copysign(math.log1p(b * abs(u)) / b, u) if b else u


def _bent(law: Callable[[Any, float], Any], name: str, scene: PlantScene, v: Values) -> Law:
    """Law of a depth over the tip's radius, odd in it."""

    def depth(press: int, force: float, u: float) -> float:
        tip = scene.radius_m[press]
        return tip * math.copysign(float(law(abs(u) / tip, v[name])), u)

    return Law(depth)


def _sphere(scene: PlantScene, v: Values) -> Callable[[int, float, float], float]:
    bench = scene.bench
    most = 1.3 * bench.program.force_n
    share = np.linspace(0, 1, TABLE) ** 1.5  # travel ~ F^(2/3)
    ramp = _Forces(bench, most[:, None] * share)
    travel = sphere_travel(ramp)  # pyright: ignore[reportArgumentType]

    def law(press: int, force: float, u: float) -> float:
        if force <= 0:
            return (1 - v["share"]) * u
        x = np.interp(force ** (2 / 3), (most[press] * share) ** (2 / 3), travel[press])
        return (1 - v["share"]) * u + v["share"] * float(x)

    return law


@dataclass(frozen=True)
class _Forces:
    """A bench at other forces, for laws that solve force by force."""

    bench: Bench
    force_n: np.ndarray

    def __getattr__(self, name: str) -> object:
        return getattr(self.bench, name)


def _factor(ratio: np.ndarray) -> Law:
    """Another build of the body: its compliances by the finite elements, over those of before."""
    return Law(lambda press, force, u: u * float(ratio[press]))


def _built(name: str, scene: PlantScene, v: Values) -> Law:
    bench = scene.bench
    body = HIDDEN[name].body(bench.body, v)
    return _factor(bench.compliance(body=body) / bench.compliance())


def _creep(
    weights: Sequence[float] | np.ndarray,
    times_s: Sequence[float] | np.ndarray,
    *level: Callable[[int, float], float],
) -> Creep:
    return Creep(np.asarray(weights, float), np.asarray(times_s, float), *level)


def _power_law(v: Values) -> tuple[np.ndarray, np.ndarray]:
    a = v["exponent"]
    logs, step = np.linspace(math.log(1e-4), math.log(1e6), 60, retstep=True)
    taus = np.exp(logs)
    return v["share"] * a / gamma(1 - a) * float(step) * taus**a, taus


def _bell() -> tuple[np.ndarray, np.ndarray]:
    at = np.linspace(-2.5, 2.5, 15)
    weight = np.exp(-(at**2) / 2)
    return weight / weight.sum(), np.exp(1.2 * at)


def _upright(scene: PlantScene, v: Values) -> Part:
    bench = scene.bench
    ratio = bench.compliance(upright=True) / bench.compliance()
    return _factor(1 + v["share"] * (ratio - 1))


def _coarse(scene: PlantScene, v: Values) -> Part:
    bench = scene.bench
    ratio = bench.compliance(converged=False) / bench.compliance()
    return _factor(1 + v["share"] * (ratio - 1))


def _inclusion_creeps(scene: PlantScene, v: Values) -> Part:
    bench = scene.bench
    first, *others = bench.body.truth.inclusions
    weaker = replace(first, weight_pa=first.weight_pa / (1 + v["share"]))
    body = replace(bench.body, truth=replace(bench.body.truth, inclusions=(weaker, *others)))
    more = bench.compliance(body=body) / bench.compliance() - 1
    return _creep([1.0], [v["time_constant_s"]], lambda press, u: float(more[press]))


def _slipped(scene: PlantScene, v: Values) -> Part:
    wrong = {int(value) for name, value in v.items() if name.startswith("press_")}
    factor = np.array([1 + v["share"] * (j in wrong) for j in range(len(scene.bench.program))])
    return _factor(factor)


def _cooling(scene: PlantScene, v: Values) -> Part:
    return Cooling(
        lambda t: 1 - v["share"] * math.sin(math.pi * t / v["session_s"]) ** 2, scene.start_s
    )


def _saw_tooth(scene: PlantScene, v: Values) -> Part:
    height, step = v["height_m"], v["step_m"]
    return Law(lambda press, f, u: u - height * ((u / step) % 1.0))


def _softens(v: Values) -> Callable[[int], float]:
    return lambda k: v["share"] * (1 - (1 - 1 / v["presses"]) ** k)


def _levelled(scene: PlantScene) -> Callable[[int, float], float]:
    return lambda press, u: 1 / (1 + 0.5 * u / max(scene.deepest_m(press), 1e-12))


def _local_creep(scene: PlantScene, v: Values) -> Part:
    away = np.sum((scene.bench.points_m - (v["x_m"], v["y_m"])) ** 2, axis=1)
    near = np.exp(-away / (2 * v["radius_m"] ** 2))
    return _creep_by(near, v["share"], v["time_constant_s"])


def _creep_by(place: np.ndarray, share: float, tau_s: float) -> Part:
    """Return creep whose share differs from press to press, (j,)."""
    return _creep([share], [tau_s], lambda press, u: float(place[press]))


def _recovers(scene: PlantScene, v: Values) -> Part:
    nearness = half_space_nearness(scene.bench.points_m, v["reach_m"])
    return RecoveringCreep(np.array([v["share"]]), np.array([v["time_constant_s"]]), nearness)


def _fades(scene: PlantScene, v: Values) -> Part:
    points = scene.bench.points_m
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    return RecoveringCreep(np.full(2, v["share"] / 2), np.array([0.5, 6.0]), np.exp(-away / 0.012))


def _softens_nearby(scene: PlantScene, v: Values) -> Part:
    grown = softened_nearby(scene.bench.points_m, v)
    return Softening(lambda k: float(grown[k]), 0)


PARTS: Mapping[str, Callable[[PlantScene, Values], Part]] = {
    **{name: partial(_built, name) for name in BUILD},
    # contact
    "rigid_tip": _upright,
    "mesh_error": _coarse,
    "finite_strain": lambda s, v: Law(partial(_finite_strain, s, v)),
    "strain_stiffening": lambda s, v: Law(partial(_stiffening, s, v)),
    "free_stiffening": partial(_bent, partial(levelling, knee=STIFFENED), "share"),
    "form_toe_stiffening": partial(_bent, of_toe, "toe"),
    "form_locking_stiffening": partial(_bent, of_locking, "locking"),
    "form_square_stiffening": partial(_bent, of_square, "square"),
    "spherical_tip": lambda s, v: Law(_sphere(s, v)),
    "tool_compliance": lambda s, v: Law(lambda press, f, u: u + v["compliance_m_per_n"] * f),
    "outside_slipped_presses": _slipped,
    "outside_stick_slip": _saw_tooth,
    "form_cooling": _cooling,
    # history
    "viscoelasticity": lambda s, v: _creep([v["share"]], [v["time_constant_s"]]),
    "two_time_creep": lambda s, v: _creep(
        np.full(2, v["share"] / 2), v["time_constant_s"] * np.array([1.0, 30.0])
    ),
    "power_law_creep": lambda s, v: _creep(*_power_law(v)),
    "form_three_time_creep": lambda s, v: _creep(np.full(3, v["share"] / 3), [0.1, 0.6, 3.6]),
    "form_broad_creep": lambda s, v: _creep(v["share"] * _bell()[0], _bell()[1]),
    "form_levelling_creep": lambda s, v: _creep([v["share"]], [0.8], _levelled(s)),
    "form_recovering_creep": _fades,
    "form_creep_on_one_side": lambda s, v: _creep_by(rising(s.bench, v), v["share"], 0.8),
    "creep_recovery": _recovers,
    "outside_creeping_inclusion": _inclusion_creeps,
    "local_creep": _local_creep,
    "side_creep": lambda s, v: _creep_by(on_side(s.bench, v), v["share"], v["time_constant_s"]),
    "free_loop": lambda s, v: Loop(lambda x: v["share"] * x**2 * (1 - x) * 27 / 4),
    "play": lambda s, v: Play(
        v["share"], lambda press: v["width"] * np.array([s.deepest_m(press)])
    ),
    "several_plays": lambda s, v: Play(
        v["share"], lambda press: s.deepest_m(press) * np.array([0.02, 0.06, 0.15, 0.4])
    ),
    "form_several_plays": lambda s, v: Play(
        v["share"], lambda press: s.deepest_m(press) * np.array([0.03, 0.08, 0.2])
    ),
    "hysteresis": lambda s, v: Loop(lambda x: 4 * v["share"] * x * (1 - x)),
    "form_fat_loop": lambda s, v: Loop(lambda x: v["share"] * x * math.sqrt(1 - x)),
    "form_late_loop": lambda s, v: Loop(lambda x: v["share"] * x * (1 - x) ** 2),
    "preconditioning": lambda s, v: Softening(_softens(v), s.presses_before),
    "preconditioning_nearby": _softens_nearby,
    "free_preconditioning": lambda s, v: Softening(
        lambda k: v["share"] * hyperbola(k), s.presses_before
    ),
    "form_slow_preconditioning": lambda s, v: Softening(
        lambda k: v["share"] * (1 - 1 / math.sqrt(1 + k / 4)), s.presses_before
    ),
    "form_ending_preconditioning": lambda s, v: Softening(
        lambda k: v["share"] * min(k / 12, 1), s.presses_before
    ),
    "form_two_rate_preconditioning": lambda s, v: Softening(
        lambda k: v["share"] * (1 - (math.exp(-k / 3) + math.exp(-k / 20)) / 2), s.presses_before
    ),
    "outside_sticky_tip": lambda s, v: Sticky(
        v["pull_n"], lambda press: float(s.bench.program.force_n[press]) / 5
    ),
}
