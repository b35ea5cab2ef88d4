"""The reduced basis of every press against full solutions: error, bound and time by snapshots.

And ratios of two models' compliances, by bases of the same maps: the block elsewhere, fibres. Part
of `python benchmarks/run.py`. Maps are drawn around one inclusion, all six parameters at once;
the seeds stand here, and none is left out. Times are those of the processor.
"""

from __future__ import annotations

import time

import numpy as np

from fem import Contacts, PalpationModel, block_mesh
from fem.mesh import moved_sides
from fem.reduced import Body, ReducedModel, ReducedRatio

SIZE_M = (0.096, 0.096, 0.048)
CENTRE = np.array([6e3, 1.2e4, 0.050, 0.045, 0.030, 0.012])
HALF = np.array([300, 1200, 1e-3, 1e-3, 1e-3, 6e-4])
SPREADS = (0.3, 1.0, 3.0)  # of HALF: 5 % of the background, 10 % of the weight, 1 mm, 5 %
SNAPSHOTS = (1, 3, 5, 7, 9)
BASIS_SEED, MAP_SEED, MAPS = 1, 7, 5
MOVED_M, RATIO, FIBRES = (0.0058, 0.0), 0.47, (0.4, 0.3)  # angle, share of the modulus


def field(parameters: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Young's modulus (p,) of a background with a Gaussian inclusion, Pa."""
    base, weight, *centre, radius = parameters
    return base + weight * np.exp(-np.sum((points - centre) ** 2, axis=1) / (2 * radius**2))


def drawn(seed: int, count: int, spread: float) -> np.ndarray:
    moved = np.random.default_rng(seed).uniform(-1, 1, (count, 6))
    return CENTRE + spread * HALF * moved


def block() -> PalpationModel:
    """Return the model of a block under 81 presses."""
    side = np.linspace(0.016, 0.080, 9)
    points = np.array([(x, y, SIZE_M[2]) for x in side for y in side])
    contacts = Contacts(points, np.array([0.0, 0.0, -1.0]), np.array(0.005))
    return PalpationModel(block_mesh(SIZE_M, (8, 8, 4)), 0.49, contacts)


def table() -> list[str]:
    """Return the table, a row for each spread of the maps and number of snapshots."""
    full = block()
    places, derivative = full.points_m, np.ones((len(full.points_m), 6))
    full.evaluate(field(CENTRE, places))
    begin = time.process_time()
    full.evaluate(field(CENTRE, places)).gradient(derivative)
    rows = [
        f"81 presses, 6,936 unknowns, ten-node tetrahedra; a full solution with its derivatives "
        f"takes {1e3 * (time.process_time() - begin):.0f} ms of the processor.",
        "",
        "| maps within | snapshots | error, rms | worst | bound, worst | bound / error, least "
        "| growth ms | evaluation ms |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for spread in SPREADS:
        maps = drawn(MAP_SEED, MAPS, spread)
        fields = [field(one, places) for one in maps]
        exact = [full.evaluate(one).compliance for one in fields]
        reduced = ReducedModel(full)
        snapshots = [CENTRE, *drawn(BASIS_SEED, SNAPSHOTS[-1] - 1, spread)]
        for parameters in snapshots:
            solution = full.evaluate(field(parameters, places))
            begin = time.process_time()
            reduced.add(solution)
            growth = time.process_time() - begin
            if len(reduced) not in SNAPSHOTS:
                continue
            for _ in range(2):  # the second time in the span of the fields
                errors, bounds, took = [], [], []
                for one, known in zip(fields, exact, strict=True):
                    begin = time.process_time()
                    found = reduced.evaluate(Body(one))
                    assert found is not None
                    found.gradient(derivative)
                    took.append(time.process_time() - begin)
                    errors.append(1 - found.compliance / known)
                    bounds.append(found.high / found.compliance - 1)
            error, bound = np.array(errors), np.array(bounds)
            seen = error > 1e-6  # rounding below
            least = f"{(bound / error)[seen].min():.2f}" if seen.any() else ""
            rows.append(
                f"| {5 * spread:g} %, {10 * spread:g} %, {spread:g} mm, {5 * spread:g} % "
                f"| {len(reduced)} | {np.sqrt((error**2).mean()):.1e} | {error.max():.1e} "
                f"| {bound.max():.1e} | {least} | {1e3 * growth:.0f} "
                f"| {1e3 * np.median(took):.1f} |"
            )
    return rows


def ratio_table() -> list[str]:
    """Return the table of ratios, a row for each pair of models, spread and number of snapshots."""
    full = block()
    moved = full.on(moved_sides(full.mesh, MOVED_M))
    other = PalpationModel(full.mesh, RATIO, full.contacts)
    direction = np.array([np.cos(FIBRES[0]), np.sin(FIBRES[0]), 0.0])

    def plain(parameters: np.ndarray, model: PalpationModel) -> Body:
        return Body(field(parameters, model.points_m))

    def fibrous(parameters: np.ndarray, model: PalpationModel) -> Body:
        modulus = field(parameters, model.points_m)
        return Body(modulus, fibres=(direction, FIBRES[1] * modulus))

    rows = [
        "| ratio to the block as it is | maps within | snapshots | the ratio's error, worst "
        "| one compliance's | estimate / error, least |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for what, model, body in (
        (f"block {1e3 * MOVED_M[0]:g} mm further on", moved, plain),
        ("the same, fibres in both", moved, fibrous),
        (f"Poisson's ratio {RATIO:g}, not 0.49", other, plain),
    ):
        for spread in SPREADS:
            maps = drawn(MAP_SEED, MAPS, spread)
            exact = [[m.evaluate(*body(one, m)).compliance for m in (full, model)] for one in maps]
            ratio = ReducedRatio(full, fibres=body is fibrous)
            single = ReducedModel(full, fibres=body is fibrous)
            for number, parameters in enumerate([CENTRE, *drawn(BASIS_SEED, 2, spread)]):
                solutions = [m.evaluate(*body(parameters, m)) for m in (full, model)]
                ratio.add(model, number, *solutions)
                single.add(solutions[0])
                errors, alone, estimates = [], [], []
                for one, (here, there) in zip(maps, exact, strict=True):
                    found = ratio.estimated(
                        model, one.tobytes(), lambda m, one=one, body=body: body(one, m)
                    )
                    assert found is not None
                    errors.append(np.abs(found[0] - np.log(there / here)).max())
                    estimates.append(found[1])
                    one_alone = single.evaluate(body(one, full))
                    assert one_alone is not None
                    alone.append(np.abs(one_alone.compliance / here - 1).max())
                rows.append(
                    f"| {what} | {5 * spread:g} %, {10 * spread:g} %, {spread:g} mm, "
                    f"{5 * spread:g} % | {number + 1} | {max(errors):.1e} | {max(alone):.1e} "
                    f"| {np.min(np.array(estimates) / errors):.1f} |"
                )
    return rows


if __name__ == "__main__":
    print("\n".join([*table(), "", *ratio_table()]))
