"""Hidden effects that no catalogue has: the right answer is that something else is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect
from sim.planted.response import follow


class LateForce(HiddenEffect):
    """The force channel is reported late."""

    name, category = "outside_late_force", "outsider"
    law = "force(t - delay)"
    amplitude, typical, limit = "delay_s", 0.07, 0.5

    def sensor(self, bench, force_n, travel_m, values):
        """Shift the force in time, within each press."""
        earlier = bench.within_s - values["delay_s"]
        rows = zip(earlier, bench.within_s, force_n, strict=True)
        late = [np.interp(wanted, known, force, left=0.0) for wanted, known, force in rows]
        return np.array(late), travel_m


class CreepingInclusion(HiddenEffect):
    """Only the inclusion creeps; the rest of the body is elastic."""

    name, category = "outside_creeping_inclusion", "outsider"
    law = "C(t) between the map's compliance and that with weight/(1 + share)"
    amplitude, typical, limit = "share", 0.5, 100.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the time constant."""
        return {"time_constant_s": float(rng.uniform(0.4, 1.2))}

    def response(self, bench, travel_m, values):
        """Let the part of the travel grow that a softer inclusion would add."""
        truth = bench.body.truth
        first, *others = truth.inclusions
        weaker = replace(first, weight_pa=first.weight_pa / (1 + values["share"]))
        body = replace(bench.body, truth=replace(truth, inclusions=(weaker, *others)))
        more = bench.compliance(body=body) / bench.compliance() - 1
        delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
        return travel_m + more[:, None] * delayed


class SlippedPresses(HiddenEffect):
    """Four presses went wrong: they slipped, and travel further at the same force."""

    name, category = "outside_slipped_presses", "outsider"
    law = "u (1 + share) in four presses"
    amplitude, typical, limit = "share", 0.15, 2.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the presses."""
        count = min(4, len(bench.program))
        chosen = rng.choice(len(bench.program), count, replace=False)
        return {f"press_{i}": float(press) for i, press in enumerate(sorted(chosen))}

    def contact(self, bench, travel_m, values):
        """Let them slip."""
        slipped = [int(value) for name, value in values.items() if name.startswith("press_")]
        factor = np.ones((len(travel_m), 1))
        factor[slipped] += values["share"]
        return travel_m * factor


class CoolingBody(HiddenEffect):
    """The body cools while it is pressed, and stiffens: down, and up again as the room warms."""

    name, category = "outside_cooling", "outsider"
    law = "u (1 - share sin^2(pi t/T) ), T the first session"
    amplitude, typical, limit = "share", 0.05, 0.6

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Hold the session's end, which further presses do not move."""
        del rng
        return {"session_s": float(bench.time_s[-1, -1])}

    def contact(self, bench, travel_m, values):
        """Stiffen in the middle of the session."""
        t = bench.time_s / values["session_s"]
        return travel_m * (1 - values["share"] * np.sin(np.pi * t) ** 2)


class StickSlip(HiddenEffect):
    """The tip sticks and jumps on: a saw tooth over the travel."""

    name, category = "outside_stick_slip", "outsider"
    law = "travel - h frac(travel/step)"
    amplitude, typical, limit = "height_m", 2e-4, 2e-3

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the length of a step, 0.5 to 1 mm."""
        return {"step_m": float(rng.uniform(5e-4, 1e-3))}

    def sensor(self, bench, force_n, travel_m, values):
        """Hold the tip back until it jumps."""
        return force_n, travel_m - values["height_m"] * np.mod(travel_m / values["step_m"], 1)


class CoarseEncoder(HiddenEffect):
    """Travel is counted in whole steps of a worn encoder."""

    name, category = "outside_coarse_encoder", "outsider"
    law = "step round(travel/step)"
    amplitude, typical, limit = "step_m", 2e-4, 3e-3

    def sensor(self, bench, force_n, travel_m, values):
        """Round the travel."""
        step = values["step_m"]
        return force_n, (step * np.round(travel_m / step) if step else travel_m)


class StickyTip(HiddenEffect):
    """The wet surface clings: on unloading the tip is pulled back before it comes free."""

    name, category = "outside_sticky_tip", "outsider"
    law = "force - pull exp(-F/F_s) while unloading, F_s a fifth of the peak"
    amplitude, typical, limit = "pull_n", 0.02, 0.5

    def sensor(self, bench, force_n, travel_m, values):
        """Pull while unloading."""
        unloading = bench.part == 2
        scale = bench.program.force_n[:, None] / 5
        pull = values["pull_n"] * np.exp(-np.maximum(force_n, 0) / scale) * unloading
        return force_n - pull, travel_m


class TwoCreepTimes(HiddenEffect):
    """Creep with two time constants, a factor of thirty apart, where the catalogue has one."""

    name, category = "outside_two_creep_times", "outsider"
    law = "u + g (z_1 + z_2)/2"
    amplitude, typical, limit = "share", 0.1, 3.0
    kin = ("viscoelasticity",)

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the shorter time constant."""
        return {"time_constant_s": float(rng.uniform(0.08, 0.16))}

    def response(self, bench, travel_m, values):
        """Add both."""
        short = values["time_constant_s"]
        both = sum(follow(travel_m, bench.within_s, tau) for tau in (short, 30 * short))
        return travel_m + values["share"] * np.asarray(both) / 2
