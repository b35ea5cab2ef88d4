"""Linear elasticity on a mesh: assembly, quadrature, modulus samples, supports."""

from fem.linear.assembly import POINTWISE

__all__ = ["POINTWISE"]
