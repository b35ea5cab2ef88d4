"""Analysis of the residual: noise or structure, and the direction of the structure."""

from identify.residual.compare import compare
from identify.residual.comparison import Comparison, Level, ResidualTest
from identify.residual.prediction import Prediction, predict
from identify.residual.statement import law_sentence, length, sentence, sigmas

__all__ = [
    "Comparison",
    "Level",
    "Prediction",
    "ResidualTest",
    "compare",
    "law_sentence",
    "length",
    "predict",
    "sentence",
    "sigmas",
]
