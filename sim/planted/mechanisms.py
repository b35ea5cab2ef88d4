"""The planted effects as mechanisms of the robot's loop, each where it acts.

The bench (`sim.planted.effect`) computes an effect on finished arrays by its formula; here the same
cause is stepped through time with the arm: a body law inside the contact, a part that creeps, a
sensor that reads otherwise, a surface that moves. The force control reacts to all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import gamma

from sim.body.true_body import HiddenBody
from sim.planted.bench import Bench
from sim.planted.body_in_loop import (
    Cooling,
    Creep,
    Law,
    LawOnBody,
    Loop,
    Part,
    Play,
    Softening,
    Sticky,
)
from sim.planted.catalogue import HIDDEN
from sim.planted.contact import sphere_travel
from sim.planted.instrument import two_tones
from sim.planted.instrument_in_loop import (
    Backlash,
    CoarseEncoder,
    GuideFriction,
    Late,
    LowPass,
    PlantScene,
    on_sensor,
    on_surface,
)
from sim.planted.response import softened_nearby
from sim.robot.mechanism import Mechanism

Values = Mapping[str, float]
TABLE = 40
"""Forces at which the travel of a sphere is solved."""


def _on_body(name: str, part: Part) -> Mechanism:
    return Mechanism(
        name,
        begin=lambda press, time_s: part.begin(press),
        body=lambda below: LawOnBody(below, part),
    )


def _law(name: str, law: Callable[[int, float, float], float]) -> Mechanism:
    return _on_body(name, Law(law))


def _finite_strain(scene: PlantScene, v: Values, press: int, force: float, u: float) -> float:
    x = u / scene.radius_m[press]
    return u * (1 + v["size"] * x * (0.076 + 0.08 * x))


def _stiffening(scene: PlantScene, v: Values, press: int, force: float, u: float) -> float:
    b = v["exponent"] / scene.radius_m[press]
    return math.copysign(math.log1p(b * abs(u)) / b, u) if b else u


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


def _factor(name: str, ratio: np.ndarray) -> Mechanism:
    """Another build of the body: its compliances by the finite elements, over those of before."""
    return _law(name, lambda press, force, u: u * float(ratio[press]))


def _built(name: str, scene: PlantScene, body: HiddenBody) -> Mechanism:
    bench = scene.bench
    return _factor(name, bench.compliance(body=body) / bench.compliance())


def _sine(v: Values) -> Callable[[float, int], float]:
    return lambda t, press: (
        v["amplitude_m"] * math.sin(2 * math.pi * v["frequency_hz"] * t + v["phase_rad"])
    )


def _pointed(v: Values) -> Callable[[float, int], float]:
    sine = _sine({**v, "amplitude_m": 1.0})
    return lambda t, press: v["amplitude_m"] * (sine(t, press) + sine(t, press) ** 3 / 2)


def _two_tones(v: Values) -> Callable[[float, int], float]:
    return lambda t, press: v["amplitude_m"] * float(two_tones(np.asarray(t), v))


def _slow_cosines(v: Values) -> Callable[[float], float]:
    turns = ((0.8, v["phase_0_rad"]), (1.5, v["phase_1_rad"]))
    return lambda t: (
        sum(
            math.cos(math.pi * turn * t / v["session_s"] + phase) - math.cos(phase)
            for turn, phase in turns
        )
        / 2
    )


def _wandering(v: Values) -> Callable[[float, float], float]:
    course = _slow_cosines(v)
    return lambda t, f: f + v["zero_n"] * course(t)


def _swaying(v: Values) -> Callable[[float, int], float]:
    course = _slow_cosines(v)
    return lambda t, press: v["zero_m"] * course(t)


COURSES: Mapping[str, Callable[[float], float]] = {
    "logarithmic": lambda t: math.log1p(20 * max(t, 0)) / math.log(21),
    "root": lambda t: math.sqrt(max(t, 0)),
    "returning": lambda t: 3 * math.e * t * math.exp(-3 * t),
}


def _creep(name: str, weights: np.ndarray, times_s: np.ndarray, **more: object) -> Mechanism:
    return _on_body(name, Creep(np.asarray(weights, float), np.asarray(times_s), **more))  # pyright: ignore[reportArgumentType]


def _power_law(v: Values) -> tuple[np.ndarray, np.ndarray]:
    a = v["exponent"]
    logs, step = np.linspace(math.log(1e-4), math.log(1e6), 60, retstep=True)
    taus = np.exp(logs)
    return v["share"] * a / gamma(1 - a) * float(step) * taus**a, taus


def _bell() -> tuple[np.ndarray, np.ndarray]:
    at = np.linspace(-2.5, 2.5, 15)
    weight = np.exp(-(at**2) / 2)
    return weight / weight.sum(), np.exp(1.2 * at)


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
    if name in BUILD:
        return _built(name, scene, HIDDEN[name].body(scene.bench.body, v))
    return _MAKE[name](scene, v)


FIELDS = (
    "extra_inclusion", "inclusion_edge", "inclusion_stretch", "side_gradient",
    "stiffness_gradient", "poisson_ratio",
)  # fmt: skip
"""Effects that act in the pressed body's own finite elements."""

