"""Reduced bases: the compliance of every press, with bounds, and its derivatives, at little cost."""

from fem.reduced.model import ReducedBases, ReducedModel, ReducedResponse

__all__ = ["ReducedBases", "ReducedModel", "ReducedResponse"]
