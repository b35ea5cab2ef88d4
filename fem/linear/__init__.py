"""Linear elasticity on a mesh: assembly, quadrature, modulus samples, supports."""
