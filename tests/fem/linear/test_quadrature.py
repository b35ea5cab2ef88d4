from __future__ import annotations

from math import factorial

import numpy as np
import pytest

from fem.linear.quadrature import TET_RULES


def monomials(degree: int) -> list[tuple[int, int, int]]:
    n = range(degree + 1)
    return [(i, j, k) for i in n for j in n for k in n if i + j + k <= degree]


def integral(i: int, j: int, k: int) -> float:
    """Mean of x^i y^j z^k over the unit tetrahedron: 6 i! j! k!/(i + j + k + 3)!."""
    return 6 * factorial(i) * factorial(j) * factorial(k) / factorial(i + j + k + 3)


@pytest.mark.parametrize("degree", TET_RULES)
def test_a_rule_integrates_every_monomial_up_to_its_degree(degree):
    points, weights = TET_RULES[degree]
    for powers in monomials(degree):
        # Every choice of three of the four coordinates, so that no vertex is special
        for axes in ((0, 1, 2), (1, 2, 3), (3, 0, 1), (2, 3, 0)):
            value = weights @ np.prod(points[:, axes] ** np.array(powers), axis=1)
            assert value == pytest.approx(integral(*powers), rel=1e-13), (powers, axes)


@pytest.mark.parametrize("degree", TET_RULES)
def test_a_rule_is_no_better_than_it_says(degree):
    points, weights = TET_RULES[degree]
    errors = [
        abs(weights @ np.prod(points[:, :3] ** np.array(p), axis=1) / integral(*p) - 1)
        for p in monomials(degree + 1)
        if sum(p) == degree + 1
    ]
    assert max(errors) > 1e-4


@pytest.mark.parametrize("degree", TET_RULES)
def test_points_lie_inside_weights_are_positive_and_both_are_read_only(degree):
    points, weights = TET_RULES[degree]
    assert points.min() > 0
    assert weights.min() > 0
    np.testing.assert_allclose(points.sum(axis=1), 1, rtol=1e-14)
    assert not points.flags.writeable
    assert not weights.flags.writeable
