"""The map of Young's modulus: background and Gaussian inclusions, or a free field on a grid."""

from identify.map.free_map import FreeMap
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.grid import Grid
from identify.map.labelled_grid import LabelledGrid
from identify.map.matern import MaternField
from identify.map.parameters import parameter_space

__all__ = [
    "FreeMap",
    "GaussianMap",
    "Grid",
    "Inclusion",
    "LabelledGrid",
    "MaternField",
    "parameter_space",
]
