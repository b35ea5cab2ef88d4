"""Blind trials in bodies that the study's map, one Gaussian inclusion, does not describe.

    python benchmarks/other_bodies.py [--seed 9901] [--trials 0 24] [--out other_bodies]

Cube, torus, two lobes, layer, soft ball and two inclusions take turns, 2 to 5 times as stiff as the
rest or a quarter to half as stiff, with edges of 1.5 mm. Three rounds of four hide an effect in a
form that the catalogue does not have, 3 % of the signal, the fourth nothing. Scan and study are
those of `palpmap blind`. What is named of the map's form (a further inclusion, an edge, a stretch)
is right in such a body, and is judged apart: names of it, and groups that hold one, count for
nothing in the table. Every trial is a line in a file, from which an interrupted run goes on; each
has a process of its own.
"""

import argparse
import json
import multiprocessing
import resource
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpmap.blind.records import AnswerRecord
from palpmap.blind.score import score_blind
from palpmap.blind.seal import unseal
from palpmap.blind.tournament import explain_trial
from palpmap.blind.trial import Conditions, draw_trial, make_trial
from sim.body import PAPER_SIZE_M, Inclusion, TruthMap, forget_models

KINDS = ("cube", "torus", "lobes", "layer", "soft", "two")
SIZE, EDGE_M = 0.03, 0.0015
OF_MAP = {"extra_inclusion", "inclusion_edge", "inclusion_stretch", "stiffness_gradient"}


def _inside(depth_m: np.ndarray) -> np.ndarray:
    """1 inside, 0 outside, by the distance from the edge inwards."""
    return 1 / (1 + np.exp(-np.clip(depth_m / EDGE_M, -50, 50)))


@dataclass(frozen=True)
class Shape(Inclusion):
    """An inclusion of another shape, of even stiffness within."""

    kind: str = "cube"
    half_m: tuple[float, float, float] = (0.01, 0.01, 0.01)

    def added(self, points_m: np.ndarray) -> np.ndarray:
        """Modulus that it adds at points (p, 3) m, (p,) Pa."""
        away = points_m - np.asarray(self.centre_m)
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        x, y, z = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0], away[:, 2]
        a, b, h = self.half_m
        if self.kind == "cube":
            part = _inside(a - abs(x)) * _inside(b - abs(y)) * _inside(h / 2 - abs(z))
        elif self.kind == "torus":
            ring = np.hypot(x, y) - (0.008 + a / 2)
            part = _inside(0.004 + b / 4 - np.hypot(ring, z))
        elif self.kind == "lobes":
            outside = [
                1 - _inside(r - np.sqrt((x - off) ** 2 + y**2 + (1.5 * z) ** 2))
                for r, off in ((a, -0.012), (b, 0.012))
            ]
            part = 1 - outside[0] * outside[1]
        elif self.kind == "layer":
            part = _inside(h / 2 - abs(z))
        else:
            part = _inside(a - np.sqrt(x**2 + y**2 + z**2))
        return self.weight_pa * part


def body(kind: str, seed: int) -> TruthMap:
    """Draw a body of a kind."""
    rng, top = np.random.default_rng([seed, 77]), PAPER_SIZE_M[2]
    background = float(rng.uniform(4000, 8000))
    x, y = (rng.uniform(0.35, 0.65, 2) * PAPER_SIZE_M[:2]).tolist()
    z = top - float(rng.uniform(0.008, 0.016))
    factor = float(rng.uniform(2, 5))
    half_m = tuple(rng.uniform(0.006, 0.014, 3).tolist())
    angle = float(rng.uniform(0, np.pi))
    if kind == "two":
        first = Inclusion(background * (factor - 1), (0.035, y, z), 0.008)
        weight, place = (
            background * float(rng.uniform(1, 3)),
            (0.065, PAPER_SIZE_M[1] - y, top - 0.012),
        )
        return TruthMap(background, (first, Inclusion(weight, place, 0.009, ball_share=0.9)))
    if kind == "soft":
        factor = float(rng.uniform(0.25, 0.5))
    weight = background * (factor - 1)
    shape = Shape(weight, (x, y, z), 0.01, angle_rad=angle, kind=kind, half_m=half_m)
    return TruthMap(background, (shape,))


def beside_map(answer: AnswerRecord) -> AnswerRecord:
    """Return an answer without its names of the map's form, and the groups that hold one."""
    added = tuple(name for name in answer.added if name not in OF_MAP)
    groups = tuple(group for group in answer.ambiguous if not set(group) & OF_MAP)
    verdict = answer.verdict
    if verdict in ("explained", "ambiguous"):
        verdict = "ambiguous" if groups else "explained" if added else "nothing_missing"
    return answer.model_copy(update={"added": added, "ambiguous": groups, "verdict": verdict})


def trial(job: tuple[Path, int, int]) -> dict:
    """Make, explain and judge one trial; return its line."""
    out, seed, number = job
    kind, hides = KINDS[number % 6], number // 6 % 4 != 3
    own, folder = 1_000_000 * seed + number, out / f"{number:03d}"
    folder.mkdir(parents=True, exist_ok=True)
    drawn = draw_trial(own, Conditions(("form",) if hides else ("none",), SIZE))
    make_trial(folder, drawn, truth=body(kind, own))
    forget_models()
    started = time.process_time()
    answer = explain_trial(folder / "study.toml", folder, own)
    truth = unseal(folder)
    judged = score_blind(beside_map(answer), truth.effects)
    return {
        "number": number, "kind": kind, "hidden": drawn.effects, "verdict": answer.verdict,
        "added": answer.added, "ambiguous": answer.ambiguous, "outcome": judged.outcome,
        "reason": judged.reason, "background_pa": answer.parameters["background_pa"].value,
        "true_background_pa": truth.body.background_pa,
        "cpu_s": time.process_time() - started,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }  # fmt: skip


def summary(lines: list[dict]) -> str:
    """Return the table."""
    says = ["| body | trials | right | honest | missed | wrong | CPU s | peak GB |",
            "|---|---:|---:|---:|---:|---:|---:|---:|"]  # fmt: skip
    for kind in KINDS:
        own = [line for line in lines if line["kind"] == kind]
        if own:
            counts = [
                sum(line["outcome"] == what for line in own)
                for what in ("right", "honest", "missed", "wrong")
            ]
            spent = [max(line[what] for line in own) for what in ("cpu_s", "peak_gb")]
            cells = [kind, len(own), *counts, f"{spent[0]:.0f}", f"{spent[1]:.1f}"]
            says.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(says)


def main() -> None:
    """Play the trials that are missing, and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=9901)
    parser.add_argument("--trials", type=int, nargs=2, default=(0, 24))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("other_bodies"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "lines.jsonl"
    lines = [json.loads(t) for t in path.read_text().splitlines()] if path.exists() else []
    played = {line["number"] for line in lines}
    jobs = [(given.out, given.seed, n) for n in range(*given.trials) if n not in played]
    context = multiprocessing.get_context("spawn")
    with context.Pool(given.workers, maxtasksperchild=1) as pool, path.open("a") as file:
        for line in pool.imap_unordered(trial, jobs):
            lines.append(line)
            file.write(json.dumps(line) + "\n")
            file.flush()
            said = "number", "kind", "hidden", "verdict", "added", "ambiguous", "outcome"
            print(*(line[name] for name in said), f"{line['cpu_s']:.0f} s", flush=True)
    print(summary(lines))


if __name__ == "__main__":
    main()
