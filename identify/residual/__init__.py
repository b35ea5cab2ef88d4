"""Analysis of the residual: noise or structure, and the direction of the structure."""

from identify.residual.compare import compare
from identify.residual.comparison import Comparison, Level, ResidualTest
from identify.residual.fitted_model import changed_map
from identify.residual.prediction import Prediction, predict
from identify.residual.statement import law_sentence, length, sentence, sigmas
from identify.residual.two_runs import RunDifference, run_difference

__all__ = [
    "Comparison",
    "Level",
    "Prediction",
    "ResidualTest",
    "RunDifference",
    "changed_map",
    "compare",
    "law_sentence",
    "length",
    "predict",
    "run_difference",
    "sentence",
    "sigmas",
]
