"""Free maps of bodies that no smooth prior draws: coverage of bands, odds of spots, areas.

    python benchmarks/free_maps.py [--seeds 0 8] [--kinds ball layer] [--smoothness 1.5]
        [--out free_maps.jsonl]

For every seed a body of each kind: a cube, a torus, two lobes, a layer, nothing, a ball of 10 mm
with three times the modulus around it at a depth of 5 to 18 mm, and two bodies that steep walls
divide: on one side of a plane, or between two, the modulus differs at every depth. Edges are sharp;
the truth has a finer mesh of its own. 49 presses with a flat tip of 4 mm on a bonded block of
80 x 80 x 40 mm. Every line goes to a file, from which an interrupted run goes on.

Coverage: share of the seen points of the map's grid at which ln E lies in its 95 % band. A spot is
found if its probability is `SpotSettings.probable`; it is the ball's if its centre lies within
7 mm. The area under the curve (AUC) compares the probability of the ball's own spot with that of
any spot in the bodies of nothing, for balls above and below the depth of sight of such a ball that
their scan prints. A spot is false if it is found where no ball is, in bodies with a ball, a layer
or nothing; an area, in bodies with a layer or nothing.
"""

import argparse
import json
import multiprocessing
import time
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np

import palpmap as pm
from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.fit.free_map.settings import SPOTS
from identify.map import GaussianMap

SIZE_M, NU, TIP_M, PER_SIDE = (0.08, 0.08, 0.04), 0.45, 0.004, 7
NOISE_M, NOISE_N, FORCES_N = 1e-5, 3e-3, np.linspace(0.04, 0.3, 8)
KINDS = ("cube", "torus", "lobes", "layer", "nothing", "ball", "step", "slab")
BALL_M, CONTRAST, NEAR_M = 0.005, 3.0, 0.007
DEEPEST_M = 0.018


class Body(GaussianMap):
    """A body of one kind, drawn by a seed."""

    def __init__(self, kind: str, seed: int) -> None:
        rng = np.random.default_rng([seed, KINDS.index(kind), 7])
        super().__init__(float(np.exp(rng.uniform(np.log(4e3), np.log(1.2e4)))))
        size = np.array(SIZE_M)
        deep = rng.uniform(0.008, 0.016)
        place = np.append(rng.uniform(0.025, size[:2] - 0.025), size[2] - deep)
        if kind == "ball":
            place[2] = size[2] - rng.uniform(BALL_M, DEEPEST_M)
        given = {
            "factor": float(np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.5), np.log(4)))),
            "place": place,
            "half": rng.uniform(0.006, 0.014, 3),
            "angle": rng.uniform(0, np.pi),
        }
        for name, value in {"kind": kind, **given}.items():
            object.__setattr__(self, name, value)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Whether points (p, 3) lie in the other material."""
        away = points - self.place
        c, s = np.cos(self.angle), np.sin(self.angle)
        x, y, z = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0], away[:, 2]
        a, b, h = self.half
        if self.kind == "cube":
            return (np.abs(x) < a) & (np.abs(y) < b) & (np.abs(z) < h / 2)
        if self.kind == "torus":
            ring = np.hypot(x, y) - (0.008 + a / 2)
            return np.hypot(ring, z) < 0.004 + b / 4
        if self.kind == "lobes":
            near = (x + 0.012) ** 2 + y**2 + (1.5 * z) ** 2 < a**2
            return near | ((x - 0.012) ** 2 + y**2 + (1.5 * z) ** 2 < b**2)
        if self.kind == "layer":
            return np.abs(z) < h / 2
        if self.kind == "step":
            return x > 0
        if self.kind == "slab":
            return np.abs(x) < a
        if self.kind == "ball":
            return np.linalg.norm(away, axis=1) < BALL_M
        return np.zeros(len(points), bool)

    def modulus(self, points, shape=None):
        """Young's modulus (p,) in Pa."""
        factor = CONTRAST if self.kind == "ball" else self.factor
        return self.background_pa * np.where(self.inside(points), factor, 1.0)


