"""Where the modulus is sampled in the cells around the tips, and how it runs between the samples.

Elsewhere a cell's samples are the points of the stiffness matrix's rule. Under a tip the strain
varies so much that how the modulus runs counts too: there it is the quadratic through ten samples,
in the stiffness matrix as in the near field (`fem.near_field`). Were it another in the one than in
the other, the energy of what the near field adds to the finite elements, a small difference of
large ones, could come out as nothing.
"""

from __future__ import annotations

import numpy as np

from fem.quadrature import TET_RULES, monomials

# lambda_a lambda_b, a <= b: the ten products that span the quadratics of a cell
PRODUCTS = monomials(2)
# Places between which a quadratic modulus is fitted best: the ten nodes, drawn inwards
CLOSE_SAMPLES = 0.25 + 0.7 * ((PRODUCTS[:, :, None] == np.arange(4)).mean(axis=1) - 0.25)
CLOSE_BASIS = np.linalg.inv(CLOSE_SAMPLES[:, PRODUCTS].prod(axis=2)).T
CLOSE_RULE = TET_RULES[5]  # exact for a quadratic modulus times quadratic strains, and more
_AT_RULE = CLOSE_RULE[0][:, PRODUCTS].prod(axis=2) @ CLOSE_BASIS.T  # (points, samples)
_LEAST = 0.05  # of a cell's smallest sample: what the quadratic may not fall below


def close_points_m(corners: np.ndarray) -> np.ndarray:
    """Places (c s, 3) m of the samples of cells with corners (c, 4, 3)."""
    return np.einsum("qv,cvi->cqi", CLOSE_SAMPLES, corners).reshape(-1, 3)


def at_rule(modulus_pa: np.ndarray) -> np.ndarray:
    """Modulus (c, points) at `CLOSE_RULE` for samples (c, s)."""
    return np.maximum(modulus_pa @ _AT_RULE.T, _LEAST * modulus_pa.min(axis=1, keepdims=True))


def by_sample(by_point: np.ndarray) -> np.ndarray:
    """Return derivatives by the samples (..., s) from those by the modulus at the rule (..., p)."""
    return by_point @ _AT_RULE
