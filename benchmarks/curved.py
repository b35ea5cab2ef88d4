"""Compliance of presses on domes against an exact axisymmetric solution, over the size of cells.

    python benchmarks/curved.py [RADIUS ...]

Spherical caps with facets of a tenth of their radius (mm), meshed as a fit does: 7 and 10 cells
along the cube root of the volume; tips of 3 and 5 mm, contacts of balls of 1, 2 and 3 mm.
"""

import sys

import numpy as np
from scipy.spatial import ConvexHull

from fem import Contacts, PalpationModel, check_surface, tetrahedralize_surface
from fem.mesh import Surface
from tests.fem.reference.dome import cap_compliance

TIPS = (("flat", 3.0), ("flat", 5.0), ("hertz", 1.0), ("hertz", 2.0), ("hertz", 3.0))
TALLEST = 40.0
RATIOS = (0.45, 0.49)
CELLS = (7, 10)


def cap(radius: float, height: float, edge: float, seed: int = 0) -> Surface:
    """Make the closed surface of a cap, m, its vertices on the sphere; lengths are in mm."""
    rng = np.random.default_rng(seed)
    count = int(4 * np.pi * radius**2 / (edge**2 * np.sqrt(3) / 2))
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - z**2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # the pole of the spiral lies anywhere
    points = radius * np.stack([across * np.cos(angle), across * np.sin(angle), z], 1) @ turn
    points = points[points[:, 2] > radius - height + 0.45 * edge] - [0, 0, radius - height]
    base = np.sqrt(radius**2 - (radius - height) ** 2)
    angle = 2 * np.pi * np.arange(round(2 * np.pi * base / edge)) / round(2 * np.pi * base / edge)
    rim = np.stack([base * np.cos(angle), base * np.sin(angle), 0 * angle], axis=1)
    nodes = np.vstack([points, rim, [[0, 0, 0]]])
    triangles = ConvexHull(nodes[:-1]).simplices
    corners = nodes[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.sum(normal * (corners.mean(axis=1) - [0, 0, height / 3]), axis=1) < 0
    triangles[inwards] = triangles[inwards, ::-1]
    upper = triangles[corners[:, :, 2].max(axis=1) > 1e-9]
    first = len(points) + np.arange(len(rim))
    below = np.stack([np.full(len(rim), len(nodes) - 1), np.roll(first, -1), first], axis=1)
    return check_surface(nodes * 1e-3, np.vstack([upper, below]))


def errors(radius: float, nu: float, cells: int) -> tuple[float, list[float]]:
    """Cell size in mm, and relative errors of the compliances under `TIPS`."""
    height = min(radius, TALLEST)
    surface = cap(radius, height, 0.1 * radius)
    size = float(np.cbrt(surface.volume) / cells)
    mesh = tetrahedralize_surface(surface.vertices, surface.triangles, size)
    found = []
    for profile, contact in TIPS:
        apex, down = np.array([0, 0, 1e-3 * height]), np.array([0, 0, -1.0])
        press = Contacts(apex, down, np.array([1e-3 * contact]), profile)
        compliance = PalpationModel(mesh, nu, press).evaluate(1.0).compliance[0]
        exact = 1e3 * cap_compliance(radius, height, contact, nu, profile)
        found.append(float(compliance / exact - 1))
    return 1e3 * size, found


def main() -> None:
    """Print the table."""
    print("| radius | Poisson's ratio | cells, mm | " + " | ".join(f"{p} {a:g}" for p, a in TIPS))
    for radius in map(float, sys.argv[1:] or ("20", "40", "80")):
        for nu in RATIOS:
            for cells in CELLS:
                size, found = errors(radius, nu, cells)
                row = " | ".join(f"{100 * e:+.2f}" for e in found)
                print(f"| {radius:g} | {nu} | {size:.1f} | {row} |", flush=True)


if __name__ == "__main__":
    main()