@cache
def truth_model() -> PalpationModel:
    """Return the true body's finite elements."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0.01, 0.07, PER_SIDE)] * 2))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    down = np.tile([0, 0, -1.0], (x.size, 1))
    return PalpationModel(
        block_mesh(SIZE_M, (19, 19, 10)), NU, Contacts(points, down, np.full(x.size, TIP_M))
    )


def trial(job: tuple[str, int, float]) -> dict:
    """Scan and fit one body; return its line."""
    kind, seed, smoothness = job
    body, at, started = Body(kind, seed), truth_model().contacts, time.process_time()
    c, n = compliance(truth_model(), body), len(FORCES_N)
    rng = np.random.default_rng([seed, KINDS.index(kind), 8])
    press, force = np.repeat(np.arange(len(at)), n), np.tile(FORCES_N, len(at))
    rows = len(press)
    scan = pm.Scan(
        press=press, time_s=np.full(rows, np.nan), phase=np.full(rows, "load"),
        force_n=force + rng.normal(0, NOISE_N, rows),
        displacement_m=c[press] * force + rng.normal(0, NOISE_M, rows),
        point_m=at.points_m[press], direction=at.directions[press],
        probe_radius_m=at.radius_m[press],
    )  # fmt: skip
    known = pm.Experiment(
        scan, pm.Block(SIZE_M, poisson_ratio=NU), pm.FlatTip(TIP_M),
        noise=pm.Noise(displacement_m=NOISE_M, force_n=NOISE_N),
    ).of_kind("free", smoothness)  # fmt: skip
    fit = pm.fit(known)
    field, grid = fit.field, fit.map.grid
    off = np.log(body.modulus(grid.points_m)) - fit.map.log_pa
    held, seen = np.abs(off) < 1.96 * field.log_sd, field.share >= SPOTS.seen
    apart = [float(np.linalg.norm(np.array([s.x_m, s.y_m, s.z_m]) - body.place))
             for s in field.spots]  # fmt: skip
    areas = [asdict(a) | {"apart_m": float(np.hypot(a.x_m - body.place[0], a.y_m - body.place[1]))}
             for a in field.areas]  # fmt: skip
    return {
        "kind": kind, "seed": seed, "smoothness": smoothness,
        "success": fit.success, "chi2_per_dof": fit.chi2_per_dof,
        "held_seen": float(held[seen].mean()), "held": float(held.mean()),
        "rms_off": float(np.sqrt(np.mean(off[seen] ** 2))),
        "evaluations": fit.nfev, "seen": float(seen.mean()),
        "sight_m": field.sight_m, "ball_sight_m": field.ball_sight_m,
        "depth_m": float(SIZE_M[2] - body.place[2]), "factor": body.factor,
        "areas": areas,
        "spots": [asdict(s) | {"apart_m": d} for s, d in zip(field.spots, apart, strict=True)],
        "cpu_s": time.process_time() - started,
    }  # fmt: skip


def summary(lines: list[dict]) -> str:
    """Return the table."""
    says = [
        "| body | scans | ended | seen points in their band | worst scan |",
        "|---|---:|---:|---:|---:|",
    ]
    for kind in KINDS:
        own = [line for line in lines if line["kind"] == kind]
        held = [line["held_seen"] for line in own]
        if own:
            says.append(
                f"| {kind} | {len(own)} | {sum(line['success'] for line in own)} "
                f"| {100 * np.mean(held):.1f} % | {100 * min(held):.0f} % |"
            )
    says += ["", *spots_summary(lines), *areas_summary(lines)]
    says.append(f"{np.mean([line['cpu_s'] for line in lines]):.0f} s of CPU a scan.")
    return "\n".join(says)


def spots_summary(lines: list[dict]) -> Iterator[str]:
    """Yield what became of the balls, and the false spots."""
    balls = [line for line in lines if line["kind"] == "ball"]
    none = [
        max((s["probability"] for s in line["spots"]), default=0.0)
        for line in lines if line["kind"] == "nothing"
    ]  # fmt: skip
    for name, above in (("above", True), ("below", False)):
        some = [b for b in balls if (b["depth_m"] <= b["ball_sight_m"]) == above]
        own = [[s for s in b["spots"] if is_of_ball(s)] for b in some]
        odds = [max((s["probability"] for s in spots), default=0.0) for spots in own]
        if odds and none:
            auc = np.mean([(a > b) + 0.5 * (a == b) for a in odds for b in none])
            held = [
                (s["lower95"] < CONTRAST < s["upper95"],
                 s["diameter_lower95_m"] < 2 * BALL_M < s["diameter_upper95_m"])
                for spots in own for s in spots[:1]
            ]  # fmt: skip
            yield (
                f"Balls {name} their depth of sight: AUC {auc:.3f}, "
                f"{sum(p >= SPOTS.probable for p in odds)} of {len(odds)} found; of {len(held)} "
                f"listed, contrast and diameter in their intervals: {np.sum(held, axis=0)}."
            )
    for kind in ("ball", "layer", "nothing"):
        own = [line["spots"] for line in lines if line["kind"] == kind]
        false = [
            s for spots in own for s in spots
            if s["probability"] >= SPOTS.probable and not (kind == "ball" and is_of_ball(s))
        ]  # fmt: skip
        yield f"False spots, {kind}: {len(false)} in {len(own)} scans."


def areas_summary(lines: list[dict]) -> Iterator[str]:
    """Yield the areas that are false, and those over the lumps."""
    for kind in ("layer", "nothing"):
        own = [line["areas"] for line in lines if line["kind"] == kind]
        yield f"False areas, {kind}: {sum(map(len, own))} in {len(own)} scans."
    for kind in ("cube", "torus", "lobes", "ball"):
        own = [line for line in lines if line["kind"] == kind]
        first = [line["areas"][0] for line in own if line["areas"]]
        near = [area["apart_m"] for area in first]
        right = sum(
            (line["areas"][0]["contrast"] > 1) == (kind == "ball" or line["factor"] > 1)
            for line in own if line["areas"]
        )  # fmt: skip
        if own:
            yield (
                f"First area, {kind}: in {len(near)} of {len(own)} scans, as hard or soft as the "
                f"lump in {right}, {1e3 * np.median(near or [0]):.1f} mm (median) off it."
            )


def is_of_ball(spot: dict) -> bool:
    """Whether a spot is the hard ball of its body."""
    return spot["apart_m"] < NEAR_M and spot["contrast"] > 1


def main() -> None:
    """Play the trials that are missing, and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 8))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--smoothness", type=float, choices=(0.5, 1.5), default=0.5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("free_maps.jsonl"))
    given = parser.parse_args()
    lines = (
        [json.loads(t) for t in given.out.read_text().splitlines()] if given.out.exists() else []
    )
    smoothness = given.smoothness
    lines = [line for line in lines if line.get("smoothness", 1.5) == smoothness]
    played = {(line["kind"], line["seed"]) for line in lines}
    jobs = [
        (k, s, smoothness)
        for s in range(*given.seeds) for k in given.kinds if (k, s) not in played
    ]  # fmt: skip
    with (
        multiprocessing.get_context("spawn").Pool(given.workers) as pool,
        given.out.open("a") as file,
    ):
        for line in pool.imap_unordered(trial, jobs):
            lines.append(line)
            file.write(json.dumps(line) + "\n")
            file.flush()
            print(len(lines), line["kind"], line["seed"], f"{line['held_seen']:.3f}", flush=True)
    print(summary(lines))


if __name__ == "__main__":
    main()
