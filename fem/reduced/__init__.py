"""Reduced basis: the compliance of every press, and its derivatives, without the mesh."""
