"""Robot scans of closed curved bodies and their fits: force, place, law, and the intervals.

    python benchmarks/robot_scans.py [--out FOLDER] [--presses N] [SEED ...]

The organ of the examples and three bodies made here (a dome, a saddle, a thin lobe) are scanned by
the virtual robot with balls of 3 and 8 mm along the surface's normals, up to 60 degrees from the
vertical, with a map drawn at random; the map is fitted, and its six 95 % intervals are compared
with the truth. Seeds 30 to 39 and 25 presses by default; the bodies take turns. A line a seed goes
to `robot_scans.jsonl` in the folder; a table is printed of all lines there.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import palpmap as pm
from examples.organ.make_organ import organ_triangles, write_stl
from identify.fit.start_map import fit_map

SEEDS = range(30, 40)
RINGS = 16
GRID = 22
FORCE_N = 0.2  # no press goes half through a body that is as thin and soft as they come here

STUDY = """\
[study]
name = "{name}"
scan = "scan.csv"

[body]
shape = "surface"
file = "{file}"
poisson_ratio = 0.45
support = "base-bonded"

[probe]
tip = "sphere"
radius_m = 0.003

[noise]
displacement_m = 2e-05
force_n = 0.005

[map]
inclusions = 1
"""


def dome(half_axes_m: tuple[float, float, float]) -> np.ndarray:
    """Triangles (t, 3, 3) m of the upper half of an ellipsoid on a flat base, corner at zero."""
    ring = np.arange(RINGS + 1)
    upper = np.linspace(0, np.pi / 2, RINGS + 1)
    around = 2 * np.pi * np.arange(4 * RINGS) / (4 * RINGS)
    a, b, c = half_axes_m

    def at(i: np.ndarray, k: np.ndarray, flat: bool) -> np.ndarray:
        """Point in ring i at angle k, of the dome or of the base."""
        across = np.sin(upper[i])
        height = np.zeros_like(across) if flat else np.where(i == RINGS, 0.0, np.cos(upper[i]))
        angle = around[k % len(around)]
        x, y = across * np.cos(angle), across * np.sin(angle)
        return np.stack([a * (1 + x), b * (1 + y), c * height], axis=-1)

    i, k = (v.ravel() for v in np.meshgrid(ring[:-1], np.arange(len(around)), indexing="ij"))
    parts = []
    for flat in (False, True):
        p, q, r, s = (at(i + m, k + n, flat) for m, n in ((0, 0), (1, 0), (1, 1), (0, 1)))
        both = np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)[i > 0]])
        parts.append(both[:, ::-1] if flat else both)
    return np.concatenate(parts)


def saddle(size_m: tuple[float, float, float], radius_m: float) -> np.ndarray:
    """Triangles (t, 3, 3) m of a block whose top is a saddle of that radius, both ways."""
    x, y = (np.linspace(0, edge, GRID + 1) for edge in size_m[:2])
    bend = ((x[:, None] - size_m[0] / 2) ** 2 - (y - size_m[1] / 2) ** 2) / (2 * radius_m)
    top = np.stack([*np.meshgrid(x, y, indexing="ij"), size_m[2] + bend], axis=-1)
    low = top * [1, 1, 0]

    def sheet(p: np.ndarray) -> np.ndarray:
        a, b, c, d = (v.reshape(-1, 3) for v in (p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]))
        return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

    sides = [np.stack([low[:, 0], top[:, 0]], 1), np.stack([top[:, -1], low[:, -1]], 1),
             np.stack([top[0], low[0]], 1), np.stack([low[-1], top[-1]], 1)]  # fmt: skip
    return np.concatenate([sheet(top), sheet(low)[:, ::-1], *map(sheet, sides)])


BODIES = {
    "organ": organ_triangles,
    "dome": lambda: dome((0.040, 0.040, 0.036)),
    "saddle": lambda: saddle((0.09, 0.08, 0.035), 0.08),
    "lobe": lambda: dome((0.060, 0.032, 0.022)),
}


def run(seed: int, presses: int, folder: Path) -> dict:
    """Scan a body and fit its map; return the record of one line."""
    name = list(BODIES)[seed % len(BODIES)]
    own = folder / f"{seed}_{name}"
    own.mkdir(parents=True, exist_ok=True)
    write_stl(own / "body.stl", BODIES[name]())
    (own / "body.toml").write_text(STUDY.format(name=name, file=own.resolve() / "body.stl"))
    command = [sys.executable, "-m", "palpmap", "scan", "--study", own / "body.toml", "--tips",
               "ball:3,ball:8", "--truth", "random", "--seed", seed, "--presses", presses,
               "--force", FORCE_N, "--out", own / "scan"]  # fmt: skip
    done = subprocess.run([str(part) for part in command], check=False, stdout=subprocess.DEVNULL)
    if done.returncode not in (0, 1):  # 1: a press did not keep its promise, which the table says
        raise SystemExit(f"the scan of seed {seed} was refused")
    made = json.loads((own / "scan/presses.json").read_text())["presses"]
    kept = [press for press in made if press["kept"]]
    begun = time.process_time()
    fit = fit_map(pm.read_study(own / "scan/study.toml").opened(thin=False))
    truth = json.loads((own / "scan/truth.json").read_text())["body"]
    values = [truth["background_pa"], *truth["inclusions"][0].values()]
    found = [fit.parameters[name] for name in fit.map.names]
    low, high = np.transpose([(one.lower95, one.upper95) for one in found])
    return {
        "seed": seed,
        "body": name,
        "presses": presses,
        "outcomes": {o: sum(p["outcome"] == o for p in made) for o in {p["outcome"] for p in made}},
        "kept": len(kept),
        "force_error": max(abs(p["simulator"]["force_error"]) for p in kept),
        "place_error_m": max(p["simulator"]["contact_error_m"] for p in kept),
        "law_error": max(p["simulator"]["coupling_error"] for p in kept),
        "touch_error_m": float(np.mean([p["simulator"]["touch_error_m"] for p in kept])),
        "truth": values,
        "found": fit.map.values.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "held": int(np.sum((low <= values) & (values <= high))),
        "not_found": list(fit.at_bound),
        "chi2_per_dof": fit.chi2 / fit.dof,
        "converged": bool(fit.success),
        "fit_cpu_s": round(time.process_time() - begun, 1),
    }


def main() -> None:
    """Run the seeds and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("benchmarks/out/robot_scans"))
    parser.add_argument("--presses", type=int, default=25)
    parser.add_argument("seeds", type=int, nargs="*", default=list(SEEDS))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    lines = options.out / "robot_scans.jsonl"
    for seed in options.seeds:
        record = run(seed, options.presses, options.out)
        with lines.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
    rows = sorted(map(json.loads, lines.read_text().splitlines()), key=lambda row: row["seed"])
    print("| seed | body | presses made | force | place, mm | law | background | held | chi2/dof |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    for r in rows:
        print(
            f"| {r['seed']} | {r['body']} | {r['kept']} of {r['presses']} | "
            f"{r['force_error']:.2%} | {1e3 * r['place_error_m']:.3f} | {r['law_error']:.3%} | "
            f"{r['found'][0] / r['truth'][0] - 1:+.1%} | {r['held']} of 6 | "
            f"{r['chi2_per_dof']:.2f} |"
        )
    print(f"{sum(r['held'] for r in rows)} of {6 * len(rows)} true values in their intervals")


if __name__ == "__main__":
    main()
