"""The active set against closed forms of contact, and against its own optimality conditions."""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact.half_space import half_space_matrix, patch_grid
from fem.errors import SolverError
from tests.fem.reference.hayes import sphere_on_layer
from tests.fem.reference.unilateral import press_by, press_with, sphere_gap

E, NU = 7e3, 0.42
PLANE = E / (1 - NU**2)


def half_space(reach: float, patches: int, disc: bool = False) -> tuple[np.ndarray, np.ndarray]:
    centres, side = patch_grid(reach, patches, disc)
    return centres, half_space_matrix(centres, side, NU) / E


def test_a_flat_tip_needs_the_force_of_the_closed_form():
    a, d, errors = 4e-3, 0.7e-3, []
    for patches in (16, 32):
        centres, matrix = half_space(a, patches, disc=True)
        found = press_by(matrix, np.zeros(len(centres)), d)
        assert (found.forces_n > 0).all()
        errors.append(found.force_n / (2 * PLANE * a * d) - 1)
    assert abs(errors[1]) < 0.01
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)  # the rim's error is of first order
    assert abs(2 * errors[1] - errors[0]) < 1e-3


def test_a_shallow_sphere_is_hertz():
    radius, d = 0.1, 0.1e-3
    centres, matrix = half_space(1.3 * np.sqrt(radius * d), 32)
    found = press_by(matrix, sphere_gap(centres, radius), d)
    assert found.force_n == pytest.approx(4 / 3 * PLANE * np.sqrt(radius) * d**1.5, rel=0.002)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_deep_sphere_is_sneddons(share):
    radius = 6e-3
    exact = sphere_on_layer(share * radius, radius, E, NU)
    centres, matrix = half_space(1.2 * exact.radius_m, 32)
    found = press_with(matrix, sphere_gap(centres, radius), exact.force_n)
    assert found.force_n == pytest.approx(exact.force_n, rel=1e-9)
    assert found.travel_m == pytest.approx(exact.travel_m, rel=0.001)
    pressed = centres[found.forces_n > 0]
    side = np.diff(np.unique(centres[:, 0])).min()
    assert abs(np.hypot(*pressed.T).max() - exact.radius_m) < side


def test_no_patch_is_pulled_and_none_lies_inside_an_uneven_tip():
    rng = np.random.default_rng(4)
    centres, matrix = half_space(3e-3, 14)
    stiffer = rng.uniform(0.5, 2, len(centres))  # a body of uneven surface, still symmetric
    matrix = matrix * np.sqrt(np.outer(stiffer, stiffer))
    gap = rng.uniform(0, 0.4e-3, len(centres))
    found = press_by(matrix, gap, 0.3e-3)
    opening = matrix @ found.forces_n - (0.3e-3 - gap)
    pressed = found.forces_n > 0
    assert 20 < pressed.sum() < len(gap) - 20
    assert (found.forces_n >= 0).all()
    assert opening.min() > -1e-9 * 0.3e-3
    assert np.abs(opening[pressed]).max() < 1e-9 * 0.3e-3


def test_the_displacement_far_from_a_patch_is_the_point_forces():
    centres = np.array([[0.0, 0.0], [0.3, -0.4]])
    matrix = half_space_matrix(centres, 1e-3, NU)
    assert matrix[0, 1] == pytest.approx((1 - NU**2) / (np.pi * 0.5), rel=1e-5)
    # Under a square's centre: 4 ln(1 + sqrt 2) (1 - nu^2)/(pi E b) (Johnson, eq. 3.26)
    assert matrix[0, 0] == pytest.approx(
        4 * np.log(1 + np.sqrt(2)) * (1 - NU**2) / (np.pi * 1e-3), rel=1e-12
    )


def test_a_tip_that_does_not_touch_feels_nothing():
    centres, matrix = half_space(3e-3, 6)
    found = press_by(matrix, np.full(len(centres), 1e-3), 0.5e-3)
    assert found.force_n == 0


def test_a_force_without_end_of_travel_is_said():
    centres, matrix = half_space(3e-3, 6)
    with pytest.raises(SolverError, match="no travel found"):
        press_with(matrix, np.full(len(centres), np.inf), 0.1)
