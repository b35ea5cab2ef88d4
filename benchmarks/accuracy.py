"""How wrong the compliance of a press is: meshes against an independent hexahedral solver.

The two bodies and their 81 presses are those of `tests/data/lab`. The one-depth correction is the
simple alternative to the near field in the space: what the bare mesh lacks on the homogeneous
body, divided by the modulus at one depth under the tip. "Carried" is what a fit does: the coarse
model times its ratio to the extrapolated pair at another map, `nearby`. Part of
`python benchmarks/run.py`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from fem.palpation.response import Response
from identify.map.gaussian_map import GaussianMap, Inclusion
from models.scan_file import read_scan

LAB = Path(__file__).parent.parent / "tests" / "data" / "lab"
CASES = ("case_a", "case_k")
SIZE_M = (0.096, 0.096, 0.048)
POISSON_RATIO = 0.49
COARSE, FINE = (8, 8, 4), (12, 12, 6)
REPEATS = 5  # evaluations a case, of which the median counts
DEPTH_M = {COARSE: 0.003, FINE: 0.002}  # where the one-depth correction reads the modulus

Model = PalpationModel | RefinedModel
Result = TypeVar("Result")


def case(name: str) -> tuple[Contacts, GaussianMap, np.ndarray]:
    """Return the presses of a case, its true map and the reference's compliances (81,) m/N."""
    truth = json.loads((LAB / name / "truth.json").read_text(encoding="utf-8"))
    scan = read_scan(LAB / name / "scan.csv")
    body = truth["body"]
    stiffness = GaussianMap(
        body["background_pa"], tuple(Inclusion(**entry) for entry in body["inclusions"])
    )
    contacts = Contacts(scan.contact_points, scan.contact_directions, scan.contact_radii)
    return contacts, stiffness, np.array(truth["compliance_m_per_n"])


def nearby(stiffness: GaussianMap) -> GaussianMap:
    """Return a map as far off as a fit's may be when it is carried to the finer meshes."""
    off = tuple(
        Inclusion(0.8 * i.weight_pa, i.x_m + 2e-3, i.y_m - 2e-3, i.z_m + 3e-3, 1.15 * i.radius_m)
        for i in stiffness.inclusions
    )
    return GaussianMap(1.1 * stiffness.background_pa, off)


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def build(contacts: Contacts, divisions: tuple[int, int, int], near_field: bool) -> PalpationModel:
    mesh = block_mesh(SIZE_M, divisions)
    return PalpationModel(mesh, POISSON_RATIO, contacts, near_field=near_field)


def table() -> list[str]:
    """Return the lines of the table."""
    contacts = case(CASES[0])[0]
    models: dict[str, Model] = {}
    setup: dict[str, float] = {}
    build(Contacts(contacts.points_m[:1], contacts.directions[:1], 0.005), (4, 4, 2), True)  # warm
    for divisions in (COARSE, FINE):
        for kind, near_field in (("bare mesh", False), ("with near field", True)):
            name = f"{label(divisions)}, {kind}"
            models[name], setup[name] = timed(
                lambda d=divisions, n=near_field: build(contacts, d, n)
            )
    pair = [f"{label(divisions)}, with near field" for divisions in (COARSE, FINE)]
    extrapolated = f"{label(COARSE)} and {label(FINE)}, with near field, extrapolated"
    models[extrapolated] = RefinedModel(*(models[name] for name in pair))  # pyright: ignore
    carried = f"{pair[0]}, carried to the last row at a map nearby"
    setup[extrapolated] = sum(setup[name] for name in pair)

    seconds: dict[str, list[float]] = {}
    derive: dict[str, list[float]] = {}
    error: dict[str, list[np.ndarray]] = {}
    exact_homogeneous = models[extrapolated].evaluate(np.array(1.0)).compliance
    lacking = {
        divisions: exact_homogeneous
        - models[f"{label(divisions)}, bare mesh"].evaluate(np.array(1.0)).compliance
        for divisions in (COARSE, FINE)
    }
    for number, name in enumerate(CASES):
        same, stiffness, reference = case(name)
        if not np.array_equal(same.points_m, contacts.points_m):
            raise ValueError(f"{name} presses elsewhere than {CASES[0]}")
        for key, model in models.items():
            modulus = stiffness.modulus(model.points_m)
            response = model.evaluate(modulus)
            took = [timed(lambda m=model, e=modulus: m.evaluate(e)) for _ in range(REPEATS)]
            seconds.setdefault(key, []).extend(elapsed for _, elapsed in took)
            for fresh, _ in took:
                if isinstance(fresh, Response):
                    elapsed = timed(lambda r=fresh: r.sensitivity)[1]
                    derive.setdefault(key, []).append(elapsed)
            error.setdefault(key, []).append(response.compliance / reference - 1)
        for divisions, missing in lacking.items():
            depth = DEPTH_M[divisions]
            key = f"{label(divisions)}, bare mesh + one-depth correction ({1e3 * depth:.0f} mm)"
            below = stiffness.modulus(contacts.points_m + depth * contacts.directions)
            bare = reference * (1 + error[f"{label(divisions)}, bare mesh"][number])
            error.setdefault(key, []).append((bare + missing / below) / reference - 1)
        other = nearby(stiffness)
        here = [models[name].evaluate(other.modulus(models[name].points_m)).compliance
                for name in (extrapolated, pair[0])]  # fmt: skip
        coarse = 1 + error[pair[0]][number]
        error.setdefault(carried, []).append(coarse * here[0] / here[1] - 1)
    setup[carried] = setup[extrapolated] + np.median(seconds[extrapolated])
    seconds[carried], derive[carried] = seconds[pair[0]], derive[pair[0]]
    return [
        "Error of the compliance of 81 presses, flat tip of 5 mm, Poisson's ratio 0.49. The map "
        "nearby: modulus 10 %, weight 20 %, radius 15 %, place 4 mm off.",
        "",
        "| model | "
        + " | ".join(f"{c} rms % | max %" for c in CASES)
        + " | set-up s | evaluate s | all derivatives s |",
        "|---|" + "---:|" * (2 * len(CASES) + 3),
        *(
            f"| {name} | "
            + " | ".join(f"{100 * rms(e):.2f} | {100 * np.abs(e).max():.2f}" for e in error[name])
            + (
                f" | {setup[name]:.1f} | {np.median(seconds[name]):.2f} |"
                if name in setup
                else " | | |"
            )
            + (f" {np.median(derive[name]):.2f} |" if name in derive else " |")
            for name in sorted(
                error, key=lambda n: (n == extrapolated, n.split(",")[0] != label(COARSE))
            )
        ),
    ]


def label(divisions: tuple[int, int, int]) -> str:
    return " x ".join(str(count) for count in divisions)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
