"""What presses share of their near fields: little is computed, and nothing is mixed up."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fem import Contacts, PalpationModel, block_mesh
from fem.mesh import moved_sides
from fem.near_field import enrichment, reuse
from fem.near_field.reuse import shared

SIZE = (0.048, 0.048, 0.024)
PLACES = [(x, y, SIZE[2]) for x in (0.009, 0.018, 0.027, 0.036) for y in (0.006, 0.018, 0.030)]


def modulus_at(points: np.ndarray) -> np.ndarray:
    distance = ((points - [0.02, 0.024, 0.016]) ** 2).sum(axis=1)
    return 6e3 + 2e4 * np.exp(-distance / (2 * 0.006**2))


def all_different(rows: np.ndarray, kind: bytes) -> np.ndarray:
    return np.random.default_rng(abs(hash(rows.tobytes()))).integers(1 << 62, size=len(rows))


@pytest.mark.parametrize("radii", [(0.004,), (0.003, 0.005)])
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_bodies_answer_the_same_whether_or_not_integrals_are_shared(radii, nu, monkeypatch):
    contacts = Contacts(PLACES, (0, 0, -1), np.resize(radii, len(PLACES)))
    mesh = block_mesh(SIZE, (4, 4, 2))
    found = []
    for share in (True, False):
        if not share:
            monkeypatch.setattr(reuse, "_hashes", all_different)
        model = PalpationModel(mesh, nu, contacts)
        direction = np.array([0.8, 0.6, 0.0])
        fibres = direction, np.full(len(model.points_m), 300.0)
        response = model.evaluate(modulus_at(model.points_m), fibres=fibres)
        found.append((response.compliance, response.sensitivity))
    # Of mixed tips the quadrature around the rim takes its width from the cells at hand
    rtol = 1e-11 if len(radii) == 1 else 3e-5
    assert_allclose(found[0][0], found[1][0], rtol=rtol)
    scale = np.abs(found[1][1]).max()
    assert_allclose(found[0][1], found[1][1], atol=rtol * scale)


def test_of_presses_on_a_regular_grid_few_cells_are_computed():
    rng = np.random.default_rng(0)
    cell = rng.normal(size=(5, 4, 3)) * 1e-2
    asked = []

    def compute(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
        asked.extend((j, c) for c in which)
        nodes = local[j][which]
        return nodes.sum(axis=(1, 2)), np.column_stack([nodes[:, 0, 0], nodes[:, 1, 1]])

    # Presses 0 and 1 alike but for rounding, 2 has some of their cells, 3 another frame
    local = [cell, cell + 1e-17, cell[[3, 1]], cell[:2], cell[:0]]
    kinds = [b"a", b"a", b"a", b"b", b"a"]
    found = shared(local, kinds, np.full(5, 0.005), compute)
    assert sorted(asked) == [(0, c) for c in range(5)] + [(3, 0), (3, 1)]
    assert [len(array) for array in found.arrays] == [7, 7]
    for nodes, rows in zip(local, found.rows, strict=True):
        sums, some = (array[rows] for array in found.arrays)
        assert_allclose(sums, nodes.sum(axis=(1, 2)))
        assert_array_equal(some.shape, (len(nodes), 2))
        assert_allclose(some[:, 1], nodes[:, 1, 1])


def test_where_all_cells_differ_each_press_computes_its_own():
    local = [np.random.default_rng(j).normal(size=(3, 4, 3)) for j in range(4)]
    calls = []

    def compute(j: int, which: np.ndarray) -> tuple[np.ndarray, ...]:
        calls.append((j, which.tolist()))
        return (local[j][which].sum(axis=(1, 2)),)

    found = shared(local, [b""] * 4, np.ones(4), compute)
    assert sorted(calls) == [(j, [0, 1, 2]) for j in range(4)]
    for nodes, rows in zip(local, found.rows, strict=True):
        assert_allclose(found.arrays[0][rows], nodes.sum(axis=(1, 2)))


def test_a_body_without_cells_to_share_is_none():
    empty = np.empty((0, 4, 3))
    found = shared([empty, empty], [b"", b""], np.ones(2), lambda j, which: (which * 1.0,))
    assert [len(rows) for rows in found.rows] == [0, 0]
    assert len(found.arrays[0]) == 0


@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_another_mesh_and_other_presses_take_what_is_known(nu, monkeypatch):
    contacts = Contacts(PLACES, (0, 0, -1), 0.004)
    mesh = block_mesh(SIZE, (4, 4, 2))
    first = PalpationModel(mesh, nu, contacts)
    computed = []
    integrals = enrichment._integrals

    def counted(stiffness, place, cells, *rest):
        computed.append(len(cells))
        return integrals(stiffness, place, cells, *rest)

    monkeypatch.setattr(enrichment, "_integrals", counted)
    turned = Contacts(PLACES[::-1] + PLACES[:2], (0, 0, -1), 0.004)
    again = first.on(mesh, turned)
    assert sum(computed) == 0
    moved = moved_sides(mesh, (0.001, 0.0))
    elsewhere = first.on(moved)
    few = sum(computed)
    for model, alone in ((again, PalpationModel(mesh, nu, turned)),
                         (elsewhere, PalpationModel(moved, nu, contacts))):  # fmt: skip
        field = modulus_at(model.points_m)
        response, expected = model.evaluate(field), alone.evaluate(field)
        assert_allclose(response.compliance, expected.compliance, rtol=1e-6)
        scale = np.abs(expected.sensitivity).max()
        assert_allclose(response.sensitivity, expected.sensitivity, atol=1e-5 * scale)
    assert 0 < few < 0.4 * sum(computed)
