"""Make the example: a closed surface like a small liver, and a scan of it made on a finer mesh.

    python examples/organ/make_organ.py

writes organ.stl, scan.csv, study.toml and truth.json beside this file. The hidden body is solved
with more and other tetrahedra than `palpmap fit` takes, and the readings get noise of 20 um and
5 mN, so that the fit has something to find and to fail at.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from fem import Contacts, PalpationModel, read_surface, tetrahedralize_surface
from identify.map.gaussian_map import GaussianMap, Inclusion
from models.scan import Scan
from models.scan_file import write_scan

RINGS = 15  # 6 RINGS^2 triangles on the upper side, as many on the base
HALF_AXES_M = (0.050, 0.035, 0.040)
POISSON_RATIO = 0.45
TRUTH = GaussianMap(6000.0, (Inclusion(18000.0, 0.058, 0.040, 0.018, 0.009),))
TIP_RADIUS_M = 0.0045
NOISE_M, NOISE_N = 20e-6, 5e-3
LARGEST_FORCE_N = 0.3
EDGES = 17  # along the cube root of the volume; the fit takes fewer

STUDY = """\
# A synthetic scan of a body given by its surface; make_organ.py made it, truth.json has the answer.

[study]
name = "organ with a hidden inclusion"
scan = "scan.csv"

[body]
shape = "surface"
file = "organ.stl"                    # metres, closed, flat underside, z up
poisson_ratio = {poisson_ratio}
support = "base-bonded"

[probe]
tip = "flat"
radius_m = {radius}

[noise]
displacement_m = {noise_m}
force_n = {noise_n}

[map]
inclusions = 1
"""


def organ_triangles() -> np.ndarray:
    """Triangles (t, 3, 3) in m of the surface: domed, thinner towards one end, flat below."""
    disc, triangles = _hexagonal_disc(RINGS)
    radius = np.linalg.norm(disc, axis=1)
    outline = np.divide(disc, radius[:, None], out=np.zeros_like(disc), where=radius[:, None] > 0)
    bent = 1 + 0.06 * outline[:, 0] * outline[:, 1]  # no ellipse, and no plane of symmetry
    a, b, c = HALF_AXES_M
    dome = np.column_stack([
        a + a * bent * np.sin(radius * np.pi / 2) * outline[:, 0],
        b + b * bent * np.sin(radius * np.pi / 2) * outline[:, 1],
        c * np.cos(radius * np.pi / 2) * (1 - 0.22 * disc[:, 0]),
    ])  # fmt: skip
    dome[radius > 1 - 1e-9, 2] = 0
    base = np.column_stack([a + a * bent * disc[:, 0], b + b * bent * disc[:, 1], 0 * radius])
    rim = radius > 1 - 1e-9
    base[rim] = dome[rim]  # the same numbers, so that the surface is closed
    return np.vstack([dome[triangles], base[triangles[:, ::-1]]])


def _hexagonal_disc(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 2) of the unit disc in rings of 6 k, and triangles, counter-clockwise."""
    points, triangles = [np.zeros((1, 2))], []
    start = np.cumsum([0, 1, *(6 * k for k in range(1, rings + 1))])
    for k in range(1, rings + 1):
        angle = 2 * np.pi * np.arange(6 * k) / (6 * k)
        points.append(k / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
        for sector in range(6):
            outer = start[k] + (sector * k + np.arange(k + 1)) % (6 * k)
            inner = start[k - 1] + (sector * (k - 1) + np.arange(k)) % max(6 * (k - 1), 1)
            triangles += [(inner[i], outer[i], outer[i + 1]) for i in range(k)]
            triangles += [(inner[i], outer[i + 1], inner[i + 1]) for i in range(k - 1)]
    return np.vstack(points), np.array(triangles)


def write_stl(path: Path, triangles: np.ndarray) -> None:
    """Write a binary STL file."""
    record = np.zeros(len(triangles), dtype="<3f4, <(3,3)f4, <u2")
    record["f0"] = _normals(triangles)
    record["f1"] = triangles
    path.write_bytes(b"\0" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes())


def presses(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Contact points (j, 3) and inward directions: a grid seen from above, not too near the rim."""
    normals = _normals(triangles)
    centres = triangles.mean(axis=1)
    steep = normals[:, 2] < np.cos(np.radians(40))
    x, y = np.meshgrid(np.linspace(0.014, 0.086, 8), np.linspace(0.012, 0.058, 7))
    chosen = []
    for target in np.column_stack([x.ravel(), y.ravel()]):
        distance = np.linalg.norm(centres[:, :2] - target, axis=1) + np.where(steep, 1.0, 0.0)
        if distance.min() < 0.004:
            chosen.append(int(distance.argmin()))
    return centres[chosen], -normals[chosen]


def _normals(triangles: np.ndarray) -> np.ndarray:
    a, b, c = triangles.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def make_scan(folder: Path, points: np.ndarray, directions: np.ndarray, seed: int) -> Scan:
    """Press the hidden body at each point: six steps up, two readings held."""
    surface = read_surface(folder / "organ.stl")
    edge = np.cbrt(surface.volume) / EDGES
    mesh = tetrahedralize_surface(surface.vertices, surface.triangles, edge)
    contacts = Contacts(points, directions, np.full(len(points), TIP_RADIUS_M))
    model = PalpationModel(mesh, POISSON_RATIO, contacts)
    compliance = model.evaluate(TRUTH.modulus(model.points_m)).compliance
    levels = np.r_[np.arange(1, 7) / 6, 1.0, 1.0] * LARGEST_FORCE_N
    press = np.repeat(np.arange(len(points)), len(levels))
    force = np.tile(levels, len(points))
    rng = np.random.default_rng(seed)
    return Scan(
        press=press,
        time_s=5.0 * press + 0.25 * np.tile(np.arange(len(levels)), len(points)),
        phase=np.tile(["load"] * 6 + ["hold"] * 2, len(points)),
        point_m=points[press],
        direction=directions[press],
        force_n=force + rng.normal(0, NOISE_N, len(force)),
        displacement_m=compliance[press] * force + rng.normal(0, NOISE_M, len(force)),
        probe_radius_m=np.full(len(force), TIP_RADIUS_M),
    )


def main() -> None:
    """Write the example's files."""
    parser = argparse.ArgumentParser(description="Write organ.stl and its scan.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    folder = options.out
    folder.mkdir(parents=True, exist_ok=True)
    triangles = organ_triangles()
    write_stl(folder / "organ.stl", triangles)
    points, directions = presses(triangles.astype(np.float32).astype(float))
    write_scan(make_scan(folder, points, directions, options.seed), folder / "scan.csv")
    text = STUDY.format(
        poisson_ratio=POISSON_RATIO, radius=TIP_RADIUS_M, noise_m=NOISE_M, noise_n=NOISE_N
    )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    inclusions = [vars(inclusion) for inclusion in TRUTH.inclusions]
    truth = {"schema": 1, "body": {"background_pa": TRUTH.background_pa, "inclusions": inclusions}}
    (folder / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
