"""Single presses that are hard on a mesh, and their compliance on meshes graded around the tip.

The reference is of another mesh family than the model's blocks: hexahedra of 4/s mm around the tip
(2/s mm around a tip of 2 mm), growing outwards to 8/s mm, cut in five. It keeps the near field,
without which no mesh converges; that this is right is tested against the layer's integral and an
independent solver (`test_fem_near_field`). It is extrapolated from two values of s, which are 0.05
to 0.4 % apart; at nu = 0.49, a = 5 mm, s = 2 was within 0.1 % of that.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from identify.map.gaussian_map import GaussianMap, Inclusion

SIZE = (0.096, 0.096, 0.048)
RATIOS = (0.3, 0.45, 0.49, 0.4999)
TIPS = (0.002, 0.005, 0.01)
HOMOGENEOUS = GaussianMap(1.0)
FINEST = 0.002  # m, tips up to here have cells of half the size
RATE = 1.5  # of the graded meshes, measured over s = 1, 1.5, 2


class Press(NamedTuple):
    """A press on the block's top: tip radius and place in m, and what is below."""

    name: str
    radius: float
    x: float
    y: float
    map: GaussianMap


def steep(x: float, y: float) -> GaussianMap:
    """Six times as stiff within 8 mm, 12 mm deep."""
    return GaussianMap(1.0, (Inclusion(5.0, x, y, SIZE[2] - 0.012, 0.008),))


def presses() -> Iterator[Press]:
    for a in TIPS:
        yield Press("over an inclusion", a, 0.051, 0.045, steep(0.053, 0.046))
        yield Press("rim 2 mm from an edge", a, a + 0.002, 0.051, HOMOGENEOUS)
        yield Press("edge and inclusion", a, a + 0.002, 0.051, steep(a + 0.008, 0.053))
    yield Press("beside an inclusion", 0.005, 0.051, 0.045, steep(0.062, 0.045))


def contacts(chosen: list[Press]) -> Contacts:
    places = np.array([(press.x, press.y, SIZE[2]) for press in chosen])
    radii = np.array([press.radius for press in chosen])
    return Contacts(places, np.tile((0.0, 0.0, -1.0), (len(chosen), 1)), radii)


def by_model(chosen: list[Press], nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Compliance (j,) and estimated error (j,) of the pair of meshes that `palpmap fit` uses."""
    pair = (PalpationModel(block_mesh(SIZE, cells), nu, contacts(chosen))
            for cells in ((8, 8, 4), (12, 12, 6)))  # fmt: skip
    model = RefinedModel(*pair)
    found = []
    for j, press in enumerate(chosen):
        response = model.evaluate(press.map.modulus(model.points_m))
        found.append((response.compliance[j], response.error[j]))
    return tuple(np.array(found).T)


def reference(press: Press, nu: float, extrapolate: bool = True) -> float:
    first = 1.0 if press.radius > FINEST else 0.75
    values = []
    for s in (first, 1.4 * first) if extrapolate else (first,):
        model = PalpationModel(graded(press, s), nu, contacts([press]))
        values.append(model.evaluate(press.map.modulus(model.points_m)).compliance[0])
    if not extrapolate:
        return values[0]
    return values[1] + (values[1] - values[0]) / (1.4**RATE - 1)


def graded(press: Press, s: float) -> Mesh:
    """Mesh of the block, graded towards a press."""
    places = (press.x, press.y, SIZE[2])
    step = 0.004 if press.radius > FINEST else 0.002
    planes = [_planes(length, at, step, s) for length, at in zip(SIZE, places, strict=True)]
    counts = [len(p) - 1 for p in planes]
    plain = block_mesh((1, 1, 1), counts, order=1, split="alternating")
    index = np.round(plain.nodes * counts).astype(int)
    nodes = np.column_stack([p[i] for p, i in zip(planes, index.T, strict=True)])
    return promote_to_tet10(Mesh(nodes, plain.cells, plain.surfaces))


def _planes(length: float, place: float, smallest: float, s: float) -> np.ndarray:
    sides = []
    for reach in (place, length - place):
        step, at = smallest / s, [0.0]
        while at[-1] < reach:
            if at[-1] >= 1.5 * smallest:
                step = min(step * (1 + 0.3 / s), 0.008 / s)
            at.append(at[-1] + step)
        if len(at) > 2 and at[-1] - reach > reach - at[-2]:
            at.pop()
        sides.append(np.array(at[1:]) * (reach / at[-1]) if reach > 0 else np.zeros(0))
    return np.concatenate([place - sides[0][::-1], [place], place + sides[1]])