BUILD = ("body_shift", "skin_layer", "anisotropy", "base_compliance", "base_sliding")
"""Effects that another mesh, law or support of the finite elements gives."""


def _upright(scene: PlantScene, v: Values) -> Mechanism:
    bench = scene.bench
    ratio = bench.compliance(upright=True) / bench.compliance()
    return _factor("rigid_tip", 1 + v["share"] * (ratio - 1))


def _coarse(scene: PlantScene, v: Values) -> Mechanism:
    bench = scene.bench
    ratio = bench.compliance(converged=False) / bench.compliance()
    return _factor("mesh_error", 1 + v["share"] * (ratio - 1))


def _inclusion_creeps(scene: PlantScene, v: Values) -> Mechanism:
    bench = scene.bench
    first, *others = bench.body.truth.inclusions
    weaker = replace(first, weight_pa=first.weight_pa / (1 + v["share"]))
    body = replace(bench.body, truth=replace(bench.body.truth, inclusions=(weaker, *others)))
    more = bench.compliance(body=body) / bench.compliance() - 1
    part = Creep(np.ones(1), np.array([v["time_constant_s"]]), lambda press, u: float(more[press]))
    return _on_body("outside_creeping_inclusion", part)


def _slipped(scene: PlantScene, v: Values) -> Mechanism:
    wrong = {int(value) for name, value in v.items() if name.startswith("press_")}
    factor = np.array([1 + v["share"] * (j in wrong) for j in range(len(scene.bench.program))])
    return _factor("outside_slipped_presses", factor)


def _cooling(scene: PlantScene, v: Values) -> Mechanism:
    part = Cooling(
        lambda t: 1 - v["share"] * math.sin(math.pi * t / v["session_s"]) ** 2, scene.start_s
    )
    return replace(_on_body("outside_cooling", part), attach=part.attach)


def _saw_tooth(scene: PlantScene, v: Values) -> Mechanism:
    height, step = v["height_m"], v["step_m"]
    return _law("outside_stick_slip", lambda press, f, u: u - height * ((u / step) % 1.0))


def _tilt(scene: PlantScene, v: Values) -> Mechanism:
    towards = np.array([math.cos(v["angle_rad"]), math.sin(v["angle_rad"])])
    centred = scene.bench.points_m - np.array(scene.bench.body.size_m[:2]) / 2
    sinks = v["slope"] * (centred @ towards)
    return on_surface("surface_tilt", scene, lambda t, press: float(sinks[press]))


def _late(scene: PlantScene, v: Values) -> Mechanism:
    late = Late(abs(v["lag_s"]))
    if v["lag_s"] >= 0:
        return on_sensor("time_lag", scene, late.read, "press")
    # Force that comes early is travel that comes late
    return Mechanism("time_lag", encoders=late.read, servo_by_motors=True)


def _warm_up(v: Values) -> Callable[[float, float], float]:
    return lambda t, f: f - v["zero_n"] * math.expm1(-max(t, 0.0) / v["time_constant_s"])


def _softens(v: Values) -> Callable[[int], float]:
    return lambda k: v["share"] * (1 - (1 - 1 / v["presses"]) ** k)


def _levelled(scene: PlantScene) -> Callable[[int, float], float]:
    return lambda press, u: 1 / (1 + 0.5 * u / max(scene.deepest_m(press), 1e-12))


