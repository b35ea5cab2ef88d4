"""The map of Young's modulus: background and Gaussian inclusions, parameters, initial guess."""

from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space

__all__ = ["GaussianMap", "Inclusion", "parameter_space"]
