"""The body that is really there: soft body, its hidden truth, its true map."""

from sim.body.block_compliance import forget_models
from sim.body.law import Creep
from sim.body.soft_body import DIVISIONS, SoftBody
from sim.body.true_body import PAPER_SIZE_M, HiddenBody
from sim.body.true_map import Inclusion, TruthMap, drawn_truth

__all__ = [
    "DIVISIONS",
    "PAPER_SIZE_M",
    "Creep",
    "HiddenBody",
    "Inclusion",
    "SoftBody",
    "TruthMap",
    "drawn_truth",
    "forget_models",
]
