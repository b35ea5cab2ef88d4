"""Hidden effects of the instrument: the reported readings differ from the true ones."""

from __future__ import annotations

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import any_direction, on_sensor


@on_sensor("compliance", "travel + c F", "compliance_m_per_n", 4e-4)
def tool_compliance(bench, force_n, travel_m, values):
    """The tool bends in proportion to the true force, and the bend is taken for travel."""
    return force_n, travel_m + values["compliance_m_per_n"] * bench.force_n


@on_sensor("structured", "force + b", "bias_n", 0.01, two_sided=True)
def force_bias(bench, force_n, travel_m, values):
    """The force channel reads a constant too much."""
    return force_n + values["bias_n"], travel_m


@on_sensor("structured", "force + rate t, t since the first press", "rate_n_per_s", 6e-5,
           two_sided=True)  # fmt: skip
def force_drift(bench, force_n, travel_m, values):
    """The zero of the force channel walks away over the session."""
    return force_n + values["rate_n_per_s"] * (bench.time_s - bench.begin_s), travel_m


@on_sensor("structured", "force (1 + rate t), t since the first press", "rate_per_s", 2e-4,
           limit=0.01, two_sided=True)  # fmt: skip
def sensitivity_drift(bench, force_n, travel_m, values):
    """The force channel gains or loses sensitivity over the session."""
    gain = 1 + values["rate_per_s"] * (bench.time_s - bench.begin_s)
    return force_n * gain, travel_m


@on_sensor("structured", "F_s tanh(F/F_s), F_s = 1/knee", "knee_per_n", 1.0, limit=20.0)
def force_saturation(bench, force_n, travel_m, values):
    """The force channel bends over: it reads less, the larger the force."""
    knee = values["knee_per_n"]
    return (np.tanh(knee * force_n) / knee if knee else force_n), travel_m


@on_sensor("structured", "travel - offset", "offset_m", 1.5e-4, two_sided=True)
def contact_offset(bench, force_n, travel_m, values):
    """First touch was called too late (or too early): all travels lack the same length."""
    return force_n, travel_m - values["offset_m"]


@on_sensor("structured", "travel + slope (cos(angle) (x - x_c) + sin(angle) (y - y_c))", "slope",
           3e-3, draw=any_direction)  # fmt: skip
def surface_tilt(bench, force_n, travel_m, values):
    """The surface stands askew to the plane that the robot assumes: travel counts from it."""
    centred = bench.points_m - np.array(bench.body.size_m[:2]) / 2
    towards = [np.cos(values["angle_rad"]), np.sin(values["angle_rad"])]
    return force_n, travel_m + values["slope"] * (centred @ towards)[:, None]


@on_sensor("structured", "travel + rate t, t since the first press", "rate_m_per_s", 5e-7,
           two_sided=True)  # fmt: skip
def displacement_drift(bench, force_n, travel_m, values):
    """The arm grows over the session, and its growth is taken for travel."""
    return force_n, travel_m + values["rate_m_per_s"] * (bench.time_s - bench.begin_s)


def _off_the_rhythm(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw phase and a frequency off the rhythm of the presses."""
    rhythm = 1 / max(float(np.median(np.diff(bench.program.start_s, append=np.inf))), 1e-9)
    while True:
        frequency = float(rng.uniform(0.13, 0.6))
        if abs(frequency / rhythm - round(frequency / rhythm)) * rhythm > 0.015:
            break
    return {"frequency_hz": frequency, "phase_rad": float(rng.uniform(0, 2 * np.pi))}


@on_sensor("structured", "travel + a sin(2 pi f t + phase)", "amplitude_m", 1.2e-4,
           draw=_off_the_rhythm)  # fmt: skip
def breathing(bench, force_n, travel_m, values):
    """The body heaves as one, whatever is pressed."""
    angle = 2 * np.pi * values["frequency_hz"] * bench.time_s + values["phase_rad"]
    return force_n, travel_m + values["amplitude_m"] * np.sin(angle)
