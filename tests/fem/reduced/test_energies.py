"""Energies of pairs of fields against those of single ones and of their sums."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from fem.reduced.energies import Strains, mixed_energies


@pytest.mark.parametrize(
    ("ratio", "near_field", "order"),
    [(0.45, True, 2), (0.499, True, 2), (0.45, False, 2), (0.3, True, 1)],
)
def test_the_energy_of_a_sum_is_that_of_its_parts_and_twice_the_mixed_one(ratio, near_field, order):
    points = np.array([(x, y, 0.024) for x in (0.014, 0.026) for y in (0.016, 0.028)])
    contacts = Contacts(points, np.array([0.0, 0.0, -1.0]), np.array(0.004))
    mesh = block_mesh((0.04, 0.04, 0.024), (3, 3, 2), order=order)
    model = PalpationModel(mesh, ratio, contacts, near_field=near_field)
    count = len(model.points_m) - len(points)
    slope = 1e5 * model.points_m[:, 0]
    one, other = model.evaluate(5e3 + slope), model.evaluate(9e3 - slope, (2e-6, 1e-6))
    nodal = [r._body.stiffness.prolong(r._free) for r in (one, other)]
    free = model.floating.stiffness.restrict(nodal[0] + nodal[1])
    both = replace(other, _free=free, amplitude=one.amplitude + other.amplitude)
    first, second, whole = (-r.sensitivity[:, :count] for r in (one, other, both))
    a, b = Strains.of(one), Strains.of(other)
    largest = whole.max()
    assert mixed_energies(model, a, a) == pytest.approx(first, abs=3e-6 * largest)
    assert mixed_energies(model, b, b) == pytest.approx(second, abs=3e-6 * largest)
    mixed = (whole - first - second) / 2
    assert mixed_energies(model, a, b) == pytest.approx(mixed, abs=3e-6 * largest)
    assert np.abs(mixed).max() > 1e-2 * largest
