"""Analysis of the residual: noise or structure, and the direction of the structure."""

from identify.residual.compare import compare
from identify.residual.comparison import Comparison, Level, ResidualTest
from identify.residual.statement import length, sigmas

__all__ = ["Comparison", "Level", "ResidualTest", "compare", "length", "sigmas"]
