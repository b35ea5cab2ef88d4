"""Reduced bases: compliances of all presses, with bounds and derivatives, at little cost."""

from fem.reduced.bases import ReducedBases
from fem.reduced.model import ReducedModel
from fem.reduced.response import ReducedResponse

__all__ = ["ReducedBases", "ReducedModel", "ReducedResponse"]