def _offset(scene: PlantScene, v: Values) -> Mechanism:
    return Mechanism("contact_offset", zero_shift_m=v["offset_m"])


def _bias(scene: PlantScene, v: Values) -> Mechanism:
    return on_sensor("force_bias", scene, lambda t, f: f + v["bias_n"], "never")


def _guide(name: str, turn_share: float, scene: PlantScene, v: Values) -> Mechanism:
    made = GuideFriction(scene, v["friction_n"], turn_share)
    return Mechanism(name, begin=made.begin, attach=made.attach, sensor=made.sensor)


def _force_jump(scene: PlantScene, v: Values) -> Mechanism:
    after = False

    def begin(press: int, time_s: float) -> None:
        nonlocal after
        after = scene.presses_before + press >= v["press"]

    read = on_sensor("force_jump", scene, lambda t, f: f + v["zero_n"] * after)
    return replace(read, begin=begin)


def _backlash(scene: PlantScene, v: Values) -> Mechanism:
    made = Backlash(v["way_m"])
    return Mechanism(
        "backlash", begin=made.begin, attach=made.attach, encoders=made.encoders,
        servo_by_motors=True,
    )  # fmt: skip


def _local_creep(scene: PlantScene, v: Values) -> Mechanism:
    away = np.sum((scene.bench.points_m - (v["x_m"], v["y_m"])) ** 2, axis=1)
    near = np.exp(-away / (2 * v["radius_m"] ** 2))
    part = Creep(
        np.array([v["share"]]), np.array([v["time_constant_s"]]), lambda j, u: float(near[j])
    )
    return _on_body("local_creep", part)


def _softens_nearby(scene: PlantScene, v: Values) -> Mechanism:
    grown = softened_nearby(scene.bench.points_m, v)
    return _on_body("preconditioning_nearby", Softening(lambda k: float(grown[k]), 0))


def _worn_encoder(scene: PlantScene, v: Values) -> Mechanism:
    made = CoarseEncoder(v["step_m"])
    return Mechanism(
        "outside_coarse_encoder",
        attach=made.attach,
        encoders=made.encoders,
        servo_by_motors=True,
    )


def _knee(v: Values) -> Callable[[float, float], float]:
    knee = v["knee_per_n"]
    return lambda t, f: math.tanh(knee * f) / knee if knee else f


_Make = Callable[[PlantScene, Values], Mechanism]

