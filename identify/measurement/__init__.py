"""The measurement model: noise, effects in their order, predicted travel."""

from identify.measurement.noise import Noise, scan_noise

__all__ = ["Noise", "scan_noise"]
