"""Reduced bases: compliances of all presses, with bounds and derivatives, at little cost."""

from fem.reduced.model import ReducedBases, ReducedModel, ReducedResponse

__all__ = ["ReducedBases", "ReducedModel", "ReducedResponse"]
