"""Reduced bases: compliances of all presses, with bounds and derivatives, at little cost."""

from fem.reduced.bases import ReducedBases
from fem.reduced.model import Body, ReducedModel
from fem.reduced.ratio import ReducedRatio
from fem.reduced.response import ReducedResponse

__all__ = ["Body", "ReducedBases", "ReducedModel", "ReducedRatio", "ReducedResponse"]
