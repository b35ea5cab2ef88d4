"""Hidden effects of the instrument: what the robot reports is not what happens."""

from __future__ import annotations

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect


class ToolCompliance(HiddenEffect):
    """The tool bends by so much a newton of true force, and the bend is taken for travel."""

    name, category = "tool_compliance", "compliance"
    law = "travel + c F"
    amplitude, typical = "compliance_m_per_n", 4e-4

    def sensor(self, bench, force_n, travel_m, values):
        """Add the bend."""
        return force_n, travel_m + values["compliance_m_per_n"] * bench.force_n


class ForceBias(HiddenEffect):
    """The force channel reads a constant too much."""

    name, category = "force_bias", "structured"
    law = "force + b"
    amplitude, typical = "bias_n", 0.01
    two_sided = True

    def sensor(self, bench, force_n, travel_m, values):
        """Shift the force."""
        return force_n + values["bias_n"], travel_m


class ForceDrift(HiddenEffect):
    """The zero of the force channel walks away over the session."""

    name, category = "force_drift", "structured"
    law = "force + rate t, t since the first press"
    amplitude, typical = "rate_n_per_s", 6e-5
    two_sided = True

    def sensor(self, bench, force_n, travel_m, values):
        """Let the force channel drift."""
        return force_n + values["rate_n_per_s"] * (bench.time_s - bench.begin_s), travel_m


class SensitivityDrift(HiddenEffect):
    """The force channel gains or loses sensitivity over the session."""

    name, category = "sensitivity_drift", "structured"
    law = "force (1 + rate t), t since the first press"
    amplitude, typical, limit = "rate_per_s", 2e-4, 0.01
    two_sided = True

    def sensor(self, bench, force_n, travel_m, values):
        """Scale the force channel."""
        gain = 1 + values["rate_per_s"] * (bench.time_s - bench.begin_s)
        return force_n * gain, travel_m


class ForceSaturation(HiddenEffect):
    """The force channel bends over: it reads less, the larger the force."""

    name, category = "force_saturation", "structured"
    law = "F_s tanh(F/F_s), F_s = 1/knee"
    amplitude, typical = "knee_per_n", 1.0
    limit = 20.0

    def sensor(self, bench, force_n, travel_m, values):
        """Bend the force channel."""
        knee = values["knee_per_n"]
        return (np.tanh(knee * force_n) / knee if knee else force_n), travel_m


class ContactOffset(HiddenEffect):
    """First touch was called too late (or too early): all travels lack the same length."""

    name, category = "contact_offset", "structured"
    law = "travel - offset"
    amplitude, typical = "offset_m", 1.5e-4
    two_sided = True

    def sensor(self, bench, force_n, travel_m, values):
        """Shift the travel."""
        return force_n, travel_m - values["offset_m"]


class SurfaceTilt(HiddenEffect):
    """The surface stands askew to the plane that the robot assumes: travel counts from it."""

    name, category = "surface_tilt", "structured"
    law = "travel + slope (cos(angle) (x - x_c) + sin(angle) (y - y_c))"
    amplitude, typical = "slope", 3e-3

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw where it slopes to."""
        return {"angle_rad": float(rng.uniform(0, 2 * np.pi))}

    def sensor(self, bench, force_n, travel_m, values):
        """Add the height of the plane."""
        centred = bench.points_m - np.array(bench.body.size_m[:2]) / 2
        towards = [np.cos(values["angle_rad"]), np.sin(values["angle_rad"])]
        return force_n, travel_m + values["slope"] * (centred @ towards)[:, None]


class DisplacementDrift(HiddenEffect):
    """The arm grows over the session, and its growth is taken for travel."""

    name, category = "displacement_drift", "structured"
    law = "travel + rate t, t since the first press"
    amplitude, typical = "rate_m_per_s", 5e-7
    two_sided = True

    def sensor(self, bench, force_n, travel_m, values):
        """Add the growth."""
        return force_n, travel_m + values["rate_m_per_s"] * (bench.time_s - bench.begin_s)


class Breathing(HiddenEffect):
    """The body heaves as one, whatever is pressed."""

    name, category = "breathing", "structured"
    law = "travel + a sin(2 pi f t + phase)"
    amplitude, typical = "amplitude_m", 1.2e-4

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw frequency and phase; the frequency stays off the rhythm of the presses."""
        rhythm = 1 / max(float(np.median(np.diff(bench.program.start_s, append=np.inf))), 1e-9)
        while True:
            frequency = float(rng.uniform(0.13, 0.6))
            if abs(frequency / rhythm - round(frequency / rhythm)) * rhythm > 0.015:
                break
        return {"frequency_hz": frequency, "phase_rad": float(rng.uniform(0, 2 * np.pi))}

    def sensor(self, bench, force_n, travel_m, values):
        """Add the heave."""
        angle = 2 * np.pi * values["frequency_hz"] * bench.time_s + values["phase_rad"]
        return force_n, travel_m + values["amplitude_m"] * np.sin(angle)
