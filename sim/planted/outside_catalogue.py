"""Hidden effects that no catalogue has: the right answer is that something else is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import Draw, on_contact, on_response, on_sensor
from sim.planted.response import follow


def _uniform(name: str, low: float, high: float) -> Draw:
    """Return a draw of one value."""
    return lambda bench, rng: {name: float(rng.uniform(low, high))}


@on_response("form", "C(t) between the map's compliance and that with weight/(1 + share)",
             "share", 0.5, limit=100.0, kin=("local_creep",),
             draw=_uniform("time_constant_s", 0.4, 1.2))  # fmt: skip
def outside_creeping_inclusion(bench, travel_m, values):
    """Only the inclusion creeps; the rest of the body is elastic."""
    truth = bench.body.truth
    first, *others = truth.inclusions
    weaker = replace(first, weight_pa=first.weight_pa / (1 + values["share"]))
    body = replace(bench.body, truth=replace(truth, inclusions=(weaker, *others)))
    more = bench.compliance(body=body) / bench.compliance() - 1
    delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
    return travel_m + more[:, None] * delayed


def _four_presses(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    count = min(4, len(bench.program))
    chosen = rng.choice(len(bench.program), count, replace=False)
    return {f"press_{i}": float(press) for i, press in enumerate(sorted(chosen))}


@on_contact("outsider", "u (1 + share) in four presses", "share", 0.15, limit=2.0,
            draw=_four_presses)  # fmt: skip
def outside_slipped_presses(bench, travel_m, values):
    """Four presses went wrong: they slipped, and travel further at the same force."""
    slipped = [int(value) for name, value in values.items() if name.startswith("press_")]
    factor = np.ones((len(travel_m), 1))
    factor[slipped] += values["share"]
    return travel_m * factor


@on_sensor("outsider", "travel - h frac(travel/step)", "height_m", 2e-4, limit=2e-3,
           draw=_uniform("step_m", 5e-4, 1e-3))  # fmt: skip
def outside_stick_slip(bench, force_n, travel_m, values):
    """The tip sticks and jumps on: a saw tooth over the travel."""
    return force_n, travel_m - values["height_m"] * np.mod(travel_m / values["step_m"], 1)


@on_sensor("outsider", "step round(travel/step)", "step_m", 2e-4, limit=3e-3)
def outside_coarse_encoder(bench, force_n, travel_m, values):
    """Travel is counted in whole steps of a worn encoder."""
    step = values["step_m"]
    return force_n, (step * np.round(travel_m / step) if step else travel_m)


@on_sensor("outsider", "force - pull exp(-F/F_s) while unloading, F_s a fifth of the peak",
           "pull_n", 0.02, limit=0.5)  # fmt: skip
def outside_sticky_tip(bench, force_n, travel_m, values):
    """The wet surface clings: on unloading the tip is pulled back before it comes free."""
    unloading = bench.part == 2
    scale = bench.program.force_n[:, None] / 5
    pull = values["pull_n"] * np.exp(-np.maximum(force_n, 0) / scale) * unloading
    return force_n - pull, travel_m
