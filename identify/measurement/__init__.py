"""The measurement model: noise, effects in their order, predicted travel."""

from identify.measurement.effect_in_model import EffectInModel
from identify.measurement.noise import Noise, scan_noise

__all__ = ["EffectInModel", "Noise", "scan_noise"]