_MAKE: dict[str, _Make] = {
    # contact
    "rigid_tip": _upright,
    "mesh_error": _coarse,
    "finite_strain": lambda s, v: _law("finite_strain", partial(_finite_strain, s, v)),
    "strain_stiffening": lambda s, v: _law("strain_stiffening", partial(_stiffening, s, v)),
    "spherical_tip": lambda s, v: _law("spherical_tip", _sphere(s, v)),
    "tool_compliance": lambda s, v: _law(
        "tool_compliance", lambda press, f, u: u + v["compliance_m_per_n"] * f
    ),
    "outside_slipped_presses": _slipped,
    "outside_stick_slip": _saw_tooth,
    "outside_cooling": _cooling,
    # history
    "viscoelasticity": lambda s, v: _creep(
        "viscoelasticity", np.array([v["share"]]), np.array([v["time_constant_s"]])
    ),
    "two_time_creep": lambda s, v: _creep(
        "two_time_creep", np.full(2, v["share"] / 2), v["time_constant_s"] * np.array([1.0, 30.0])
    ),
    "power_law_creep": lambda s, v: _creep("power_law_creep", *_power_law(v)),
    "form_three_time_creep": lambda s, v: _creep(
        "form_three_time_creep", np.full(3, v["share"] / 3), np.array([0.1, 0.6, 3.6])
    ),
    "form_broad_creep": lambda s, v: _creep(
        "form_broad_creep", v["share"] * _bell()[0], _bell()[1]
    ),
    "form_levelling_creep": lambda s, v: _creep(
        "form_levelling_creep", np.array([v["share"]]), np.array([0.8]), level=_levelled(s)
    ),
    "outside_creeping_inclusion": _inclusion_creeps,
    "local_creep": _local_creep,
    "free_loop": lambda s, v: _on_body(
        "free_loop", Loop(lambda x: v["share"] * x**2 * (1 - x) * 27 / 4)
    ),
    "play": lambda s, v: _on_body(
        "play", Play(v["share"], lambda press: v["width"] * np.array([s.deepest_m(press)]))
    ),
    "several_plays": lambda s, v: _on_body(
        "several_plays",
        Play(v["share"], lambda press: s.deepest_m(press) * np.array([0.02, 0.06, 0.15, 0.4])),
    ),
    "form_several_plays": lambda s, v: _on_body(
        "form_several_plays",
        Play(v["share"], lambda press: s.deepest_m(press) * np.array([0.03, 0.08, 0.2])),
    ),
    "hysteresis": lambda s, v: _on_body("hysteresis", Loop(lambda x: 4 * v["share"] * x * (1 - x))),
    "form_fat_loop": lambda s, v: _on_body(
        "form_fat_loop", Loop(lambda x: v["share"] * x * math.sqrt(1 - x))
    ),
    "preconditioning": lambda s, v: _on_body(
        "preconditioning", Softening(_softens(v), s.presses_before)
    ),
    "preconditioning_nearby": _softens_nearby,
    "form_slow_preconditioning": lambda s, v: _on_body(
        "form_slow_preconditioning",
        Softening(lambda k: v["share"] * (1 - 1 / math.sqrt(1 + k / 4)), s.presses_before),
    ),
    "outside_sticky_tip": lambda s, v: _on_body(
        "outside_sticky_tip",
        Sticky(v["pull_n"], lambda press: float(s.bench.program.force_n[press]) / 5),
    ),
    # sensor
    "force_bias": _bias,
    "force_drift": lambda s, v: on_sensor("force_drift", s, lambda t, f: f + v["rate_n_per_s"] * t),
    "force_warm_up": lambda s, v: on_sensor("force_warm_up", s, _warm_up(v)),
    "force_wander": lambda s, v: on_sensor("force_wander", s, _wandering(v)),
    "sensitivity_drift": lambda s, v: on_sensor(
        "sensitivity_drift", s, lambda t, f: f * (1 + v["rate_per_s"] * t)
    ),
    "force_saturation": lambda s, v: on_sensor("force_saturation", s, _knee(v)),
    "time_lag": _late,
    "form_filtered_force": lambda s, v: on_sensor(
        "form_filtered_force", s, LowPass(v["delay_s"]).read, "press"
    ),
    "form_guide_friction": partial(_guide, "form_guide_friction", 0.03),
    "guide_friction": partial(_guide, "guide_friction", 0.005),
    "force_jump": _force_jump,
    # place
    "contact_offset": _offset,
    "surface_tilt": _tilt,
    "displacement_drift": lambda s, v: on_surface(
        "displacement_drift", s, lambda t, press: v["rate_m_per_s"] * t
    ),
    "displacement_wander": lambda s, v: on_surface("displacement_wander", s, _swaying(v)),
    "breathing": lambda s, v: on_surface("breathing", s, _sine(v)),
    "breathing_from_touch": lambda s, v: on_surface(
        "breathing_from_touch", s, _sine(v), from_touch=True
    ),
    "breathing_harmonics": lambda s, v: on_surface("breathing_harmonics", s, _two_tones(v)),
    "breathing_harmonics_from_touch": lambda s, v: on_surface(
        "breathing_harmonics_from_touch", s, _two_tones(v), from_touch=True
    ),
    "form_pointed_breathing": lambda s, v: on_surface("form_pointed_breathing", s, _pointed(v)),
    "outside_coarse_encoder": _worn_encoder,
    "backlash": _backlash,
    "displacement_jump": lambda s, v: on_surface(
        "displacement_jump",
        s,
        lambda t, press: v["height_m"] * (s.presses_before + press >= v["press"]),
    ),
}

for _name, _course in COURSES.items():
    _MAKE[f"form_{_name}_force_drift"] = lambda s, v, c=_course, n=_name: on_sensor(
        f"form_{n}_force_drift", s, lambda t, f: f + v["zero_n"] * c(t / v["session_s"])
    )
    _MAKE[f"form_{_name}_displacement_drift"] = lambda s, v, c=_course, n=_name: on_surface(
        f"form_{n}_displacement_drift", s, lambda t, press: v["zero_m"] * c(t / v["session_s"])
    )
